"""Dispatch on the plant model: dynamic programs over the plant as one aggregate store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array, ByValue
from bess.control.wear import WearRates
from bess.dispatch.aggregate import Aggregate, DispatchRollout
from bess.dispatch.bands import PriceBands
from bess.dispatch.blocks import Blocks
from bess.dispatch.cycle_depth_cost import CycleDepthCost
from bess.dispatch.moves import Grid, Moves, Offer, StoreState
from bess.display import as_table, one_line
from bess.system import State, System
from bess.system.terms import SettlementTerms
from bess.units import KWH_PER_MWH

_LEAST: Final = 1e-6
"""Fraction of plant power below which the dispatch is zero."""

_FIRST_H: Final = 8.0
"""Time that is planned in short blocks [h]; a newer plan takes over before it has passed."""

_STEP_H: Final = 0.25
"""The longest of them [h]; later ones are longer (:class:`bess.dispatch.blocks.Blocks`)."""

_LADDER: Final = (0.0, 0.1, 0.2, 0.4, 0.7, 1.2)
"""Prices of what is cycled, over the largest price of energy, where cycles are limited."""

_ANY_KWH: Final = 1e12
"""More than any plant cycles: no limit."""

_NEVER_EUR_KWH: Final = -1e3
"""Income of a kWh discharged at a negative price: it is not planned, as it would pay to burn energy."""


@dataclass(frozen=True, eq=False)
class DispatchPlan(ByValue):
    """Demand schedule for a plant and its expected response; powers in kW, positive = discharge.

    Attributes
    ----------
    demand_kw : ndarray, shape (n_steps,)
        Planned demand.
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
class DispatchInputs:
    """Inputs of a plan; arrays of shape ``(n_steps,)``.

    Attributes
    ----------
    price_eur_mwh, ambient_c : ndarray
        Known or expected prices, and ambient temperatures.
    day : ndarray of int
        Number of the trading day of each step, ascending.
    discharged_kwh : float
        Stored energy discharged on the first of these days so far.
    is_last : bool
        Whether the run ends with the plan; what is left in store then is worth nothing.
    use_eur_mwh : float
        Price of each MWh discharged beside wear: the shadow price of a budget. It is planned with, not paid.
    left_kwh : float
        Stored energy that may still be discharged in all.
    bands : PriceBands or None
        Levels of prices that are not known, with ``price_eur_mwh`` as their mean.
    """

    price_eur_mwh: Array
    ambient_c: Array
    day: npt.NDArray[np.int64]
    discharged_kwh: float = 0.0
    is_last: bool = False
    use_eur_mwh: float = 0.0
    left_kwh: float = np.inf
    bands: PriceBands | None = None


