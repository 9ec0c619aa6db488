from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from bess.system import State

_Array = NDArray[np.float64]

__all__ = [
    "Ageing",
    "BestShares",
    "ControlHorizon",
    "ControlModel",
    "Explicit",
    "FlowArrays",
    "GroupBounds",
    "Incumbent",
    "Node",
    "Plan",
    "Plant",
    "Rule",
    "SplitAnswer",
    "StateBoxes",
    "StepBounds",
    "Store",
    "System",
    "TrackedArrays",
    "ageing_models",
    "cooling_kinds",
    "plan",
    "rainflow",
    "water_fill",
]

def plan(
    model: ControlModel,
    *,
    soc: _Array,
    temperature_c: _Array,
    running: NDArray[np.bool_],
    demand_kw: _Array,
    ambient_c: _Array,
    dt_h: float,
    limit_kw: _Array,
    loss_prices: _Array,
    wear: _Array,
    start_cost: float,
    balance: float,
    end_charge: float,
    previous_kw: _Array | None,
    rollouts: int,
    restart_rollouts: int,
    price_passes: int,
    proof_cells: int | None,
    turn: int,
    reactive_kvar: _Array | None = None,
    groups: NDArray[np.int64] | None = None,
) -> Plan: ...
def ageing_models() -> list[tuple[str, str]]: ...
def cooling_kinds() -> list[str]: ...
def rainflow(series: _Array) -> list[tuple[float, float, float, int, int]]: ...
def water_fill(total_kw: float, weights: _Array, caps_kw: _Array) -> _Array: ...

@final
class System:
    def __new__(cls, document: str) -> System: ...
    def aged(self, soh_capacity: _Array, soh_resistance: _Array) -> System: ...

@final
class Ageing:
    def __new__(cls, system: System) -> Ageing: ...
    def cyclic_rate(
        self,
        cyclic_loss: _Array,
        depth: _Array,
        soc: _Array,
        c_rate: _Array,
        temperature_c: _Array,
    ) -> _Array: ...
    def calendar_rate(self, calendar_loss: _Array, soc: _Array, temperature_c: _Array) -> _Array: ...

@final
class Plant:
    def __new__(
        cls,
        system: System,
        scenarios: int,
        plant_step_s: float,
        derating_law: str,
        state: dict[str, _Array | NDArray[np.bool_]],
    ) -> Plant: ...
    def state(self) -> dict[str, NDArray[Any]]: ...
    def set_state(self, state: dict[str, _Array | NDArray[np.bool_]]) -> None: ...
    def run(
        self,
        request_kw: _Array,
        ambient_c: _Array,
        duration_s: float,
        keep_nodes: bool,
        reactive_kvar: _Array | None = None,
    ) -> dict[str, NDArray[Any]]: ...

@final
class FlowArrays:
    delivered_kw: _Array
    availability_loss_kw: _Array
    derating_loss_kw: _Array
    inverter_loss_kw: _Array
    battery_loss_kw: _Array
    current_a: _Array
    soc: _Array
    temperature_c: _Array

@final
class Plan:
    request_kw: _Array
    cost: float
    rule_cost: float
    search_bound: float | None
    bound: float | None
    rollouts: int
    start_charge: float

@final
class BestShares:
    def __new__(cls, charge_kw: _Array, discharge_kw: _Array, limit_kw: _Array) -> BestShares: ...

@final
class TrackedArrays:
    allocated_kw: _Array
    delivered_kw: _Array
    request_kw: _Array
    soc: _Array
    temperature_c: _Array

@final
class ControlModel:
    def __new__(cls, system: System) -> ControlModel: ...
    def rollout(
        self,
        soc: _Array,
        temperature_c: _Array,
        request_kw: _Array,
        ambient_c: _Array,
        dt_h: float,
        midpoint: bool = False,
    ) -> FlowArrays: ...
    def track_demand(
        self,
        soc: _Array,
        temperature_c: _Array,
        demand_kw: _Array,
        ambient_c: _Array,
        dt_h: float,
        parts: int,
        shares: BestShares,
    ) -> TrackedArrays: ...
    def coefficients(self, soc: _Array, temperature_c: _Array, discharge: bool) -> tuple[_Array, _Array]: ...
    def deliverable_kw(self, soc: _Array, temperature_c: _Array, discharge: bool, dt_h: float) -> _Array: ...
    def set_points(self, request_kw: _Array, limit_kw: _Array) -> _Array: ...
    def share_reactive(
        self,
        request_kw: _Array,
        total_kvar: float,
        limit_kva: _Array,
        start_kw: _Array,
    ) -> _Array: ...
    def nominal_loss_kw(self) -> tuple[_Array, _Array]: ...

@final
class StateBoxes:
    soc_low: _Array
    soc_high: _Array
    temperature_low_c: _Array
    temperature_high_c: _Array
    def __new__(
        cls, soc_low: _Array, soc_high: _Array, temperature_low_c: _Array, temperature_high_c: _Array
    ) -> StateBoxes: ...

