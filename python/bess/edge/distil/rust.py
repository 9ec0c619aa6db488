"""The decision as Rust: the file that the core is compiled from, with the tables as data."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Final, Literal

from bess.edge.distil.translate import Kind, Printer, arguments, functions, outputs, places

TYPES: Final = {"float": "f64", "int": "usize", "bool": "bool"}
HEAD: Final = """//! Written by `bess.edge.distil.rust` from `explicit/decision.py`; a test compares them.

use super::{larger, smaller, Tables, MOST_STRINGS};
"""


class RustPrinter(Printer):
    """Rust; tables are fields of ``t``, the weights an argument."""

    words: ClassVar[dict[str, str]] = {
        "not": "!", "and": "&&", "or": "||", "==": "==", "!=": "!=", "True": "true", "False": "false",
        "max": "larger", "min": "smaller",
    }  # fmt: skip

    def name(self, name: str) -> str:
        """Constants as they are, tables as fields."""
        if name == "WEIGHTS":
            return "weights"
        return f"t.{name.lower()}" if name.isupper() and name not in places() else name

    def number(self, value: float) -> str:
        """As Python writes it."""
        return repr(value)

    def index(self, array: str, index: str) -> str:
        """``a[i]``."""
        return f"{array}[{index}]"

    def declare(self, name: str, kind: Kind, value: str) -> Iterator[str]:
        """``let mut x: f64 = 0.0;``."""
        yield f"let mut {name}: {TYPES[kind]} = {value};"

    def clear(self, name: str, kind: Kind, size: str) -> Iterator[str]:
        """An array with room for any plant."""
        yield f"let mut {name} = [{'0.0' if kind == 'Floats' else 'false'}; MOST_STRINGS + 1];"

    def assign(self, target: str, value: str) -> str:
        """``x = y;``."""
        return f"{target} = {value};"

    def block(self, head: Literal["if", "elif", "while"], condition: str) -> str:
        """``if a {``."""
        return f"{ {'elif': '} else if'}.get(head, head) } {condition} {{"

    def loop(self, counter: str, size: str) -> str:
        """``for i in 0..n {``."""
        return f"for {counter} in 0..{size} {{"

    def otherwise(self) -> str:
        """``} else {``."""
        return "} else {"

    def close(self, head: Literal["if", "while", "for"]) -> str:
        """``}``."""
        return "}"

    def call(self, function: str, arguments: list[str]) -> str:
        """``x.abs()``, ``larger(x, y)``."""
        if function in ("abs", "sqrt"):
            return f"({arguments[0]}).{function}()"
        return super().call(function, arguments)


def rust_source() -> str:
    """Text of ``rust/bess-control/src/explicit/decision.rs``."""
    lines = [HEAD]
    lines += [f"pub(crate) const {name}: usize = {value};" for name, value in places().items()]
    for name, function in functions().items():
        filled = outputs(function)
        texts = ["t: &Tables", *(["weights: &[f64]"] if name == "split" else [])]
        for argument, kind in arguments(function).items():
            array = "&mut [f64]" if argument in filled else "&[f64]"
            texts.append(f"{argument}: {array if kind == 'Floats' else TYPES[kind]}")
        lines += ["", f"pub(crate) fn {name}({', '.join(texts)}) {{", *RustPrinter().body(function.body), "}"]
    return "\n".join(lines) + "\n"
