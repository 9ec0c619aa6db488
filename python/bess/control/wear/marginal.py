"""Marginal wear cost of cycling and of time at the present state of a string."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from bess import _core
from bess.arrays import Array, ByValue, finite_array
from bess.control.wear.prices import WearPrices
from bess.errors import InputError
from bess.system import State, System
from bess.system.state import TEMPERATURE_RANGE_C
from bess.system.system import check_system

_RANGES: Final = {
    "depth": (0.0, 1.0),
    "soc": (0.0, 1.0),
    "c_rate": (0.0, 100.0),
    "temperature_c": TEMPERATURE_RANGE_C,
}


@dataclass(frozen=True, eq=False)
class MarginalWear(ByValue):
    """Marginal wear cost at one state of every string, to be used as constants over a step or a plan.

    The cell models are those of [1]_, [2]_, [3]_, [4]_ and [5]_; half cycles are counted as in [6]_.

    The rates are constant, so a cost based on them is linear in throughput and in time. Arguments of the
    methods broadcast against ``(n_strings, n_points)``: a number, one row of points for all strings, or one
    column such as ``state.temperature_c[:, None]`` with a value for each string. Results have the broadcast
    shape. Rates follow the cell model of the string (``docs/ageing.md``); they are 0 for ``none`` and
    constant for ``throughput``. The knee of ``kokam-75ah`` is not included.

    Attributes
    ----------
    state : State
        State at which the rates are evaluated.
    calendar_loss, cyclic_loss : ndarray, shape (n_strings,)
        Capacity loss by calendar and by cycle ageing so far, relative to the nameplate.
    prices : WearPrices
        Prices of the strings.
    nominal_energy_kwh, capacity_ah : ndarray, shape (n_strings,)
        Energy and charge capacity of each string when new.
    core : _core.Ageing
        The cell models.

    References
    ----------
    .. [1] Smith et al.: American Control Conference 2017, IEEE Xplore 7963578 (``kokam-75ah``, as in
       BLAST-Lite).
    .. [2] J. Energy Storage (2023), doi:10.1016/j.est.2023.109042 (``nmc-a-75ah``, as in BLAST-Lite).
    .. [3] Schmalstieg, J., et al.: J. Power Sources 257 (2014) 325, doi:10.1016/j.jpowsour.2014.02.012
       (``schmalstieg``).
    .. [4] Naumann, M., et al.: J. Energy Storage 17 (2018), doi:10.1016/j.est.2018.01.019 (``naumann-lfp``,
       calendar ageing).
    .. [5] Naumann, M., et al.: J. Power Sources (2020), doi:10.1016/j.jpowsour.2019.227666 (``naumann-lfp``,
       cycle ageing).
    .. [6] ASTM E1049-85: Standard practices for cycle counting in fatigue analysis.
    """

    state: State
    calendar_loss: Array
    cyclic_loss: Array
    prices: WearPrices
    nominal_energy_kwh: Array
    capacity_ah: Array
    core: _core.Ageing

    def cycling_eur_kwh(
        self, depth: ArrayLike, temperature_c: ArrayLike, *, c_rate: ArrayLike = 0.3, soc: ArrayLike = 0.5
    ) -> Array:
        """Return the wear cost of discharged energy [EUR/kWh], including the preceding charge.

        It is ``dQ/dEFC * replacement_eur_kwh / (1 - end_of_life)``, divided by the state of health, because
        one equivalent full cycle (EFC) discharges the present capacity of the string.

        Parameters
        ----------
        depth
            Cycle depth, 0 to 1.
        temperature_c
            Temperature [degC].
        c_rate
            Mean C-rate of the cycle [1/h].
        soc
            Mean SOC of the cycle.
        """
        energy_kwh = (self.nominal_energy_kwh * self.state.soh_capacity)[:, None]
        by_energy = self.prices.eur_per_kwh_discharged[:, None]
        return self._eur_per_cycle(depth, temperature_c, c_rate, soc) / energy_kwh + by_energy

    def cycling_eur_ah(
        self, depth: ArrayLike, temperature_c: ArrayLike, *, c_rate: ArrayLike = 0.3, soc: ArrayLike = 0.5
    ) -> Array:
        """Return the wear cost of charge throughput in either direction [EUR/Ah].

        Arguments are those of :meth:`cycling_eur_kwh`. This form suits objectives over currents: charge and
        discharge each bear half of the cycle cost.
        """
        per_cycle = self._eur_per_cycle(depth, temperature_c, c_rate, soc)
        energy_kwh = self.nominal_energy_kwh * self.state.soh_capacity
        per_cycle = per_cycle + (self.prices.eur_per_kwh_discharged * energy_kwh)[:, None]
        return np.asarray(per_cycle / (2.0 * self.capacity_ah * self.state.soh_capacity)[:, None])

    def calendar_eur_day(self, soc: ArrayLike, temperature_c: ArrayLike) -> Array:
        """Return the wear cost of a day at a SOC and temperature [EUR/day]."""
        rate = self.core.calendar_rate
        return self._eur(rate, self.calendar_loss, soc=soc, temperature_c=temperature_c)

    def _eur_per_cycle(
        self, depth: ArrayLike, temperature_c: ArrayLike, c_rate: ArrayLike, soc: ArrayLike
    ) -> Array:
        points = {"depth": depth, "soc": soc, "c_rate": c_rate, "temperature_c": temperature_c}
        return self._eur(self.core.cyclic_rate, self.cyclic_loss, **points)

    def _eur(self, rate: Callable[..., Array], loss: Array, **values: ArrayLike) -> Array:
        """Cost of a rate of capacity loss at given points."""
        points = [finite_array(f"wear: {name}", each) for name, each in values.items()]
        for name, point in zip(values, points, strict=True):
            low, high = _RANGES[name]
            if outside := point[(point < low) | (point > high)].tolist():
                raise InputError(f"wear: {name} {outside[0]:g} is outside [{low:g}, {high:g}]")
        try:
            shape = np.broadcast(*points, np.empty((self.state.n_strings, 1))).shape
            strings, _points = shape
        except ValueError:
            strings = None
        if strings != self.state.n_strings:
            shapes = ", ".join(f"{name} {point.shape}" for name, point in zip(values, points, strict=True))
            raise InputError(
                f"wear: values must broadcast against ({self.state.n_strings} strings, points), not {shapes}"
            )
        if not self.prices.eur_per_loss.any():  # no string has a cell model
            return np.zeros(shape)
        points = [np.ascontiguousarray(np.broadcast_to(point, shape)) for point in points]
        return rate(loss, *points) * self.prices.eur_per_loss[:, None]


def marginal(system: System, state: State) -> MarginalWear:
    """Return the marginal wear of every string at ``state``.

    See :class:`MarginalWear` for models and sources.

    Parameters
    ----------
    system
        The plant; its sections ``[wear]`` set the models and prices.
    state
        Measured state. The loss so far is ``1 - soh_capacity``. Its cyclic part is ``cyclic_loss`` or, if the
        state does not contain it, ``1 - wear.calendar_share`` of the loss.

    Returns
    -------
    MarginalWear
        ``cycling_eur_kwh(depth, temperature_c)``, ``cycling_eur_ah(depth, temperature_c)`` and
        ``calendar_eur_day(soc, temperature_c)``.

    Raises
    ------
    InputError
        ``system`` is none, or ``state`` does not fit it.

    Examples
    --------
    >>> import bess
    >>> from bess.control import wear
    >>> document = bess.System.reference().document | {"wear": {"model": "kokam-75ah"}}
    >>> system = bess.System(document)
    >>> state = bess.State([0.5, 0.5], [25.0, 35.0], soh_capacity=[0.95, 0.95])
    >>> now = wear.marginal(system, state)
    >>> now.cycling_eur_kwh(0.8, state.temperature_c[:, None]).round(3).ravel().tolist()
    [0.029, 0.063]
    """
    return WearRates(system).at(state)


class WearRates:
    """Computes the marginal wear of one plant at successive states.

    ``depend_on_state``: whether a string has a cell model; other prices of energy are constant.
    """

    def __init__(self, system: System) -> None:
        check_system(system)
        self._system = system
        self._prices = WearPrices.of(system)
        self._share = np.array([string.wear.calendar_share for string in system.strings])
        self._core = _core.Ageing(system.core)
        self.depend_on_state = bool(self._prices.eur_per_loss.any())

    def at(self, state: State) -> MarginalWear:
        """Return the rates at ``state``; see :func:`marginal`."""
        self._system.check_state(state)
        lost = np.maximum(1.0 - state.soh_capacity, 0.0)
        cyclic = (1.0 - self._share) * lost if state.cyclic_loss is None else state.cyclic_loss
        return MarginalWear(
            state=state,
            calendar_loss=np.maximum(lost - cyclic, 0.0),
            cyclic_loss=cyclic,
            prices=self._prices,
            nominal_energy_kwh=self._system.nominal_energy_kwh,
            capacity_ah=self._system.capacity_ah,
            core=self._core,
        )
