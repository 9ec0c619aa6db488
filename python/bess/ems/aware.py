"""Dispatch that asks the plant: linear programs around its roll-out, until the plan is what it can do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from bess.ems.aggregate import CHARGE, DISCHARGE, Aggregate, Curve, Rolled
from bess.ems.store_program import Banks, Numbers, Pieces, StoreProgram
from bess.parameters import State, System
from bess.parameters.terms import Terms

Array = npt.NDArray[np.float64]

_PIECES: Final = 5
"""Pieces of the loss curve in each direction."""
_ITERATIONS: Final = 3
"""Linear programs a plan at most."""
_DEEP_SHARE: Final = 0.6
"""Share of power at which the heat of deep banks is taken."""
_KWH_PER_MWH: Final = 1000.0
_NEVER_EUR_KWH: Final = -1e3
"""Income of discharging where it costs money: there it is never planned."""


@dataclass(frozen=True)
class DispatchPlan:
    """What to ask of a plant, and what it is expected to make of it. Powers are kW, positive = discharge.

    Attributes
    ----------
    demand_kw : ndarray, shape (n_steps,)
        Power to ask for.
    expected_delivered_kw : ndarray, shape (n_steps,)
        Power that the control model delivers.
    expected_net_eur : float
        Income of the plan by the terms of settlement, without the value of what is left in store.
    expected_energy_kwh : ndarray, shape (n_steps,)
        Stored above the lower SOC limits at the end of each step.
    """

    demand_kw: Array
    expected_delivered_kw: Array
    expected_net_eur: float
    expected_energy_kwh: Array


@dataclass(frozen=True)
class Outlook:
    """What a plan is made for; arrays of shape ``(n_steps,)``.

    Attributes
    ----------
    price_eur_mwh, ambient_c : ndarray
        Prices and ambient temperatures ahead.
    day : ndarray of int
        Number of the trading day of each step, ascending.
    allowed_kwh : ndarray, shape (n_days,)
        Stored energy that may still be discharged on each of these days.
    """

    price_eur_mwh: Array
    ambient_c: Array
    day: npt.NDArray[np.int64]
    allowed_kwh: Array


class AwareDispatch:
    """Plans what a plant can deliver, at what it costs."""

    def __init__(self, system: System, dt_h: float, terms: Terms, limit_kw: Array, *, power_kw: float, energy_kwh: float):
        self._plant = Aggregate(system, dt_h, limit_kw)
        self._dt_h, self._terms = dt_h, terms
        self._power_kw = min(power_kw, self._plant.power_kw)
        self._energy_kwh = min(energy_kwh, self._plant.capacity_kwh)
        self._pieces = tuple(_pieces(curve.convex_points(_PIECES)) for curve in self._plant.curves)
        self._banks = self._deep_banks()
        self._tangents = _tangents(*self._plant.derating())

    def plan(self, outlook: Outlook, state: State) -> DispatchPlan:
        plant = self._plant
        steps = outlook.price_eur_mwh.size
        program = StoreProgram(
            self._dt_h, self._pieces[CHARGE], self._pieces[DISCHARGE], self._banks,
            power_kw=self._power_kw, stored_per_charged=plant.stored_per_charged,
            warming_k_per_kwh=plant.warming_k_per_kwh, cooling_per_h=plant.cooling_per_h,
            tangents=self._tangents, day=outlook.day,
        )
        numbers = self._first_numbers(outlook, state)
        best = None
        for _ in range(_ITERATIONS):
            charge, discharge = program.solve(numbers)
            demand = discharge - charge
            demand[np.abs(demand) < 1e-6 * self._power_kw] = 0.0
            rolled = plant.roll_out(state, demand, outlook.ambient_c)
            for _ in range(2):
                candidate = self._valued(outlook, demand, rolled, numbers.end_eur)
                if best is None or candidate[0] > best[0] + 1e-9:
                    best = candidate
                demand = demand - np.sign(demand) * rolled.availability_kw
                if not np.any(rolled.availability_kw > 1e-6 * self._power_kw):
                    break
                rolled = plant.roll_out(state, demand, outlook.ambient_c)
            numbers = self._next_numbers(numbers, rolled)
        return best[1]

    def _first_numbers(self, outlook: Outlook, state: State) -> Numbers:
        plant, terms = self._plant, self._terms
        price, steps = outlook.price_eur_mwh, outlook.price_eur_mwh.size
        soc = np.full((plant.system.n_strings, 1), 0.5)
        charge, discharge = plant.resistance_factor(np.clip(soc, plant.soc_min[:,None], plant.soc_max[:,None]), np.full_like(soc, 35.0))
        buy = terms.charge_price_eur_mwh(price) / _KWH_PER_MWH
        sell = (terms.discharge_price_eur_mwh(price) - terms.wear_eur_mwh) / _KWH_PER_MWH
        held = float(plant.energy_kwh(state.soc))
        return Numbers(
            charge_eur=buy,
            discharge_eur=np.where(sell < 0.0, _NEVER_EUR_KWH, sell),
            shortfall_eur=terms.shortfall_price_eur_mwh(price) / _KWH_PER_MWH,
            end_eur=max(0.0, float(np.quantile(buy, 0.25))),
            heat_charge=np.repeat(charge, steps),
            heat_discharge=np.repeat(discharge, steps),
            energy_kwh=self._in_banks(held),
            temperature_c=float(plant.mean_c(state.temperature_c)),
            warming_k=plant.cooling_per_h * self._dt_h * outlook.ambient_c,
            derated_kw=np.full(steps, 0.5 * self._power_kw),
            allowed_kwh=outlook.allowed_kwh,
        )

    def _deep_banks(self) -> Banks:
        size, factor = self._plant.deep_banks()
        size[0] -= self._plant.capacity_kwh - self._energy_kwh
        charge, discharge = (
            (factor - factor[0]) * np.interp(_DEEP_SHARE * self._plant.power_kw, curve.power_kw, curve.heat_kw)
            / (_DEEP_SHARE * self._plant.power_kw)
            for curve in self._plant.curves
        )
        return Banks(size, charge, discharge, np.zeros(size.size))

    def _in_banks(self, energy_kwh: float) -> Array:
        size = self._banks.size_kwh
        below = np.cumsum(size[::-1])[::-1] - size
        return np.clip(energy_kwh - below, 0.0, size)

    def _next_numbers(self, numbers: Numbers, rolled: Rolled) -> Numbers:
        soc = np.maximum(0.5 * (rolled.soc[:, 1:] + rolled.soc[:, :-1]), 0.15)
        temperature = 0.5 * (rolled.temperature_c[:, 1:] + rolled.temperature_c[:, :-1])
        charge, discharge = self._plant.resistance_factor(soc, temperature)
        return replace(
            numbers,
            heat_charge=charge,
            heat_discharge=discharge,
            derated_kw=0.5 * (numbers.derated_kw + np.abs(rolled.delivered_kw)),
        )

    def _valued(self, outlook: Outlook, demand: Array, rolled: Rolled, end_eur: float) -> tuple[float, DispatchPlan]:
        terms, price = self._terms, outlook.price_eur_mwh
        delivered = rolled.delivered_kw
        sold, bought = np.maximum(delivered, 0.0), np.maximum(-delivered, 0.0)
        missing = np.maximum(np.abs(demand) - np.abs(delivered), 0.0)
        eur_per_h = (
            sold * (terms.discharge_price_eur_mwh(price) - terms.wear_eur_mwh)
            - (bought + rolled.standby_kw) * terms.charge_price_eur_mwh(price)
            - missing * terms.shortfall_price_eur_mwh(price)
        )
        net_eur = float(eur_per_h.sum()) * self._dt_h / _KWH_PER_MWH
        plan = DispatchPlan(demand, delivered, net_eur, rolled.energy_kwh[1:])
        return net_eur + end_eur * float(rolled.energy_kwh[-1]), plan


def _pieces(curve: Curve) -> Pieces:
    width = np.diff(curve.power_kw)
    return Pieces(width, np.diff(curve.inverter_kw) / width, np.diff(curve.heat_kw) / width)


def _tangents(temperature_c: Array, factor: Array) -> Array:
    """Lines ``a tau + b`` of which the largest is at least what derating takes, shape ``(n, 2)``."""
    lost = 1.0 - factor
    start = int(np.flatnonzero(lost <= 0.0)[-1]) if np.any(lost <= 0.0) else 0
    end = int(np.argmax(lost))
    knots = np.unique(np.round(np.linspace(start, end, 4)).astype(int))
    slope = np.diff(lost[knots]) / np.diff(temperature_c[knots])
    return np.stack([slope, lost[knots[:-1]] - slope * temperature_c[knots[:-1]]], axis=1)
