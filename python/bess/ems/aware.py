"""Dispatch that asks the plant: linear programs around its roll-out, until the plan is what it can do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from bess.display import as_table, one_line
from bess.ems.aggregate import Aggregate, Curve, Rolled
from bess.ems.bank_choice import Depths, banks_of
from bess.ems.blocks import Blocks
from bess.ems.store_program import Banks, Numbers, Pieces, StoreProgram
from bess.numbers import Array, ByValue
from bess.parameters import State, System
from bess.parameters.terms import Terms
from bess.units import KWH_PER_MWH
from bess.wear import MarginalWear, WearRates

_PROGRAMS: Final = 3
"""Most linear programs of a plan, each with the coefficients of the roll-out before it."""

_SETTLED: Final = 0.01
"""Change of the resistance that is not worth another program, where nothing is derated."""

_TOWARDS: Final = 0.9
"""Share of the way from the derated power of a program to that of its roll-out: not all of it, so that the
hot hours do not swap places for ever."""

_LEAST: Final = 1e-6
"""Share of the plant's power below which nothing is asked for, or missing."""

_REGULAR_SOC: Final = 0.15
"""The deep banks have a resistance of their own; that of the pieces is taken at this SOC or above."""

_NEVER_EUR_KWH: Final = -1e3
"""Income of a kWh discharged at a negative price: it is not planned, as it would pay to burn energy."""


@dataclass(frozen=True, eq=False)
class DispatchPlan(ByValue):
    """What to ask of a plant, and what it is expected to make of it. Powers are kW, positive = discharge.

    Attributes
    ----------
    demand_kw : ndarray, shape (n_steps,)
        Power to ask for.
    expected_delivered_kw : ndarray, shape (n_steps,)
        Power that the control model delivers.
    expected_net_eur : float
        Net income by the terms of settlement, wear included; what is left in store is not counted.
    expected_energy_kwh : ndarray, shape (n_steps,)
        Energy above the lower SOC limits at the end of each step.
    expected_temperature_c : ndarray, shape (n_steps,)
        Mean temperature at the end of each step.
    """

    demand_kw: Array
    expected_delivered_kw: Array
    expected_net_eur: float
    expected_energy_kwh: Array
    expected_temperature_c: Array

    def _facts(self) -> dict[str, str]:
        return {
            "steps": str(self.demand_kw.size),
            "power": f"{self.demand_kw.min():.3g} to {self.demand_kw.max():.3g} kW",
            "expected net": f"{self.expected_net_eur:.2f} EUR",
        }

    __repr__ = one_line
    _repr_html_ = as_table


@dataclass(frozen=True)
class Outlook:
    """What a plan is made for; arrays of shape ``(n_steps,)``.

    Attributes
    ----------
    price_eur_mwh, ambient_c : ndarray
        Prices and ambient temperatures ahead.
    day : ndarray of int
        Number of the trading day of each step, ascending.
    discharged_kwh : float
        Stored energy discharged on the first of these days so far.
    is_last : bool
        Whether the run ends with the plan; what is left in store then is worth nothing.
    """

    price_eur_mwh: Array
    ambient_c: Array
    day: npt.NDArray[np.int64]
    discharged_kwh: float = 0.0
    is_last: bool = False


