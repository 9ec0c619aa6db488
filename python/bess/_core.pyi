from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import disjoint_base

__all__ = ["Plant", "System"]

@final
@disjoint_base
class System:
    def __new__(cls, document: str) -> System: ...
    @property
    def n_strings(self) -> int: ...

@final
@disjoint_base
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
