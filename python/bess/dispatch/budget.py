"""Annual budgets of cycles and throughput, and their shadow price."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array, finite_array, number_array, require_positive
from bess.checkpoints import Checkpointed
from bess.dispatch.forecast import Forecast
from bess.dispatch.store_value import store_value
from bess.errors import InputError
from bess.system import State
from bess.units import HOURS_PER_DAY, KWH_PER_MWH

_USE_GROWTH: Final = 0.85
"""Growth of the planned use over a year: at its end, ``exp`` of this value times that at its start.

Future prices are unknown. A reserve of cycles gains more if prices rise than it loses if they stay. This is
about the largest value for which an ideal store earns 95 % of the optimum of a known year in Germany 2018,
2019, 2023, Portugal 2024 and Hungary 2022, 2023; the tests use other years.
"""

_RECENT_DAYS: Final = 3.0
"""Days are weighted by the inverse of their age plus this value."""

_MIN_DAILY_USE: Final = 0.05
"""Minimum use planned for a day, as a share of the mean use."""

_MAX_DAYS: Final = 366

_MAX_STEP_SHARE: Final = 0.5
"""Maximum share of the remaining budget that one step may use."""

_MIN_POWER: Final = 0.05
"""Minimum power as a share of plant power; below it the plant is off, because losses exceed the delivery."""


class CycleBudget(Checkpointed):
    r"""Remaining cycles and throughput of each year of a run, and their shadow price.

    A full cycle is the nominal energy, charged to or discharged from the cells, whichever sum is larger so
    far; the energy of a string is its present nominal energy times the change of its SOC. Throughput is
    discharged energy (AC). A year that the run covers in part has this part of the budget. Unused budget
    expires at the end of a year.

    Once a day a linear program (:func:`bess.store_value`, with fees and wear) over the known prices gives the
    marginal value :math:`\mu_d` of a cycle for the planned use :math:`r_d`. With weights :math:`w_d` that
    decrease with age, the shadow price is

    .. math:: \lambda = \frac{\sum_d w_d\, r_d\, \mu_d}{r \sum_d w_d},\qquad
       r = B\,\frac{k}{e^{k \tau} - 1} ,

    where :math:`B` is the remaining budget and :math:`\tau` the remaining time of the year [years]. The price
    follows the market, and rises if more than the planned use was spent. It is 0 while the daily limit alone
    keeps the budget.

    Parameters
    ----------
    prices : Forecast
        Prices ahead [EUR/MWh].
    years : array of int, shape (n_years + 1,)
        First step of each year, and of the year after the run.
    n_steps : int
        Steps of the run, which may end within a year.
    cycles, throughput_kwh : float
        Budget of a whole year; infinite without a limit.
    nominal_kwh : ndarray, shape (n_strings,)
        Nominal energy of each string as in the system file.
    usable_kwh, power_kw, efficiency : float
        The plant as an ideal store: energy between the SOC limits, AC power, round-trip efficiency.
    size : callable or None
        Present ``power_kw`` and ``usable_kwh`` at a state, with the power of each inverter in service, as if
        they lasted; None if they do not change.
    look_ahead_steps : int
        Length of the price forecast [steps].
    dt_h : float
        Control step [h].
    daily_kwh : float
        Maximum stored energy that plans discharge each day at ``usable_kwh``; infinite without a limit.
    fees_eur_mwh : pair of float
        Fees on each MWh charged and discharged (AC), which plans include.
    wear_eur_mwh : callable or None
        Wear cost of a MWh discharged (AC), as far as plans include it; arguments as of ``size``.

    Raises
    ------
    InputError
        A limit, or an energy, is no number above 0.
    """

    _carried = (
        "_year", "_charged", "_discharged", "_discharged_kwh", "_bound_kwh", "_counted", "_soc", "_value_eur",
        "price_eur_mwh",
    )  # fmt: skip

    def __init__(
        self,
        prices: Forecast,
        years: NDArray[np.int64],
        n_steps: int,
        *,
        cycles: float,
        throughput_kwh: float,
        nominal_kwh: Array,
        usable_kwh: float,
        power_kw: float,
        efficiency: float,
        look_ahead_steps: int,
        dt_h: float,
        daily_kwh: float = np.inf,
        fees_eur_mwh: tuple[float, float] = (0.0, 0.0),
        wear_eur_mwh: Callable[[State, Array], float] | None = None,
        size: Callable[[State, Array], tuple[float, float]] | None = None,
    ):
        for name, limit in (
            ("cycles", cycles), ("throughput_kwh", throughput_kwh), ("daily_kwh", daily_kwh),
        ):  # fmt: skip
            if not number_array(f"budget: {name}", limit) > 0.0:
                raise InputError(f"budget: {name} {limit:g} must be above 0")
        nominal_kwh = finite_array("budget: nominal_kwh", nominal_kwh)
        if nominal_kwh.ndim != 1 or nominal_kwh.size == 0 or nominal_kwh.min() <= 0.0:
            raise InputError("budget: nominal_kwh must have one value above 0 for each string")
        require_positive(
            "budget",
            usable_kwh=(usable_kwh, " kWh"),
            power_kw=(power_kw, " kW"),
            efficiency=(efficiency, ""),
            dt_h=(dt_h, " h"),
        )
        self._cycles_per_day, self._fees_eur_mwh = daily_kwh / usable_kwh, fees_eur_mwh
        self._wear_eur_mwh = wear_eur_mwh or (lambda state, limit_kw: 0.0)
        self._size = size or (lambda state, limit_kw: (power_kw, usable_kwh))
        self._prices, self._year_steps = prices, np.diff(years)
        self._years = np.minimum(years, n_steps)
        self._cycles, self._throughput_kwh = cycles, throughput_kwh
        self._string_kwh, self._nominal_kwh = nominal_kwh, float(nominal_kwh.sum())
        self._power_kw = power_kw
        self._efficiency, self._one_way = efficiency, float(np.sqrt(efficiency))
        self._look_ahead_steps, self._dt_h = look_ahead_steps, dt_h
        self._day_steps = max(1, round(HOURS_PER_DAY / dt_h))
        self._year = 0
        self._charged, self._discharged, self._discharged_kwh = 0.0, 0.0, 0.0
        self._bound_kwh, self._counted = 0.0, 0
        self._soc: Array | None = None
        self._value_eur = np.zeros(0)
        self.price_eur_mwh = 0.0

    @property
    def cycles_used(self) -> float:
        """Full cycles of the year so far."""
        return max(self._charged, self._discharged)

    @property
    def remaining_kwh(self) -> float:
        """Stored energy that may still be discharged this year, without the energy reserved for a service."""
        share = self._share
        left_cycles = share * self._cycles - self.cycles_used
        remaining_kwh = share * self._throughput_kwh - self._discharged_kwh
        bound_kwh = self._bound_kwh / max(1, self._counted) * (self._years[self._year + 1] - self._counted)
        stored_kwh = min(left_cycles * self._nominal_kwh, remaining_kwh / self._one_way)
        return max(0.0, float(stored_kwh - bound_kwh / self._one_way))

    def advance(
        self,
        step: int,
        state: State,
        delivered_kw: float,
        service_kw: float = 0.0,
        limit_kw: Array | None = None,
    ) -> None:
        """Count the step before ``step``, which ended at ``state``, and update the price once a day.

        ``service_kw`` is the part of its delivered power (positive = discharge) that a service required; the
        same mean power is reserved for the rest of the year. ``limit_kw`` is the power of each inverter in
        service from ``step`` on, by default that of all.
        """
        self._bound_kwh += max(0.0, service_kw) * self._dt_h
        self._counted = step
        if self._soc is not None:
            present_kwh = self._string_kwh * state.soh_capacity
            cycles = (state.soc - self._soc) * present_kwh / self._nominal_kwh
            self._charged += float(np.maximum(cycles, 0.0).sum())
            self._discharged += float(np.maximum(-cycles, 0.0).sum())
            self._discharged_kwh += max(0.0, delivered_kw) * self._dt_h
        self._soc = state.soc.copy()
        if step == self._years[self._year + 1]:
            self._year += 1
            self._charged, self._discharged, self._discharged_kwh = 0.0, 0.0, 0.0
        if step % self._day_steps == 0:
            self._update_price(step, state, np.full(state.soc.size, np.inf) if limit_kw is None else limit_kw)

    def limited(self, demand_kw: Array) -> Array:
        """Limit a demand to the remaining budget."""
        share, per_cycle_kwh = self._share, _MAX_STEP_SHARE * self._nominal_kwh
        charge_kwh = per_cycle_kwh * (share * self._cycles - self._charged)
        discharge_kwh = min(
            per_cycle_kwh * (share * self._cycles - self._discharged),
            _MAX_STEP_SHARE * (share * self._throughput_kwh - self._discharged_kwh),
        )
        max_kw = np.array([charge_kwh, discharge_kwh]) / self._dt_h
        charge_kw, discharge_kw = np.where(max_kw < _MIN_POWER * self._power_kw, 0.0, max_kw)
        # Inverters supply small charging powers from the store: without a discharge budget the plant is off.
        charge_kw = charge_kw if discharge_kw > 0.0 else 0.0
        return np.asarray(np.clip(demand_kw, -charge_kw, discharge_kw))

    def for_plan(self) -> dict[str, float]:
        """Shadow price and remaining energy, as keywords of a plan."""
        return {"budget_price_eur_mwh": self.price_eur_mwh, "remaining_kwh": self.remaining_kwh}

    def recorded(self) -> dict[str, float]:
        """Shadow price and use, by variable of the record."""
        return {"budget_price_eur_mwh": self.price_eur_mwh, "budget_cycles": self.cycles_used}

    @property
    def _share(self) -> float:
        """Share of the year that the run covers."""
        return float(np.diff(self._years)[self._year] / self._year_steps[self._year])

    def _update_price(self, step: int, state: State, limit_kw: Array) -> None:
        """Compute the marginal value of a cycle on the known prices, and average it with earlier days.

        A plant that cannot trade keeps its price.
        """
        power_kw, usable_kwh = self._size(state, limit_kw)
        if power_kw <= 0.0 or usable_kwh <= 0.0:
            return
        left_years = (self._years[self._year + 1] - step) / self._year_steps[self._year]
        days = self._year_steps[self._year] / self._day_steps
        even = min(self._cycles * self._nominal_kwh, self._throughput_kwh / self._one_way) / days
        due = self.remaining_kwh / days * _USE_GROWTH / math.expm1(_USE_GROWTH * left_years)
        due = max(due, _MIN_DAILY_USE * even)
        price = self._prices.ahead(step, self._look_ahead_steps)
        cycles = due / usable_kwh * price.size / self._day_steps
        charge_fee, discharge_fee = self._fees_eur_mwh
        value = store_value(
            price,
            usable_kwh,
            power_kw,
            self._efficiency,
            cycles=cycles,
            dt_h=self._dt_h,
            fees_eur_mwh=(charge_fee, discharge_fee + self._wear_eur_mwh(state, limit_kw)),
        )
        value_eur = due * value.cycle_price_eur / usable_kwh
        self._value_eur = np.append(self._value_eur, value_eur)[-_MAX_DAYS:]
        weight = 1.0 / (_RECENT_DAYS + np.arange(self._value_eur.size)[::-1])
        eur_per_kwh = float(weight @ self._value_eur) / (due * float(weight.sum()))
        binds = self.remaining_kwh < self._cycles_per_day * usable_kwh * left_years * days
        self.price_eur_mwh = KWH_PER_MWH * eur_per_kwh / self._one_way if binds else 0.0