@final
class Incumbent:
    request_kw: _Array
    objectives: _Array

@final
class GroupBounds:
    objective: float
    ceiling: float
    bound: float
    search_objective: float
    search_ceiling: float
    search_bound: float
    is_search_optimum: bool
    boxes: StateBoxes | None

@final
class SplitAnswer:
    incumbent: Incumbent
    flows: FlowArrays
    groups: list[GroupBounds]
    rollouts: int

@final
class StepBounds:
    phi: _Array
    shed_slope: _Array
    request_kw: _Array

@final
class ControlHorizon:
    def __new__(
        cls,
        model: ControlModel,
        soc: _Array,
        temperature_c: _Array,
        demand_kw: _Array,
        ambient_c: _Array,
        dt_h: float,
        limit_kw: _Array,
        costs: _Array,
        search_costs: _Array,
        tol_abs: _Array,
        tol_rel: _Array,
    ) -> ControlHorizon: ...
    def split(
        self,
        warm_start_kw: _Array | None,
        rollouts: int,
        time_limit_s: float | None = None,
        gap: float = 0.0,
    ) -> SplitAnswer: ...
    def best_of(self, incumbent: Incumbent, wanted_kw: _Array) -> Incumbent | None: ...
    def evaluate(self, request_kw: _Array) -> _Array: ...
    def greedy(self) -> _Array: ...
    def reachable(self) -> StateBoxes: ...
    def step_bounds(self, boxes: StateBoxes, costs: _Array, budget_kw: _Array) -> StepBounds: ...
    def tighten(
        self, request_kw: _Array, costs: _Array, shed_budget_kw: float
    ) -> tuple[float, StateBoxes, NDArray[np.bool_]]: ...
    def n_kinds(self) -> int: ...
    def priced_bound(self, ceilings: _Array, objective: float, sample: int) -> float: ...
    def root(self, boxes: StateBoxes) -> Node: ...
    def tighten_node(self, node: Node, shed_budget_kw: float) -> Node | None: ...
    def step_bounds_of(self, node: Node, costs: _Array, budget_kw: _Array) -> StepBounds: ...
    def relaxed(self, node: Node, near: StateBoxes, frozen: bool, units_kw: _Array) -> dict[str, _Array]: ...
    def flows_from(self, states: StateBoxes, request_kw: _Array) -> FlowArrays: ...

@final
class Node:
    request_low_kw: _Array
    request_high_kw: _Array
    may_shed: NDArray[np.bool_]
    boxes: StateBoxes
    def branch_on_request(self, string: int, step: int, at_kw: float) -> tuple[Node, Node]: ...
    def branch_on_soc(self, string: int, step: int, at: float) -> tuple[Node, Node]: ...
    def branch_on_full(self, string: int, step: int) -> tuple[Node, Node]: ...

@final
class Store:
    def __new__(
        cls,
        model: ControlModel,
        *,
        energy_kwh: _Array,
        temperature_c: _Array,
        depth: _Array,
        soc: _Array,
        power_kw: _Array,
        request_kw: _Array,
        energies: list[tuple[_Array, _Array]],
        mass_share: _Array,
        off_kw: _Array,
        capacity_kwh: float,
        dt_h: float,
        parts: int,
        ambient_c: float,
        cooling_per_h: float,
        by_throughput: bool,
    ) -> Store: ...
    def dispatch(
        self,
        state: tuple[float, float, float],
        *,
        steps: NDArray[np.int64],
        period: NDArray[np.int64],
        ambient_c: _Array,
        is_new: NDArray[np.bool_],
        income_eur: _Array,
        share: _Array,
        chance: _Array,
        wear: tuple[_Array, _Array],
        end_eur_kwh: float,
        allowed_kwh: _Array,
        shadow_prices_eur_kwh: _Array,
    ) -> _Array: ...

@final
class Rule:
    def __new__(
        cls,
        system: System,
        name: str,
        dt_h: float,
        nominal_kw: _Array,
        nominal_energy_kwh: _Array,
        stop_c: _Array,
    ) -> Rule: ...
    def split(self, state: State, limit_kw: _Array, demand_kw: float) -> _Array: ...
    def run(
        self, plant: Plant, demand_kw: _Array, limit_kw: _Array, ambient_c: _Array, duration_s: float
    ) -> dict[str, NDArray[Any]]: ...

@final
class Explicit:
    N_WEIGHTS: int
    DECISION: str
    def __new__(cls, tables: dict[str, Any]) -> Explicit: ...
    def demand_features(self, ahead_kw: _Array) -> _Array: ...
    def split(self, weights: _Array, state: State, limit_kw: _Array, ahead_kw: _Array) -> _Array: ...
    def run(
        self,
        plant: Plant,
        weights: _Array,
        demand_kw: _Array,
        features: _Array,
        limit_kw: _Array,
        ambient_c: _Array,
        duration_s: float,
    ) -> dict[str, NDArray[Any]]: ...
