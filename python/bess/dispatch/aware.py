"""Dispatch on the plant model: dynamic programs over the plant as one aggregate store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from bess import _core
from bess.arrays import Array, ByValue
from bess.control.wear import WearRates
from bess.dispatch.aggregate import Aggregate
from bess.dispatch.bands import PriceBands
from bess.dispatch.blocks import Blocks
from bess.dispatch.cycle_depth_cost import CycleDepthCost
from bess.display import as_table, one_line, rounded
from bess.system import State, System
from bess.system.terms import SettlementTerms
from bess.units import KWH_PER_MWH

_MIN_POWER_SHARE: Final = 1e-6
"""Fraction of plant power below which the dispatch is zero."""

_FINE_H: Final = 8.0
"""Time planned in short blocks [h]; the next plan replaces this one before this time has passed."""

_FINE_STEP_H: Final = 0.25
"""Maximum length of a short block [h]; later blocks are longer (:class:`bess.dispatch.blocks.Blocks`)."""

_CYCLE_PRICES: Final = (0.0, 0.1, 0.2, 0.4, 0.7, 1.2)
"""Trial prices of cycled energy relative to the highest energy price, used where cycles are limited."""

_ENERGIES: Final = 61
"""Grid points of the stored energy."""


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
        Net income by the settlement terms, less wear cost; the remaining stored energy is not valued.
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
            "power": f"{rounded(self.demand_kw.min(), 3)} to {rounded(self.demand_kw.max(), 3)} kW",
            "expected net": f"{self.expected_net_eur:.2f} EUR",
        }

    __repr__ = one_line
    _repr_html_ = as_table


@dataclass(frozen=True, eq=False)
class DispatchInputs(ByValue):
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
        Whether the run ends with the plan; the remaining stored energy then has no value.
    budget_price_eur_mwh : float
        Shadow price of a budget per MWh discharged, in addition to wear. Plans use it, but it is not paid.
    remaining_kwh : float
        Stored energy that the whole plan may discharge.
    bands : PriceBands or None
        Price levels of an uncertain forecast, with mean ``price_eur_mwh``.
    """

    price_eur_mwh: Array
    ambient_c: Array
    day: npt.NDArray[np.int64]
    discharged_kwh: float = 0.0
    is_last: bool = False
    budget_price_eur_mwh: float = 0.0
    remaining_kwh: float = np.inf
    bands: PriceBands | None = None


