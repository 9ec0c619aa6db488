"""Arbitrage on market prices: a linear program over a rolling look-ahead."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array, require_positive
from bess.dispatch.blocks import Blocks
from bess.dispatch.connection import GridConnection, PeakTariff
from bess.dispatch.forecast import Forecast, steps_in
from bess.dispatch.program import StoreProgram, StoreSchedule
from bess.errors import InputError
from bess.units import HOURS_PER_DAY

if TYPE_CHECKING:
    from datetime import tzinfo

    import pandas as pd

_TOLERANCE: Final = 1e-6
"""Share of nominal power below which an answer of the solver is zero (its own tolerance is 1e-7)."""

_PAST_DAYS: Final = 7
"""Days before a plan that the choice of a monthly peak looks back on."""


class Arbitrage:
    r"""Plan purchases and sales from prices and the measured stored energy.

    [1]_ compares such a program with constant efficiency to nonlinear ones.

    With charging `c`, discharging `d` (AC power), stored energy `e` and the efficiency
    :math:`\eta_c = \eta_d = \sqrt{\eta}` and the fee `f` of each direction, every plan solves

    .. math:: \max \sum_t \bigl((\pi_t - f_d)\, d_t - (\pi_t + f_c)\, c_t\bigr)\,\Delta t
       \quad\text{s. t.}\quad e_t = e_{t-1} + \eta_c c_t \Delta t - d_t \Delta t / \eta_d,\quad
       0 \le e_t \le E,\quad 0 \le c_t, d_t \le P,\quad
       \sum_{t \in \text{day}} d_t \Delta t / \eta_d \le n E .

    Simultaneous charging and discharging never pays where :math:`\pi_t \ge 0`: lowering `c` by :math:`\delta`
    and `d` by :math:`\eta\delta` leaves `e` as it is, uses fewer cycles, saves fees and earns
    :math:`\pi_t (1 - \eta)\,\delta\,\Delta t \ge 0`. Such steps are netted without a loss. At a
    negative price the linear program may dissipate energy for income. If its solution does, the program is
    solved again with a binary for each step of negative price, which allows one direction only.

    A plan depends on its arguments only, so a run can resume. Between two plans (every `replan_h`) the
    caller keeps the last plan.

    Parameters
    ----------
    prices : Forecast
        Prices ahead [EUR/MWh]; `PerfectForecast` for day-ahead prices already published.
    days : array of int, shape (n_steps,)
        Day number of each step, for the cycle limit; see :func:`calendar_days`.
    power_kw : float
        Nominal AC power of the plant, charging and discharging, > 0.
    energy_kwh : float
        Usable stored energy between the SOC limits, > 0.
    efficiency : float
        Round trip, AC to AC, in (0, 1].
    cycles_per_day : float
        Maximum full cycles per calendar day: discharged stored energy over `energy_kwh`, > 0.
    cycles_per_plan : float or None
        Alternative to `cycles_per_day`: maximum full cycles of each plan, the mean of charged and discharged
        AC energy over `energy_kwh`, > 0.
    max_import_kw, max_export_kw : float or None
        Limits of the grid connection in each direction, below `power_kw`, > 0.
    look_ahead_h, replan_h : float
        Look-ahead of a plan, and interval between plans [h]; whole numbers of steps, and `replan_h` <=
        `look_ahead_h`. Plans do not model losses and derating, so fewer of them leave more undelivered.
    dt_h : float
        Control step [h].
    connection : GridConnection or None
        Load, generation, limits and tariff of a meter that the plant shares.
    reserved_kw : float or array_like, shape (n_steps,)
        Part of `power_kw` sold as reserve.
    fees_eur_mwh : pair of float
        Fees on each MWh charged and discharged (AC).

    Raises
    ------
    InputError
        A parameter is outside its range.

    References
    ----------
    .. [1] Cornejo et al.: Evaluating the impact of model accuracy for optimizing battery energy storage
       systems. arXiv:2506.17059.
    """

    def __init__(
        self,
        prices: Forecast,
        days: npt.ArrayLike,
        *,
        power_kw: float,
        energy_kwh: float,
        efficiency: float = 0.9,
        cycles_per_day: float = 2.0,
        cycles_per_plan: float | None = None,
        max_import_kw: float | None = None,
        max_export_kw: float | None = None,
        look_ahead_h: float = 36.0,
        replan_h: float = 6.0,
        dt_h: float = 0.25,
        connection: GridConnection | None = None,
        reserved_kw: npt.ArrayLike = 0.0,
        fees_eur_mwh: tuple[float, float] = (0.0, 0.0),
    ):
        require_positive(
            "arbitrage",
            power_kw=(power_kw, " kW"),
            energy_kwh=(energy_kwh, " kWh"),
            cycles_per_day=(cycles_per_day, ""),
            cycles_per_plan=(cycles_per_plan, ""),
            max_import_kw=(max_import_kw, " kW"),
            max_export_kw=(max_export_kw, " kW"),
        )
        if not 0.0 < efficiency <= 1.0:
            raise InputError(f"arbitrage: efficiency {efficiency} (round trip) is outside (0, 1]")
        self.look_ahead_steps = steps_in(look_ahead_h, dt_h, "arbitrage: look_ahead_h")
        self.replan_steps = steps_in(replan_h, dt_h, "arbitrage: replan_h")
        if self.replan_steps > self.look_ahead_steps:
            raise InputError(
                f"arbitrage: replan_h {replan_h} h must not exceed look_ahead_h {look_ahead_h} h"
            )
        self.prices = prices
        self.days = np.asarray(days, dtype=np.int64)
        self.power_kw, self.energy_kwh, self.dt_h = power_kw, energy_kwh, dt_h
        self.efficiency, self.cycles_per_day = efficiency, cycles_per_day
        self.cycles_per_plan, self.connection = cycles_per_plan, connection
        self._charge_fee, self._discharge_fee = fees_eur_mwh
        self._reserved = np.broadcast_to(np.asarray(reserved_kw, np.float64), self.days.shape) / power_kw
        self._max_power = (
            min(1.0, (max_import_kw or power_kw) / power_kw),
            min(1.0, (max_export_kw or power_kw) / power_kw),
        )

    def is_due(self, step: int) -> bool:
        """Return whether a new plan is due at `step`: every `replan_h` from step 0."""
        return step % self.replan_steps == 0

    def plan(
        self,
        step: int,
        energy_kwh: float,
        discharged_today_kwh: float = 0.0,
        *,
        budget_price_eur_mwh: float = 0.0,
        remaining_kwh: float = np.inf,
        available_kw: float = np.inf,
        available_kwh: float = np.inf,
    ) -> Array:
        """Return the demand of maximum income over the look-ahead.

        Parameters
        ----------
        step : int
            Present control step, ``0 <= step < n_steps``.
        energy_kwh : float
            Measured stored energy above the lower SOC limit. A value outside [0, `energy_kwh`] is accepted;
            the plan does not move it further outside.
        discharged_today_kwh : float
            Stored energy discharged since the day of `step` began, counted against `cycles_per_day`, >= 0.
        budget_price_eur_mwh : float
            Additional price of each MWh discharged: the shadow price of a budget.
        remaining_kwh : float
            Maximum stored energy that the plan may discharge.
        available_kw, available_kwh : float
            Power of the inverters and energy capacity of the strings in service, constant over the plan; also
            the energy of a cycle is at most this capacity.

        Returns
        -------
        numpy.ndarray, shape (min(look_ahead_steps, steps left),)
            Demand [kW], positive = discharge.

        Raises
        ------
        InputError
            An argument is outside its range.
        """
        if not np.isfinite(energy_kwh):
            raise InputError(f"arbitrage: stored energy {energy_kwh} kWh at step {step} must be finite")
        if not (np.isfinite(discharged_today_kwh) and discharged_today_kwh >= 0.0):
            raise InputError(
                f"arbitrage: discharged_today_kwh {discharged_today_kwh} kWh must be finite and >= 0 kWh"
            )
        price = self.prices.ahead(step, self.look_ahead_steps)
        if price.ndim != 1 or not 0 < price.size <= self.look_ahead_steps or not np.isfinite(price).all():
            raise InputError(
                f"arbitrage: at step {step} the price forecast must be 1 to "
                f"{self.look_ahead_steps} finite values"
            )
        days = self.days[step : step + price.size]
        if days.size != price.size:
            raise InputError(
                f"arbitrage: {self.days.size} day numbers do not cover step {step + price.size - 1}"
            )
        if self.connection is not None and self.connection.tariff is not None:
            self._choose_peak(self.connection, self.connection.tariff, step, price, energy_kwh)
        return self._solve(
            step,
            price,
            energy_kwh,
            discharged_today_kwh=discharged_today_kwh,
            budget_price_eur_mwh=budget_price_eur_mwh,
            remaining_kwh=remaining_kwh,
            available_kw=available_kw,
            available_kwh=available_kwh,
        )

    def of_prices(self, price_eur_mwh: Array, step: int, energy_kwh: float) -> Array:
        """Return the demand [kW] of maximum income at these prices from ``step`` on, without a meter."""
        return self._solve(step, price_eur_mwh, energy_kwh)

    def program(self, price_eur_mwh: Array, step: int, energy_kwh: float) -> StoreProgram:
        """Return the program from ``step`` on, in per unit of ``power_kw``; cost has the :meth:`weight`."""
        blocks, free = Blocks.single(price_eur_mwh.size), self._free_share(step, price_eur_mwh.size)
        return self._program(price_eur_mwh, step, energy_kwh, blocks, free)

    def _choose_peak(
        self, connection: GridConnection, tariff: PeakTariff, step: int, price: Array, energy_kwh: float
    ) -> None:
        """Once a day choose the peak of the month, from the last week and the known rest of the month."""
        day_steps = round(HOURS_PER_DAY / self.dt_h)
        if step % day_steps >= self.replan_steps and tariff.month[step] == tariff.month[step - 1]:
            return
        price = price[tariff.month[step : step + price.size] == tariff.month[step]]
        past = range(max(0, step - _PAST_DAYS * day_steps), step)
        price = np.r_[[self.prices.ahead(each, 1)[0] for each in past], price]
        net_kw = np.r_[[connection.net_kw(each, 1)[0] for each in past], connection.net_kw(step, price.size)]
        net_kw, weight = net_kw[: price.size], self.weight(price)
        program = self.program(price, step - len(past), energy_kwh)
        share = price.size / (tariff.month[step:] == tariff.month[step]).sum()
        month = np.zeros(price.size, dtype=np.int64)
        connection.constrain(program, price, net_kw, month, self.power_kw, weight, share)
        connection.raise_peak(self.power_kw * float(program.solve().added[-1]))

    def _free_share(self, step: int, n_steps: int, available_kw: float = np.inf) -> Array:
        """Power that is in service and not reserved, as a share of ``power_kw``."""
        available = min(1.0, available_kw / self.power_kw)
        return np.maximum(0.0, available - self._reserved[step : step + n_steps])

    def _solve(
        self, step: int, price: Array, energy_kwh: float, available_kw: float = np.inf, **limits: float
    ) -> Array:
        """Return the demand of an optimal schedule; ``limits`` are those of :meth:`_program`."""
        connection = self.connection
        days, free = self.days[step : step + price.size], self._free_share(step, price.size, available_kw)
        if connection is not None or np.ptp(free) > 0.0:  # load, generation, reserve change from step to step
            blocks = Blocks.single(price.size)
        else:
            blocks = Blocks.of(price, days, self.dt_h)
        program = self._program(price, step, energy_kwh, blocks, free[blocks.first], **limits)
        if connection is not None:
            net_kw, tariff = connection.net_kw(step, price.size), connection.tariff
            month = days if tariff is None else tariff.month[step : step + price.size]
            connection.constrain(program, price, net_kw, month, self.power_kw, self.weight(price))
        plan = one_direction(program, price[blocks.first])
        one_way = float(np.sqrt(self.efficiency))
        stored = one_way * plan.charge - plan.discharge / one_way
        share = -np.where(stored > 0.0, stored / one_way, stored * one_way)
        share[np.abs(share) < _TOLERANCE] = 0.0
        max_power = np.minimum(np.where(share < 0.0, *self._max_power), free[blocks.first])
        demand: Array = (
            self.power_kw
            * max_power[blocks.of_step]
            * blocks.at_full(np.clip(share / np.maximum(max_power, _TOLERANCE), -1.0, 1.0))
        )
        if connection is not None:
            connection.set_plan(step, demand)
        return demand

    def _program(
        self,
        price: Array,
        step: int,
        energy_kwh: float,
        blocks: Blocks,
        free: Array,
        *,
        discharged_today_kwh: float = 0.0,
        budget_price_eur_mwh: float = 0.0,
        remaining_kwh: float = np.inf,
        available_kwh: float = np.inf,
    ) -> StoreProgram:
        """Return the program in per unit: power over `power_kw`, energy over `power_kw` times 1 h.

        ``free`` is the :meth:`_free_share` of each block.
        """
        hours = np.asarray(blocks.count * self.dt_h, dtype=np.float64)
        days = self.days[step + blocks.first]
        per_unit, price = hours * self.weight(price), price[blocks.first]
        capacity_kwh = min(self.energy_kwh, available_kwh)
        program = StoreProgram(
            hours,
            float(np.sqrt(self.efficiency)),
            energy_kwh / self.power_kw,
            cost=(
                per_unit * (price + self._charge_fee),
                per_unit * (budget_price_eur_mwh + self._discharge_fee - price),
            ),
            max_power=(np.minimum(self._max_power[0], free), np.minimum(self._max_power[1], free)),
            capacity=capacity_kwh / self.power_kw,
        )
        if self.cycles_per_plan is None:
            numbers, row = np.unique(days, return_inverse=True)
            max_kwh = np.full(numbers.size, self.cycles_per_day * capacity_kwh)
            max_kwh[0] = max(0.0, max_kwh[0] - discharged_today_kwh)
            charged, discharged = 0.0 * hours, hours / np.sqrt(self.efficiency)
        else:
            row, max_kwh = np.zeros(days.size, np.int64), np.array([self.cycles_per_plan * capacity_kwh])
            charged, discharged = 0.5 * hours, 0.5 * hours
        program.at_most(
            max_kwh / self.power_kw, (program.charge, charged, row), (program.discharge, discharged, row)
        )
        if np.isfinite(remaining_kwh):
            drawn = hours / np.sqrt(self.efficiency)
            program.at_most(remaining_kwh / self.power_kw, (program.discharge, drawn))
        return program

    def weight(self, price: Array) -> float:
        """Cost in the program of an EUR/MWh over an hour at full power."""
        return 1.0 / (self.dt_h * (float(np.abs(price).max()) or 1.0))


def one_direction(program: StoreProgram, price_eur_mwh: Array) -> StoreSchedule:
    """Return an optimal schedule that does not charge and discharge in the same step."""
    plan = program.solve()
    negative = np.flatnonzero(price_eur_mwh < 0.0)
    if np.minimum(plan.charge, plan.discharge)[negative].max(initial=0.0) > _TOLERANCE:
        program.forbid_both_directions(negative)
        plan = program.solve()
    return plan


def calendar_days(index: pd.DatetimeIndex, time_zone: str | tzinfo) -> npt.NDArray[np.int64]:
    """Return the number of the local calendar day of each time, ascending; index is time-zone aware."""
    local = index.tz_convert(time_zone).tz_localize(None)
    return local.normalize().to_numpy().astype("datetime64[D]").astype(np.int64)