class AwareDispatch:
    """Plans what a plant can deliver, and at what cost.

    The bundled study ``model-accuracy`` repeats the comparison of [1]_ with it. Wear by depth of cycle can be
    part of the program because the cost of cycles counted by rainflow is convex in the profile [2]_.

    Every plan is a linear program of the plant as one store (:class:`bess.ems.store_program.StoreProgram`):
    losses over power with the best share among the strings, resistance over SOC and temperature, heat and
    derating, fees, wear by depth of cycle, the price of a shortfall. The plan is rolled out with the control
    model; resistance and derating are taken from there and the program is solved again. The roll-out that
    earns most is the plan, less what full or empty strings could not take. It depends on its arguments alone,
    to the last bit.

    Parameters
    ----------
    system : System
        The plant; its sections ``[wear]`` price the wear.
    dt_h : float
        Control step [h].
    terms : Terms
        Fees and the price of a shortfall.
    max_power_kw, max_energy_kwh : float or None
        Keep below what the plant has.
    cycles_per_day : float
        Most full cycles a day: discharged stored energy over that of the plant.
    cycles_per_plan : float or None
        Instead of the former: most full cycles of each plan, the mean of charged and discharged AC energy
        over the energy of the plant.
    end_price_eur_mwh : float or None
        What a MWh left in store at the end of a plan is worth; None takes the median price of buying, or what
        the best tenth of prices brings if that is less.

    References
    ----------
    .. [1] Cornejo et al.: Evaluating the impact of model accuracy for optimizing battery energy storage
       systems. arXiv:2506.17059.
    .. [2] arXiv:1703.07968, on the convexity of rainflow cost in the profile.
    """

    def __init__(
        self,
        system: System,
        dt_h: float,
        terms: Terms,
        *,
        max_power_kw: float | None = None,
        max_energy_kwh: float | None = None,
        cycles_per_day: float = 2.0,
        cycles_per_plan: float | None = None,
        end_price_eur_mwh: float | None = None,
    ):
        self._system, self._dt_h, self._terms = system, dt_h, terms
        self._max_power_kw, self._max_energy_kwh = max_power_kw or np.inf, max_energy_kwh or np.inf
        self._end_price_eur_mwh = end_price_eur_mwh
        self._cycles_per_day, self._cycles_per_plan = cycles_per_day, cycles_per_plan
        self._wear = WearRates(system)
        self._plant: Aggregate | None = None

    def plan(self, outlook: Outlook, state: State, *, limit_kw: Array | None = None) -> DispatchPlan:
        """Return the plan that earns most, as far as it was found.

        Parameters
        ----------
        outlook : Outlook
            Prices and temperatures ahead.
        state : State
            Measured state.
        limit_kw : ndarray, shape (n_strings,), optional
            Power of each inverter in service, taken to stay so.
        """
        limit = self._system.nominal_kw if limit_kw is None else limit_kw
        if not limit.any():
            return _nothing(outlook, state)
        plant = self._aggregate(state, limit)
        task = _Task.of(
            plant, self._terms, outlook, state, self._wear.at(state),
            power_kw=min(self._max_power_kw, plant.power_kw),
            energy_kwh=min(self._max_energy_kwh, plant.capacity_kwh),
            cycles_per_day=self._cycles_per_day,
            cycles_per_plan=self._cycles_per_plan,
            end_price_eur_mwh=self._end_price_eur_mwh,
        )  # fmt: skip
        return task.solved()

    def condition(self, state: State, limit_kw: Array) -> tuple[float, float, float]:
        """Return stored energy above the lower SOC limits and capacity [kWh], and mean temperature [degC]."""
        plant = self._aggregate(state, limit_kw)
        energy_kwh, temperature_c = plant.energy_kwh(state.soc), plant.mean_c(state.temperature_c)
        return float(energy_kwh), plant.capacity_kwh, float(temperature_c)

    def _aggregate(self, state: State, limit_kw: Array) -> Aggregate:
        """The plant as it is now; kept until strings fail or have aged by a thousandth."""
        if self._plant is None or not self._plant.fits(state, limit_kw):
            self._plant = Aggregate(self._system, self._dt_h, state, limit_kw)
        return self._plant


def _nothing(outlook: Outlook, state: State) -> DispatchPlan:
    nothing = np.zeros(outlook.price_eur_mwh.size)
    return DispatchPlan(nothing, nothing, 0.0, nothing, nothing + state.temperature_c.mean())