class DynamicProgramDispatch:
    """Dispatch of a plant by dynamic programming on its control model.

    The bundled study ``model-accuracy`` repeats the comparison of [1]_ with it. Wear by depth of cycle can be
    part of the program because the cost of cycles counted by rainflow is convex in the profile [2]_.

    Every plan is a dynamic program of the plant as one store, over stored energy, temperature and, where wear
    depends on it, depth of the discharge so far (:class:`bess.dispatch.moves.Moves`). In each block of steps
    at one price the power is chosen that earns most together with the value of the state after it. The
    control model gives what powers do, with the best share among the strings: losses, heat, derating, full
    and empty strings. Fees, wear, standby and the price of a shortfall are counted. Where cycles are limited,
    cycling has a price: the dual value is least, at every state, at that of what is left of the limit. Where
    prices are known as bands, values after a block are expected over the levels of the next price. The
    plan is rolled out with the control model, less what full or empty strings cannot take. It depends on its
    arguments alone, to the last bit.

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
    max_import_kw, max_export_kw : float or None
        Limits of the grid connection in each direction.
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
        terms: SettlementTerms,
        *,
        max_power_kw: float | None = None,
        max_energy_kwh: float | None = None,
        max_import_kw: float | None = None,
        max_export_kw: float | None = None,
        cycles_per_day: float = 2.0,
        cycles_per_plan: float | None = None,
        end_price_eur_mwh: float | None = None,
    ):
        self._system, self._dt_h, self._terms = system, dt_h, terms
        most_kw, self._max_energy_kwh = max_power_kw or np.inf, max_energy_kwh or np.inf
        self._charge_kw, self._discharge_kw = (
            min(most_kw, each or np.inf) for each in (max_import_kw, max_export_kw)
        )
        self._end_price_eur_mwh = end_price_eur_mwh
        self._cycles_per_day, self._cycles_per_plan = cycles_per_day, cycles_per_plan
        self._wear = WearRates(system)
        self._plant: Aggregate | None = None
        self._moves: dict[tuple[int, int], Moves] = {}

    def plan(self, outlook: DispatchInputs, state: State, *, limit_kw: Array | None = None) -> DispatchPlan:
        """Return the best plan found.

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
        depths = CycleDepthCost.of(plant, self._wear.at(state))
        bands = PriceBands.known(outlook.price_eur_mwh) if outlook.bands is None else outlook.bands.narrowed
        blocks = Blocks.of(bands.price_eur_mwh, outlook.day, self._dt_h, first_h=_FIRST_H, step_h=_STEP_H)
        energy_kwh = min(self._max_energy_kwh, plant.capacity_kwh)
        if self._cycles_per_plan is None:
            period = outlook.day[blocks.first] - outlook.day[0]
            allowed_kwh = np.full(period[-1] + 1, self._cycles_per_day * energy_kwh)
            allowed_kwh[0] = max(0.0, allowed_kwh[0] - outlook.discharged_kwh)
        else:
            period = np.zeros(blocks.first.size, dtype=np.int64)
            allowed_kwh = np.array([self._cycles_per_plan * energy_kwh])
        allowed_kwh = np.minimum(allowed_kwh, outlook.left_kwh)
        grid = Grid.of(plant, energy_kwh, depths.points)
        price = np.vstack([bands.price_eur_mwh, outlook.price_eur_mwh])[:, blocks.first]
        buy = self._terms.charge_price_eur_mwh(price) / KWH_PER_MWH
        sell = (self._terms.discharge_price_eur_mwh(price) - outlook.use_eur_mwh) / KWH_PER_MWH
        sell -= depths.by_energy_eur_kwh
        eur = np.stack(
            [
                np.where(sell < 0.0, _NEVER_EUR_KWH, sell),
                -buy,
                -self._terms.shortfall_price_eur_mwh(price) / KWH_PER_MWH,
                np.full(price.shape, -depths.holding_eur_kwh_h),
            ],
            axis=2,
        )
        if outlook.is_last:
            end_eur_kwh = 0.0
        elif self._end_price_eur_mwh is not None:
            end_eur_kwh = self._end_price_eur_mwh / KWH_PER_MWH
        else:
            wear_eur = depths.marginal_eur_kwh.mean()
            end_eur_kwh = _value_of_store(
                *(np.repeat(each[-1], blocks.count) for each in (buy, sell - wear_eur))
            )
        task = _DispatchProblem(
            plant, self._terms, outlook, state, blocks,
            bands=bands,
            offers=[
                [Offer(each, ambient_c) for each in eur[:, b]]
                for b, ambient_c in enumerate(blocks.mean(outlook.ambient_c))
            ],
            moves=[self._moves_of(plant, grid, int(steps)) for steps in blocks.count],
            grid=grid, depths=depths, period=period, allowed_kwh=allowed_kwh, end_eur_kwh=end_eur_kwh,
        )  # fmt: skip
        return task.solved()

    def condition(self, state: State, limit_kw: Array) -> tuple[float, float, float]:
        """Return stored energy above the lower SOC limits and capacity [kWh], and mean temperature [degC]."""
        plant = self._aggregate(state, limit_kw)
        energy_kwh, temperature_c = plant.energy_kwh(state.soc), plant.mean_c(state.temperature_c)
        return float(energy_kwh), plant.capacity_kwh, float(temperature_c)

    def _aggregate(self, state: State, limit_kw: Array) -> Aggregate:
        """Return the aggregate store, rebuilt when inverters fail or capacity changes by a thousandth."""
        if self._plant is None or not self._plant.fits(state, limit_kw):
            self._plant, self._moves = Aggregate(self._system, self._dt_h, state, limit_kw), {}
        return self._plant

    def _moves_of(self, plant: Aggregate, grid: Grid, steps: int) -> Moves:
        """Return the transitions of a block by its number of steps, cached for the aggregate store."""
        key = steps, grid.depth.size
        if key not in self._moves:
            power_kw = min(self._charge_kw, plant.power_kw), min(self._discharge_kw, plant.power_kw)
            by_throughput = self._cycles_per_plan is not None
            self._moves[key] = Moves(plant, grid, power_kw, steps, by_throughput=by_throughput)
        return self._moves[key]


def _nothing(outlook: DispatchInputs, state: State) -> DispatchPlan:
    nothing = np.zeros(outlook.price_eur_mwh.size)
    return DispatchPlan(nothing, nothing, 0.0, nothing, nothing + state.temperature_c.mean())


