from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Ageing", "ControlHorizon", "ControlModel", "Plant", "System", "ageing_models", "rainflow"]

def ageing_models() -> list[tuple[str, str]]: ...
def rainflow(series: NDArray[np.float64]) -> list[tuple[float, float, float, int, int]]: ...

@final
class System:
    def __new__(cls, document: str) -> System: ...
    def aged(self, soh_capacity: NDArray[np.float64], soh_resistance: NDArray[np.float64]) -> System: ...
    @property
    def n_strings(self) -> int: ...

@final
class Ageing:
    def __new__(cls, system: System) -> Ageing: ...
    def cyclic_rate(
        self,
        cyclic_loss: NDArray[np.float64],
        depth: NDArray[np.float64],
        soc: NDArray[np.float64],
        c_rate: NDArray[np.float64],
        temperature_c: NDArray[np.float64],
    ) -> NDArray[np.float64]: ...
    def calendar_rate(
        self, calendar_loss: NDArray[np.float64], soc: NDArray[np.float64], temperature_c: NDArray[np.float64]
    ) -> NDArray[np.float64]: ...

@final
class Plant:
    def __new__(
        cls,
        system: System,
        scenarios: int,
        plant_step_s: float,
        derating_law: str,
        state: dict[str, NDArray[np.float64] | NDArray[np.bool_]],
    ) -> Plant: ...
    @property
    def lanes(self) -> int: ...
    @property
    def max_nodes(self) -> int: ...
    @property
    def plant_step_s(self) -> float: ...
    def state(self) -> dict[str, NDArray[Any]]: ...
    def set_state(self, state: dict[str, NDArray[np.float64] | NDArray[np.bool_]]) -> None: ...
    def run(
        self,
        request_kw: NDArray[np.float64],
        ambient_c: NDArray[np.float64],
        duration_s: float,
        keep_nodes: bool,
    ) -> dict[str, NDArray[Any]]: ...

@final
class ControlModel:
    def __new__(cls, system: System) -> ControlModel: ...
    def rollout(
        self,
        soc0: NDArray[np.float64],
        temperature0_c: NDArray[np.float64],
        request_kw: NDArray[np.float64],
        ambient_c: NDArray[np.float64],
        dt_h: float,
    ) -> list[NDArray[np.float64]]: ...
    def max_power_kw(
        self,
        soc0: NDArray[np.float64],
        temperature0_c: NDArray[np.float64],
        discharge: bool,
        dt_h: float,
    ) -> NDArray[np.float64]: ...
    def nominal_loss_kw(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

@final
class ControlHorizon:
    def __new__(
        cls,
        system: System,
        soc0: NDArray[np.float64],
        temperature0_c: NDArray[np.float64],
        demand_kw: NDArray[np.float64],
        ambient_c: NDArray[np.float64],
        dt_h: float,
        limit_kw: NDArray[np.float64],
        costs: NDArray[np.float64],
        tol_abs: NDArray[np.float64],
        tol_rel: NDArray[np.float64],
    ) -> ControlHorizon: ...
    def evaluate(self, request_kw: NDArray[np.float64]) -> NDArray[np.float64]: ...
    def greedy(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def search(
        self, starts_kw: NDArray[np.float64], max_rollouts: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], int]: ...
    def descend(
        self,
        start_kw: NDArray[np.float64],
        group: int,
        ceilings: NDArray[np.float64],
        max_rollouts: int,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], int]: ...
    def reachable(self) -> list[NDArray[np.float64]]: ...
    def step_bounds(
        self,
        soc_low: NDArray[np.float64],
        soc_high: NDArray[np.float64],
        temperature_low_c: NDArray[np.float64],
        temperature_high_c: NDArray[np.float64],
        costs: NDArray[np.float64],
        budget_kw: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
    def confine(
        self, request_kw: NDArray[np.float64], costs: NDArray[np.float64], shed_budget_kw: float
    ) -> tuple[float, list[NDArray[np.float64]]]: ...
    def coefficients(
        self, soc: NDArray[np.float64], temperature_c: NDArray[np.float64]
    ) -> list[NDArray[np.float64]]: ...
    def ranges(
        self,
        soc_low: NDArray[np.float64],
        soc_high: NDArray[np.float64],
        temperature_low_c: NDArray[np.float64],
        temperature_high_c: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]: ...
    def planes(
        self,
        soc_low: NDArray[np.float64],
        soc_high: NDArray[np.float64],
        temperature_low_c: NDArray[np.float64],
        temperature_high_c: NDArray[np.float64],
        soc: NDArray[np.float64],
        temperature_c: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]: ...