@dataclass(frozen=True)
class _Task:
    """One plan to be made; derating applies to no more than ``most_derated_kw``."""

    plant: Aggregate
    terms: Terms
    outlook: Outlook
    state: State
    power_kw: float
    blocks: Blocks
    depths: Depths
    banks: Banks
    most_derated_kw: float
    numbers: Numbers

    @classmethod
    def of(
        cls,
        plant: Aggregate,
        terms: Terms,
        outlook: Outlook,
        state: State,
        wear: MarginalWear,
        *,
        power_kw: float,
        energy_kwh: float,
        cycles_per_day: float,
        cycles_per_plan: float | None,
        end_price_eur_mwh: float | None,
    ) -> _Task:
        blocks = Blocks.of(outlook.price_eur_mwh, outlook.day, plant.dt_h)
        price, n_blocks = outlook.price_eur_mwh[blocks.first], blocks.first.size
        depths = Depths.of(plant, wear)
        banks = banks_of(plant, depths, energy_kwh)
        buy = terms.charge_price_eur_mwh(price) / KWH_PER_MWH
        sell = terms.discharge_price_eur_mwh(price) / KWH_PER_MWH - depths.by_energy_eur_kwh
        days = int(outlook.day[-1] - outlook.day[0]) + 1
        allowed = np.full(days, cycles_per_day * energy_kwh if cycles_per_plan is None else np.inf)
        allowed[0] = max(0.0, allowed[0] - outlook.discharged_kwh)
        most_kwh = np.inf if cycles_per_plan is None else cycles_per_plan * energy_kwh
        if outlook.is_last:
            end_eur = 0.0
        elif end_price_eur_mwh is not None:
            end_eur = end_price_eur_mwh / KWH_PER_MWH
        else:
            end_eur = _value_of_store(buy, sell - depths.marginal_eur_kwh.mean())
        most_derated_kw = _most_derated_kw(plant, outlook, state)
        numbers = Numbers(
            charge_eur=buy,
            discharge_eur=np.where(sell < 0.0, _NEVER_EUR_KWH, sell),
            shortfall_eur=terms.shortfall_price_eur_mwh(price) / KWH_PER_MWH,
            holding_eur=depths.holding_eur_kwh_h,
            end_eur=end_eur,
            heat_charge=np.ones(n_blocks),
            heat_discharge=np.ones(n_blocks),
            energy_kwh=_in_banks(banks, float(plant.energy_kwh(state.soc))),
            temperature_c=float(plant.mean_c(state.temperature_c)),
            ambient_c=blocks.mean(outlook.ambient_c),
            derated_kw=np.full(n_blocks, min(0.5 * power_kw, most_derated_kw)),
            allowed_kwh=allowed,
            throughput_kwh=most_kwh,
        )
        return cls(plant, terms, outlook, state, power_kw, blocks, depths, banks, most_derated_kw, numbers)

    def solved(self) -> DispatchPlan:
        """Solve and roll out in turn; keep the roll-out that earns most."""
        plant, numbers = self.plant, self.numbers
        charge, discharge = (_pieces(points) for points in plant.rising)
        program = StoreProgram(
            plant.dt_h, self.blocks.count, charge, discharge, self.banks,
            power_kw=self.power_kw, stored_per_charged=plant.stored_per_charged,
            warming_k_per_kwh=plant.warming_k_per_kwh, cooling_per_h=plant.cooling_per_h,
            tangents=plant.derated_lines, tapers=plant.tapers,
            day=self.outlook.day[self.blocks.first],
        )  # fmt: skip
        best_eur, best = -np.inf, _nothing(self.outlook, self.state)
        rolled: Rolled | None = None
        for _ in range(_PROGRAMS):
            if rolled is not None:
                before, numbers = numbers, self._after(numbers, rolled)
                if self._is_settled(before, numbers, rolled):
                    break
            charge_kw, discharge_kw = program.solve(numbers)
            demand_kw = self.blocks.spread(discharge_kw - charge_kw, plant.curves)
            demand_kw[np.abs(demand_kw) < _LEAST * self.power_kw] = 0.0
            rolled = plant.roll_out(self.state, demand_kw, self.outlook.ambient_c)
            plan, value_eur = self._valued(rolled)
            if value_eur > best_eur:
                best_eur, best = value_eur, plan
        return best

    def _after(self, numbers: Numbers, rolled: Rolled) -> Numbers:
        """Resistance and derated power as the roll-out had them."""
        soc, temperature_c = (
            self.blocks.mean(0.5 * (ends[:, 1:] + ends[:, :-1]))
            for ends in (rolled.soc, rolled.temperature_c)
        )
        charge, discharge = self.plant.resistance_factor(np.maximum(soc, _REGULAR_SOC), temperature_c)
        return replace(
            numbers,
            heat_charge=charge,
            heat_discharge=discharge,
            derated_kw=np.minimum(
                (1.0 - _TOWARDS) * numbers.derated_kw
                + _TOWARDS * self.blocks.mean(np.abs(rolled.delivered_kw)),
                self.most_derated_kw,
            ),
        )

    def _is_settled(self, before: Numbers, after: Numbers, rolled: Rolled) -> bool:
        """Whether a program with the numbers of the roll-out would be the one before it."""
        slope, offset = self.plant.derated_lines.T
        if (slope * float(rolled.temperature_c.max()) + offset).max() > 0.0:
            return False
        pairs = ((before.heat_charge, after.heat_charge), (before.heat_discharge, after.heat_discharge))
        return all(bool((np.abs(new - old) <= _SETTLED * old).all()) for old, new in pairs)

    def _valued(self, rolled: Rolled) -> tuple[DispatchPlan, float]:
        """The plan of a roll-out, and what it is worth with what is left in store [EUR]."""
        terms, price, dt_h = self.terms, self.outlook.price_eur_mwh, self.plant.dt_h
        demand_kw, delivered_kw = rolled.demand_kw, rolled.delivered_kw
        sold_kw, bought_kw = np.maximum(delivered_kw, 0.0), np.maximum(-delivered_kw, 0.0)
        missing_kw = np.maximum(np.abs(demand_kw) - np.abs(delivered_kw), 0.0)
        eur_per_h = (
            sold_kw * terms.discharge_price_eur_mwh(price)
            - (bought_kw + rolled.standby_kw) * terms.charge_price_eur_mwh(price)
            - missing_kw * terms.shortfall_price_eur_mwh(price)
        ) / KWH_PER_MWH
        wear_eur = self.depths.cost_eur(sold_kw * dt_h, rolled.energy_kwh, dt_h)
        net_eur = float(eur_per_h.sum()) * dt_h - wear_eur - terms.start_eur * rolled.starts
        plan = DispatchPlan(
            demand_kw,
            delivered_kw,
            net_eur,
            rolled.energy_kwh[1:],
            self.plant.mean_c(rolled.temperature_c[:, 1:]),
        )
        return plan, net_eur + self.numbers.end_eur * float(rolled.energy_kwh[-1])


def _most_derated_kw(plant: Aggregate, outlook: Outlook, state: State) -> float:
    """Largest power to which derating may apply if a plant that rests is to remain a plan, however hot."""
    hottest_c = max(float(plant.mean_c(state.temperature_c)), float(outlook.ambient_c.max()))
    slope, offset = plant.derated_lines.T
    return plant.power_kw / max(1.0, float(np.max(slope * hottest_c + offset)))


def _value_of_store(buy_eur_kwh: Array, sell_eur_kwh: Array) -> float:
    """What a kWh is worth that is left at the end of a plan: no more than it costs to buy, or brings."""
    return max(0.0, min(float(np.quantile(buy_eur_kwh, 0.5)), float(np.quantile(sell_eur_kwh, 0.9))))


def _in_banks(banks: Banks, energy_kwh: float) -> Array:
    below = np.cumsum(banks.size_kwh[::-1])[::-1] - banks.size_kwh
    return np.asarray(np.clip(energy_kwh - below, 0.0, banks.size_kwh))


def _pieces(points: Curve) -> Pieces:
    width_kw = np.diff(points.power_kw)
    return Pieces(width_kw, np.diff(points.inverter_kw) / width_kw, np.diff(points.heat_kw) / width_kw)
