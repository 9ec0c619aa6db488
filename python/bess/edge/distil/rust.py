"""The decision as Rust: the file that the core is compiled from, with the tables as data."""

from __future__ import annotations

from typing import Final

from bess.edge.distil.c99 import BRACES
from bess.edge.distil.translate import Language, arguments, functions, outputs, places

HEAD: Final = """//! Written by `bess.edge.distil.rust` from `explicit/decision.py`; a test compares them.

use super::{larger, smaller, Tables, MOST_STRINGS};
"""


def _named(name: str) -> str:
    """Constants as they are, tables as fields of ``t``, the weights an argument."""
    if name == "WEIGHTS":
        return "weights"
    return f"t.{name.lower()}" if name.isupper() and name not in places() else name


RUST: Final = Language(
    words={
        "not": "!", "and": "&&", "or": "||", "==": "==", "!=": "!=", "True": "true", "False": "false",
        "max": "larger({0}, {1})", "min": "smaller({0}, {1})", "abs": "({0}).abs()", "sqrt": "({0}).sqrt()",
    },
    types={"float": "f64", "int": "usize", "bool": "bool"},
    declare="let mut {name}: {type} = {value};",
    clear="let mut {name} = [{zero}; MOST_STRINGS + 1];",
    loop="for {counter} in 0..{size} {{",
    opens={"if": "if {0} {{", "elif": "}} else if {0} {{", "while": "while {0} {{", "else": "} else {"},
    ends=BRACES,
    name=_named,
)  # fmt: skip


def rust_source() -> str:
    """Text of ``rust/bess-control/src/explicit/decision.rs``."""
    lines = [HEAD]
    lines += [f"pub(crate) const {name}: usize = {value};" for name, value in places().items()]
    for name, function in functions().items():
        filled = outputs(function)
        texts = ["t: &Tables", *(["weights: &[f64]"] if name == "split" else [])]
        for argument, kind in arguments(function).items():
            array = "&mut [f64]" if argument in filled else "&[f64]"
            texts.append(f"{argument}: {array if kind == 'Floats' else RUST.types[kind]}")
        lines += ["", f"pub(crate) fn {name}({', '.join(texts)}) {{", *RUST.body(function.body), "}"]
    return "\n".join(lines) + "\n"