class DynamicProgramDispatch:
    """Dispatch of a plant by dynamic programming on its control model.

    The bundled study ``model-accuracy`` repeats the comparison of [1]_ with it. Wear by depth of cycle can be
    part of the program because the cost of cycles counted by rainflow is convex in the profile [2]_.

    Each plan is a dynamic program of the plant as one storage. Its states are stored energy, temperature and,
    if wear depends on it, the depth of the present discharge. In each block of steps at one price, the power
    maximises the income of the block plus the value of the state after it. The control model, with the
    minimum-loss allocation to the strings, gives losses, heat, derating, and full or empty strings. The
    income includes fees, wear, standby and the price of a shortfall. A limit on cycles is replaced by its
    shadow price, which minimises the dual bound at every state. With price bands, the value after a block is
    the expectation over the levels of the next price. The plan is then rolled out with the control model, and
    power that full or empty strings cannot take is removed. Equal arguments give bit-identical plans.

    Parameters
    ----------
    system : System
        The plant; its sections ``[wear]`` price the wear.
    dt_h : float
        Control step [h].
    terms : SettlementTerms
        Fees and the price of a shortfall.
    max_power_kw, max_energy_kwh : float or None
        Limits of power and energy below those of the plant.
    max_import_kw, max_export_kw : float or None
        Limits of the grid connection in each direction.
    cycles_per_day : float
        Maximum full cycles per day: discharged stored energy / energy of the plant.
    cycles_per_plan : float or None
        Alternative to ``cycles_per_day``: maximum full cycles of each plan, the mean of charged and
        discharged AC energy / energy of the plant.
    end_price_eur_mwh : float or None
        Value of a MWh stored at the end of a plan. None: the lower of the median purchase price and the 90 %
        quantile of the selling price.

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
        max_kw, self._max_energy_kwh = max_power_kw or np.inf, max_energy_kwh or np.inf
        self._charge_kw, self._discharge_kw = (
            min(max_kw, each or np.inf) for each in (max_import_kw, max_export_kw)
        )
        self._end_price_eur_mwh = end_price_eur_mwh
        self._cycles_per_day, self._cycles_per_plan = cycles_per_day, cycles_per_plan
        self._wear = WearRates(system)
        self._plant: Aggregate | None = None
        self._store: dict[int, _core.Store] = {}
        self._depths: CycleDepthCost | None = None

    def plan(self, inputs: DispatchInputs, state: State, *, limit_kw: Array | None = None) -> DispatchPlan:
        """Return the best plan found.

        Parameters
        ----------
        inputs : DispatchInputs
            Prices and temperatures ahead.
        state : State
            Measured state.
        limit_kw : ndarray, shape (n_strings,), optional
            Power of each inverter in service, assumed constant over the plan.
        """
        limit = self._system.nominal_kw if limit_kw is None else limit_kw
        if not limit.any():
            zeros = np.zeros(inputs.price_eur_mwh.size)
            return DispatchPlan(zeros, zeros, 0.0, zeros, zeros + state.temperature_c.mean())
        plant = self._aggregate(state, limit)
        if self._depths is None or self._wear.depend_on_state:
            self._depths = CycleDepthCost.of(plant, self._wear.at(state))
        depths = self._depths
        bands = PriceBands.certain(inputs.price_eur_mwh) if inputs.bands is None else inputs.bands.reduced
        blocks = Blocks.of(bands.price_eur_mwh, inputs.day, self._dt_h, first_h=_FINE_H, step_h=_FINE_STEP_H)
        energy_kwh = min(self._max_energy_kwh, plant.capacity_kwh)
        period, allowed_kwh = self._cycle_limits(inputs, blocks, energy_kwh)
        price = np.vstack([bands.price_eur_mwh, inputs.price_eur_mwh])[:, blocks.first]
        eur = self._income_eur(price, inputs.budget_price_eur_mwh, depths)
        max_eur_kwh = float(np.abs(inputs.price_eur_mwh).max()) / KWH_PER_MWH
        stored_kwh = float(plant.energy_kwh(state.soc))
        empty = max(0.0, 1.0 - stored_kwh / plant.capacity_kwh)
        power_kw = self._store_of(plant, energy_kwh, depths.points).dispatch(
            (stored_kwh, float(plant.mean_c(state.temperature_c)), empty),
            steps=blocks.count,
            period=period,
            ambient_c=blocks.mean(inputs.ambient_c),
            is_new=bands.is_new[blocks.first],
            income_eur=np.ascontiguousarray(eur.swapaxes(0, 1)),
            share=np.ascontiguousarray(bands.probability[:, blocks.first].T),
            chance=bands.transition,
            wear=depths.curve_eur,
            end_eur_kwh=self._end_eur_kwh(inputs, eur[-1], blocks, depths),
            allowed_kwh=allowed_kwh,
            shadow_prices_eur_kwh=np.array(_CYCLE_PRICES) * max_eur_kwh,
        )
        demand_kw = np.repeat(power_kw, blocks.count)
        demand_kw[np.abs(demand_kw) < _MIN_POWER_SHARE * plant.power_kw] = 0.0
        tracked = plant.track_demand(state, demand_kw, inputs.ambient_c)
        planned_kwh = plant.energy_kwh(tracked.soc)
        return DispatchPlan(
            tracked.allocated_kw,
            tracked.delivered_kw,
            self._net_eur(plant, tracked, planned_kwh, inputs.price_eur_mwh, depths),
            planned_kwh[1:],
            plant.mean_c(tracked.temperature_c[:, 1:]),
        )

    def condition(self, state: State, limit_kw: Array) -> tuple[float, float, float]:
        """Return stored energy above the lower SOC limits and capacity [kWh], and mean temperature [degC]."""
        plant = self._aggregate(state, limit_kw)
        energy_kwh, temperature_c = plant.energy_kwh(state.soc), plant.mean_c(state.temperature_c)
        return float(energy_kwh), plant.capacity_kwh, float(temperature_c)

    def wear_eur_mwh(self, state: State, limit_kw: Array) -> float:
        """Return the wear cost of a MWh discharged (AC), the mean over depths of cycle."""
        plant = self._aggregate(state, limit_kw)
        depths = CycleDepthCost.of(plant, self._wear.at(state))
        return KWH_PER_MWH * (depths.by_energy_eur_kwh + float(depths.marginal_eur_kwh.mean()))

    def _cycle_limits(
        self, inputs: DispatchInputs, blocks: Blocks, energy_kwh: float
    ) -> tuple[npt.NDArray[np.int64], Array]:
        """Return the period of each block, and the stored energy that each period may discharge [kWh]."""
        if self._cycles_per_plan is None:
            period = inputs.day[blocks.first] - inputs.day[0]
            allowed_kwh = np.full(period[-1] + 1, self._cycles_per_day * energy_kwh)
            allowed_kwh[0] = max(0.0, allowed_kwh[0] - inputs.discharged_kwh)
        else:
            period = np.zeros(blocks.first.size, dtype=np.int64)
            allowed_kwh = np.array([self._cycles_per_plan * energy_kwh])
        remaining_kwh = inputs.remaining_kwh
        if remaining_kwh <= allowed_kwh.min():  # any day can use all of it
            return np.zeros_like(period), np.array([remaining_kwh])
        earlier_kwh = np.r_[0.0, np.cumsum(allowed_kwh)[:-1]]
        return period, np.minimum(allowed_kwh, np.maximum(0.0, remaining_kwh - earlier_kwh))

    def _income_eur(self, price: Array, budget_price_eur_mwh: float, depths: CycleDepthCost) -> Array:
        """Return the income per kWh discharged, charged, undelivered, and per kWh held for an hour."""
        sell = (self._terms.discharge_price_eur_mwh(price) - budget_price_eur_mwh) / KWH_PER_MWH
        return np.stack(
            [
                sell - depths.by_energy_eur_kwh,
                -self._terms.charge_price_eur_mwh(price) / KWH_PER_MWH,
                -self._terms.shortfall_price_eur_mwh(price) / KWH_PER_MWH,
                np.full(price.shape, -depths.holding_eur_kwh_h),
            ],
            axis=2,
        )

    def _end_eur_kwh(
        self, inputs: DispatchInputs, income_eur: Array, blocks: Blocks, depths: CycleDepthCost
    ) -> float:
        """Return the value of a kWh stored at the end: the lower of its purchase cost and its revenue."""
        if inputs.is_last:
            return 0.0
        if self._end_price_eur_mwh is not None:
            return self._end_price_eur_mwh / KWH_PER_MWH
        sell, buy = income_eur[:, 0] - depths.marginal_eur_kwh.mean(), -income_eur[:, 1]
        median, high = np.quantile(np.repeat([buy, sell], blocks.count, axis=1), [0.5, 0.9], axis=1)
        return max(0.0, min(float(median[0]), float(high[1])))

    def _aggregate(self, state: State, limit_kw: Array) -> Aggregate:
        """Return the aggregate store, rebuilt when inverters fail or capacity changes by a thousandth."""
        if self._plant is None or not self._plant.fits(state, limit_kw):
            self._plant = Aggregate(self._system, self._dt_h, state, limit_kw)
            self._store, self._depths = {}, None
        return self._plant

    def _store_of(self, plant: Aggregate, energy_kwh: float, depth: Array) -> _core.Store:
        """Return the grid of states with its transitions, cached for the aggregate store."""
        if depth.size not in self._store:
            power_kw = min(self._charge_kw, plant.power_kw), min(self._discharge_kw, plant.power_kw)
            grid_kwh = np.linspace(0.0, energy_kwh, _ENERGIES)
            by_throughput = self._cycles_per_plan is not None
            self._store[depth.size] = plant.store(grid_kwh, depth, power_kw, by_throughput=by_throughput)
        return self._store[depth.size]

    def _net_eur(
        self,
        plant: Aggregate,
        tracked: _core.TrackedArrays,
        energy_kwh: Array,
        price: Array,
        depths: CycleDepthCost,
    ) -> float:
        """Return the net income of a tracked demand, wear included."""
        terms, dt_h = self._terms, self._dt_h
        demand_kw, delivered_kw, is_on = tracked.allocated_kw, tracked.delivered_kw, tracked.request_kw != 0.0
        sold_kw, bought_kw = np.maximum(delivered_kw, 0.0), np.maximum(-delivered_kw, 0.0)
        undelivered_kw = np.maximum(np.abs(demand_kw) - np.abs(delivered_kw), 0.0)
        eur_per_h = (
            sold_kw * terms.discharge_price_eur_mwh(price)
            - (bought_kw + plant.off_kw @ ~is_on) * terms.charge_price_eur_mwh(price)
            - undelivered_kw * terms.shortfall_price_eur_mwh(price)
        ) / KWH_PER_MWH
        wear_eur = depths.cost_eur(sold_kw * dt_h, energy_kwh, dt_h)
        starts = int(np.count_nonzero(is_on[:, 1:] & ~is_on[:, :-1]))  # after the first step
        return float(eur_per_h.sum()) * dt_h - wear_eur - terms.start_eur * starts
