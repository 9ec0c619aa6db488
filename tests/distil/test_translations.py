"""The decision in C, in structured text and in the core is that of plain Python, to the last bit."""

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from explicit_cases import SYSTEMS, Case, InC, cases, controller, in_python, random_weights, same_bits
from structured_text_reader import StructuredText

from bess.edge.distil.translate import constants, exports, functions

# Of IEC 61131-3 and of usual systems that extend it.
RESERVED = [
    "ABS",
    "ACTION",
    "AND",
    "ARRAY",
    "AT",
    "BOOL",
    "BY",
    "BYTE",
    "CASE",
    "CONSTANT",
    "DATE",
    "DINT",
    "DO",
    "DWORD",
    "ELSE",
    "ELSIF",
    "END_IF",
    "EXIT",
    "EXP",
    "FALSE",
    "FOR",
    "FROM",
    "FUNCTION",
    "IF",
    "INT",
    "INTERVAL",
    "LEFT",
    "LEN",
    "LIMIT",
    "LN",
    "LOG",
    "LREAL",
    "MAX",
    "MIN",
    "MOD",
    "MOVE",
    "MUX",
    "NOT",
    "OF",
    "ON",
    "OR",
    "PRIORITY",
    "PROGRAM",
    "READ_ONLY",
    "REAL",
    "REPEAT",
    "RESOURCE",
    "RETAIN",
    "RETURN",
    "RIGHT",
    "ROL",
    "ROR",
    "SEL",
    "SHL",
    "SHR",
    "SINGLE",
    "SQRT",
    "STEP",
    "STRING",
    "STRUCT",
    "TASK",
    "THEN",
    "TIME",
    "TO",
    "TRUE",
    "TYPE",
    "UNTIL",
    "VAR",
    "WHILE",
    "WITH",
    "XOR",
    "R",
    "S",
]


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_core_decides_as_the_source_does(name: str) -> None:
    system, random = SYSTEMS[name](), np.random.default_rng(1)
    for round_ in range(10):
        law = controller(system, random_weights(random))
        for case in cases(system, 30, round_):
            own = law.split(case.state, case.ahead_kw, case.limit_kw)
            assert same_bits(own, in_python(law, case)), case


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize("name", SYSTEMS)
def test_c_decides_as_the_source_does(name: str, tmp_path: Path) -> None:
    system = SYSTEMS[name]()
    law = controller(system, random_weights(np.random.default_rng(2)))
    compiled = InC(law, tmp_path)
    for case in cases(system, 200, 3):
        assert same_bits(compiled(case), in_python(law, case)), case


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_c_needs_nothing_but_math_h_and_allocates_nothing(tmp_path: Path) -> None:
    texts = exports(controller(SYSTEMS["two"]()))
    assert re.findall(r"#include (\S+)", texts["split.c"]) == ["<math.h>", '"split.h"']
    assert set(re.findall(r"\b(\w+)\(", texts["split.c"])) <= {
        "bess_demand_features", "bess_split", "larger", "smaller", "fabs", "sqrt", "if", "while", "for",
    }  # fmt: skip


@pytest.mark.parametrize("name", SYSTEMS)
def test_structured_text_decides_as_the_source_does(name: str) -> None:
    system = SYSTEMS[name]()
    law = controller(system, random_weights(np.random.default_rng(4)))
    blocks = StructuredText(exports(law)["split.st"]).blocks
    for case in cases(system, 40, 5):
        assert same_bits(_in_structured_text(blocks, case), in_python(law, case)), case


def test_structured_text_carries_every_number_of_the_tables() -> None:
    law = controller(SYSTEMS["mixed-4"](), random_weights(np.random.default_rng(6)))
    read: dict[str, Any] = {}
    for block in StructuredText(exports(law)["split.st"]).blocks.values():
        read |= block.constants
    used = set().union(*(function.constants for function in functions().values()))
    for name, value in constants(law).items():
        if name in used:
            assert read.pop(name) == (list(value) if isinstance(value, tuple) else value), name
    assert not read


@pytest.mark.parametrize("name", ["BESS_DEMAND_FEATURES", pytest.param("BESS_SPLIT", marks=pytest.mark.slow)])
def test_structured_text_is_read_by_a_parser_of_the_language(name: str) -> None:
    """blark, a parser for TwinCAT. It is slow, so that long tables are cut; others read their numbers."""
    blark = pytest.importorskip("blark")
    text = exports(controller(SYSTEMS["two"]()))["split.st"]
    short = re.sub(r":= \[\n([^,]*), ([^,]*), [^\]]*\]", r":= [\1, \2]", text)
    about, *blocks = re.split(r"^(?=FUNCTION_BLOCK)", short, flags=re.M)
    (block,) = (block for block in blocks if block.startswith(f"FUNCTION_BLOCK {name}\n"))
    assert blark.parse_source_code(about + block).exception is None
    assert blark.parse_source_code(block.replace("END_FOR;", "", 1)).exception is not None


def test_names_differ_in_more_than_case_and_are_not_reserved() -> None:
    tables = constants(controller(SYSTEMS["two"]()))
    for function in functions().values():
        variables = (name.rstrip("_") for name in function.variables)
        names = {*function.arguments, *variables}
        together = [name.upper() for name in (*names, *tables)]
        assert len(set(together)) == len(together), sorted({n for n in together if together.count(n) > 1})
        assert not set(together) & set(RESERVED)


def _in_structured_text(blocks: dict, case: Case) -> np.ndarray:
    state = case.state
    features = blocks["BESS_DEMAND_FEATURES"](ahead_kw=case.ahead_kw.tolist()).features
    split = blocks["BESS_SPLIT"](
        soc=state.soc.tolist(),
        temperature_c=state.temperature_c.tolist(),
        soh_capacity=state.soh_capacity.tolist(),
        soh_resistance=state.soh_resistance.tolist(),
        limit_kw=case.limit_kw.tolist(),
        demand_kw=float(case.ahead_kw[0]),
        features=features,
    )
    return np.array(split.request_kw)
