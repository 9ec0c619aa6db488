"""A store behind a meter that holds the grid import at a target.

The target is the limit of the connection in peak shaving, and 0 in self-consumption.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bess.arrays import Array
from bess.dispatch.program import StoreProgram
from bess.errors import InputError


@dataclass(frozen=True)
class GridPowerTarget:
    """Rule: discharge above the target, charge below it up to ``capacity_kwh``.

    Of all schedules that keep the target, the one that charges as early as possible has the highest stored
    energy at any time. The rule therefore keeps every target that is feasible with perfect foresight.

    Attributes
    ----------
    target_kw : float or ndarray
        Maximum grid import, for all steps or for each.
    power_kw : float
        Maximum power of the store in each direction (AC).
    capacity_kwh : float
        Maximum stored energy.
    one_way_efficiency : float
        Efficiency of each direction.
    dt_h : float
        Control step [h].
    min_power_kw : float
        Minimum power; below it the remaining energy is not charged or discharged, because no-load losses of
        the inverters exceed it.
    """

    target_kw: float | Array
    power_kw: float
    capacity_kwh: float
    one_way_efficiency: float
    dt_h: float
    min_power_kw: float = 0.0

    def demand_kw(self, net_kw: Array, stored_kwh: float) -> Array:
        """Return the demand on the store in each step, from ``stored_kwh`` at the start.

        Parameters
        ----------
        net_kw : ndarray, shape (n_steps,)
            Load less generation behind the meter [kW].
        stored_kwh : float
            Stored energy.

        Returns
        -------
        ndarray, shape (n_steps,)
            Power [kW], positive = discharge, within stored energy and headroom.
        """
        one_way = self.one_way_efficiency
        wanted = np.clip(net_kw - self.target_kw, -self.power_kw, self.power_kw)
        demand_kw = np.zeros(wanted.size)
        for step, power_kw in enumerate(wanted.tolist()):
            if power_kw > 0.0:
                power_kw = self._limited(power_kw, stored_kwh * one_way / self.dt_h)
                stored_kwh -= power_kw * self.dt_h / one_way
            else:
                power_kw = -self._limited(-power_kw, (self.capacity_kwh - stored_kwh) / one_way / self.dt_h)
                stored_kwh -= power_kw * self.dt_h * one_way
            demand_kw[step] = power_kw
        return demand_kw

    def _limited(self, wanted_kw: float, sustainable_kw: float) -> float:
        if wanted_kw <= sustainable_kw:
            return wanted_kw
        return sustainable_kw if sustainable_kw >= self.min_power_kw else 0.0


def min_peak_kw(
    net_kw: Array,
    dt_h: float,
    *,
    power_kw: float,
    capacity_kwh: float,
    stored_kwh: float,
    one_way_efficiency: float,
    month: npt.ArrayLike = 0,
) -> Array:
    r"""Return the lowest import limits that a store can keep with perfect foresight.

    With charging `c`, discharging `d` (AC power), stored energy `e` and the efficiency :math:`\eta` of each
    direction, and a limit :math:`L_m` for each month, it is the optimum of

    .. math:: \min \sum_m L_m\quad\text{s. t.}\quad n_t + c_t - d_t \le L_{m(t)},\quad
       e_t = e_{t-1} + \eta c_t \Delta t - d_t \Delta t / \eta,\quad 0 \le e_t \le E,\quad
       0 \le c_t, d_t \le P .

    Parameters
    ----------
    net_kw : ndarray, shape (n_steps,)
        Load less generation behind the meter [kW].
    dt_h : float
        Control step [h].
    power_kw, capacity_kwh, stored_kwh : float
        Power of the store, its energy capacity, and its energy at the start. Energy above the capacity is not
        counted: the store cannot charge back to it.
    one_way_efficiency : float
        Efficiency of each direction, in (0, 1].
    month : array_like of int, shape (n_steps,)
        Number of the month of each step; by default one limit holds for all.

    Returns
    -------
    ndarray, shape (n_steps,)
        Limit in each step [kW].

    Raises
    ------
    InputError
        There is no load to shave: the largest net load is not above 0.
    """
    if net_kw.max() <= 0.0:
        raise InputError(
            f"demand.load: the largest load less generation is {net_kw.max():g} kW, so there is no peak to "
            "shave; give a load, or demand.limit_kw"
        )
    program = StoreProgram(
        np.full(net_kw.size, dt_h),
        one_way_efficiency,
        min(stored_kwh, capacity_kwh),
        cost=(0.0, 0.0),
        max_power=(power_kw, power_kw),
        capacity=capacity_kwh,
    )
    numbers, period = np.unique(np.broadcast_to(month, net_kw.size), return_inverse=True)
    limit = program.add(numbers.size, cost=1.0)
    program.at_most(-net_kw, (program.charge, 1.0), (program.discharge, -1.0), (limit[period], -1.0))
    return np.asarray(program.solve().added[period])