@dataclass(frozen=True)
class _DispatchProblem:
    """One dispatch problem with a cycle limit for each period and a terminal value.

    The offers of a block belong to the price levels; the last one belongs to the expected price.
    """

    plant: Aggregate
    terms: SettlementTerms
    outlook: DispatchInputs
    state: State
    blocks: Blocks
    bands: PriceBands
    offers: list[list[Offer]]
    moves: list[Moves]
    grid: Grid
    depths: CycleDepthCost
    period: npt.NDArray[np.int64]
    allowed_kwh: Array
    end_eur_kwh: float

    def solved(self) -> DispatchPlan:
        """Return the plan; if it exceeds the cycle limit at a price of zero, with a price from the ladder."""
        power_kw, cycled_kwh = self._followed(np.zeros(1), np.full(self.allowed_kwh.size, _ANY_KWH))
        if (cycled_kwh > self.allowed_kwh).any():
            dearest = float(np.abs(self.outlook.price_eur_mwh).max()) / KWH_PER_MWH
            power_kw, _ = self._followed(np.array(_LADDER) * dearest, self.allowed_kwh)
        demand_kw = np.repeat(power_kw, self.blocks.count)
        demand_kw[np.abs(demand_kw) < _LEAST * self.plant.power_kw] = 0.0
        return self._valued(self.plant.roll_out(self.state, demand_kw, self.outlook.ambient_c))

    def _followed(self, shadow_eur: Array, allowed_kwh: Array) -> tuple[Array, Array]:
        """Return the power of each block and the cycled energy of each period, within its limit.

        It is chosen before the level of the price is known, which every value after the block takes as known.
        """
        values = self._values(shadow_eur)
        energy_kwh, degrees = (
            self.plant.energy_kwh(self.state.soc),
            self.plant.mean_c(self.state.temperature_c),
        )
        empty = max(0.0, 1.0 - float(energy_kwh) / self.plant.capacity_kwh)
        now = StoreState(*(np.array([float(each)]) for each in (energy_kwh, degrees, empty)))
        power_kw, cycled_kwh = np.zeros(len(self.moves)), np.zeros(allowed_kwh.size)
        share = self.bands.share[:, self.blocks.first].T
        for b, (moves, offers, period) in enumerate(zip(self.moves, self.offers, self.period, strict=True)):
            left_kwh = max(0.0, allowed_kwh[period] - cycled_kwh[period])
            place, weight = self.grid.corners(now)
            value = weight[0] @ (share[b] @ values[b][place[0]])
            shadow = int(np.argmin(value + shadow_eur * left_kwh))
            after = share[b] @ self._after(values, b, shadow_eur)[:, :, shadow].T
            power_kw[b], now, cycled = moves.best(
                after, offers[-1], self.depths, now, shadow_eur[shadow], left_kwh
            )
            cycled_kwh[period] += cycled
        return power_kw, cycled_kwh

    def _values(self, shadow_eur: Array) -> list[Array]:
        """Return the values of states before each block and at the end, ``(n_states, n_levels, n_shadows)``.

        Levels are price levels of the block; shadows are prices of cycled energy.
        """
        n_blocks, n_levels = len(self.moves), self.bands.now.size
        end = np.broadcast_to(self.grid.energy_kwh[:, None, None], self.grid.shape).reshape(-1, 1, 1)
        values = [np.tile(self.end_eur_kwh * end, (1, n_levels, shadow_eur.size))] * (n_blocks + 1)
        wear_eur = {moves: moves.wear_eur(self.depths) for moves in set(self.moves)}
        known: dict[tuple[Moves, bytes], Array] = {}
        for b in range(n_blocks - 1, -1, -1):
            moves, offers = self.moves[b], self.offers[b][:-1]
            key = moves, b"".join(offer.eur.tobytes() for offer in offers)
            if key not in known:
                income = [moves.income_eur(offer, wear_eur[moves], shadow_eur) for offer in offers]
                known = {key: np.hstack(income)}
            after = self._after(values, b, shadow_eur)
            before = moves.values(after.reshape(len(after), -1), known[key], offers[0].ambient_c)
            values[b] = before.reshape(after.shape)
        return values

    def _after(self, values: list[Array], b: int, shadow_eur: Array) -> Array:
        """Return the values of states after a block by its level: the expectation over the next level.

        Before another period, at the price that uses its limit: where the dual value, which bounds from
        above, is least.
        """
        later = values[b + 1]
        if b + 1 == len(self.moves):
            return later
        if self.period[b] != self.period[b + 1]:
            least = (later + shadow_eur * self.allowed_kwh[self.period[b + 1]]).min(axis=2, keepdims=True)
            later = np.repeat(least, shadow_eur.size, axis=2)
        if self.bands.is_new[self.blocks.first[b + 1]]:
            later = self.bands.chance @ later
        return np.asarray(later)

    def _valued(self, rolled: DispatchRollout) -> DispatchPlan:
        """Return the plan of a roll-out and its net income."""
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
        return DispatchPlan(
            demand_kw,
            delivered_kw,
            net_eur,
            rolled.energy_kwh[1:],
            self.plant.mean_c(rolled.temperature_c[:, 1:]),
        )


def _value_of_store(buy_eur_kwh: Array, sell_eur_kwh: Array) -> float:
    """Return the terminal value per kWh: the lower of its purchase cost and its revenue."""
    return max(0.0, min(float(np.quantile(buy_eur_kwh, 0.5)), float(np.quantile(sell_eur_kwh, 0.9))))
