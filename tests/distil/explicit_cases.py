"""Controllers and states to try translations on, and the decision as plain Python."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from math import sqrt
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bess
from bess.control.explicit import ExplicitController, Tables
from bess.edge.distil.training import first_weights
from bess.edge.distil.translate import Language, constants, exports, functions, places

Array = NDArray[np.float64]
PYTHON = Language(
    words={
        "&&": "and", r"\|\|": "or", r"!(?!=)": "not ", r"\btrue\b": "True", r"\bfalse\b": "False",
        r"\blarger\b": "max", r"\bsmaller\b": "min",
    },
    statements={
        r"for (\w+) in 0\.\.(.*) \{": r"for \1 in range(\2):",
        r"(if|while) (.*) \{": r"\1 \2:",
        r"\} else if (.*) \{": r"elif \1:",
        r"\} else \{": "else:",
        r"let mut (\w+) = array\((\S+), (.*)\);": r"\1 = [\2] * (\3)",
        r"let (?:mut )?(\w+): \w+ = (.*);": r"\1 = \2",
        r"(\S+|\w+\[.*?\]) (\+?=) (.*);": r"\1 \2 \3",
    },
    ends=dict.fromkeys(("if", "while", "for"), ""),
)  # fmt: skip

SYSTEMS: dict[str, Callable[[], bess.System]] = {
    "two": lambda: bess.System.reference(2),
    "eight": lambda: bess.System.reference(8),
    "unequal-4": lambda: bess.load_system("unequal-4"),
    "mixed-4": lambda: bess.load_system("mixed-4"),
}


def controller(system: bess.System, weights: Array | None = None, steps: int = 24) -> ExplicitController:
    chosen = first_weights() if weights is None else weights
    return ExplicitController(
        study="cases",
        system=system.name,
        weights=tuple(chosen.tolist()),
        tables=Tables.of(system, steps, 0.25, 3.0),
    )


def random_weights(random: np.random.Generator) -> Array:
    return first_weights() + random.normal(0.0, 1.0, first_weights().size)


@dataclass(frozen=True)
class Case:
    """A measured plant and the demand ahead."""

    state: bess.State
    limit_kw: Array
    ahead_kw: Array


def cases(system: bess.System, n: int, seed: int, steps: int = 24) -> Iterator[Case]:
    """States all over the windows, their ends among them; some strings out of service or limited."""
    random = np.random.default_rng(seed)
    low = np.array([string.battery.soc_min for string in system.strings])
    high = np.array([string.battery.soc_max for string in system.strings])
    size = system.n_strings
    for _ in range(n):
        place = np.clip(random.uniform(-0.2, 1.2, size), 0.0, 1.0)
        state = bess.State(
            low + place * (high - low),
            random.uniform(5.0, 62.0, size),
            random.uniform(0.7, 1.0, size),
            random.uniform(1.0, 2.0, size),
        )
        limit_kw = system.nominal_kw * random.choice([0.0, 0.4, 1.0, 1.0, 1.0], size)
        total_kw = limit_kw.sum()
        ahead_kw = total_kw * np.clip(random.normal(0.0, 0.6, steps), -1.0, 1.0)
        if random.random() < 0.1:
            ahead_kw[0] = total_kw * np.sign(ahead_kw[0])
        yield Case(state, limit_kw, ahead_kw)


def in_python(law: ExplicitController, case: Case) -> Array:
    """The law as plain Python, with the tables of this controller for its names in capitals."""
    names: dict[str, Any] = {**constants(law), "sqrt": sqrt}
    exec(_python(), names)
    features = [0.0] * places()["N_FEATURES"]
    request_kw = [0.0] * case.limit_kw.size
    state = case.state
    measured = (state.soc, state.temperature_c, state.soh_capacity, state.soh_resistance, case.limit_kw)
    names["demand_features"](case.ahead_kw.tolist(), features)
    names["split"](*(values.tolist() for values in measured), float(case.ahead_kw[0]), features, request_kw)
    return np.array(request_kw)


@cache
def _python() -> CodeType:
    lines = []
    for name, function in functions().items():
        lines += [f"def {name}({', '.join(function.arguments)}):", *PYTHON.body(function)]
    return compile("\n".join(lines), "decision", "exec")


class InC:
    """The law as ``split.c``, compiled."""

    def __init__(self, law: ExplicitController, folder: Path) -> None:
        for name, text in exports(law).items():
            (folder / name).write_text(text, encoding="utf-8")
        library = folder / "split.so"
        strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2", "-ffp-contract=off"]
        command = ["gcc", *strict, "-shared", "-fPIC", "-o", library, folder / "split.c", "-lm"]
        subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True)
        self._library = ctypes.CDLL(str(library))

    def __call__(self, case: Case) -> Array:
        def pointer(values: Array) -> Any:
            return np.ascontiguousarray(values).ctypes.data_as(ctypes.POINTER(ctypes.c_double))

        features, request_kw = np.zeros(places()["N_FEATURES"]), np.zeros(case.limit_kw.size)
        state = case.state
        measured = (state.soc, state.temperature_c, state.soh_capacity, state.soh_resistance, case.limit_kw)
        self._library.bess_demand_features(pointer(case.ahead_kw), pointer(features))
        self._library.bess_split(
            *(pointer(values) for values in measured),
            ctypes.c_double(case.ahead_kw[0]),
            pointer(features),
            pointer(request_kw),
        )
        return request_kw


def same_bits(a: Array, b: Array) -> bool:
    return a.tobytes() == b.tobytes()
