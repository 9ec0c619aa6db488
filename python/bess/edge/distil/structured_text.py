"""The decision as structured text (IEC 61131-3): two function blocks that need nothing else."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from typing import ClassVar, Final, Literal

from bess.edge.distil.translate import (
    INDENT,
    Kind,
    Printer,
    arguments,
    functions,
    integers,
    locals_of,
    outputs,
    places,
)
from bess.errors import BessError

TYPES: Final = {"float": "LREAL", "int": "DINT", "bool": "BOOL", "Floats": "LREAL", "Flags": "BOOL"}
PREFIX: Final = "BESS_"
COUNTER: Final = "cell"
"""Counter of the loops that clear an array; no variable of the decision has this name."""


class StPrinter(Printer):
    """Structured text. Its AND evaluates both sides, and it does not tell upper from lower case."""

    words: ClassVar[dict[str, str]] = {
        "not": "NOT", "and": "AND", "or": "OR", "==": "=", "!=": "<>", "True": "TRUE", "False": "FALSE",
        "max": "MAX", "min": "MIN", "abs": "ABS", "sqrt": "SQRT",
    }  # fmt: skip

    def name(self, name: str) -> str:
        """As it is; a name may not end with an underscore."""
        return name.rstrip("_")

    def number(self, value: float) -> str:
        """With a decimal point in the mantissa, as the standard asks."""
        mantissa, e, exponent = repr(value).partition("e")
        if e and "." not in mantissa:
            mantissa += ".0"
        return f"{mantissa}E{exponent}" if e else mantissa

    def index(self, array: str, index: str) -> str:
        """``a[i]``."""
        return f"{array}[{index}]"

    def declare(self, name: str, kind: Kind, value: str) -> Iterator[str]:
        """Variables are declared above; here they get their first value."""
        yield f"{name} := {value};"

    def clear(self, name: str, kind: Kind, size: str) -> Iterator[str]:
        """A loop: variables of a function block keep their values from call to call."""
        zero = "0.0" if kind == "Floats" else "FALSE"
        yield f"FOR {COUNTER} := 0 TO {size} - 1 DO {name}[{COUNTER}] := {zero}; END_FOR;"

    def assign(self, target: str, value: str) -> str:
        """``x := y;``."""
        return f"{target} := {value};"

    def block(self, head: Literal["if", "elif", "while"], condition: str) -> str:
        """``IF a THEN``."""
        return (
            f"WHILE {condition} DO"
            if head == "while"
            else f"{head.upper().replace('ELIF', 'ELSIF')} {condition} THEN"
        )

    def loop(self, counter: str, size: str) -> str:
        """``FOR i := 0 TO n - 1 DO``."""
        return f"FOR {counter} := 0 TO {size} - 1 DO"

    def otherwise(self) -> str:
        """``ELSE``."""
        return "ELSE"

    def close(self, head: Literal["if", "while", "for"]) -> str:
        """``END_IF;``."""
        return f"END_{head.upper()};"


def st_source(constants: Mapping[str, float | tuple[float, ...]], about: str) -> str:
    """Text of ``split.st``.

    Each function block holds the constants that it uses: the standard knows global ones in a configuration
    alone, which a file of function blocks has none of.
    """
    printer = StPrinter()
    whole = integers(constants)
    extents = {"ahead_kw": whole["STEPS"], "outlook": whole["N_OUTLOOK"]}
    lines = [f"(* {about} *)"]
    for name, function in functions().items():
        filled = outputs(function)
        heads: dict[str, list[str]] = {"VAR_INPUT": [], "VAR_OUTPUT": [], "VAR": [], "VAR CONSTANT": []}
        for argument, kind in arguments(function).items():
            text = _declared(argument, kind, extents.get(argument, whole["STRINGS"]))
            heads["VAR_OUTPUT" if argument in filled else "VAR_INPUT"].append(text)
        for variable, (kind, size) in locals_of(function).items():
            extent = 0 if size is None else _extent(size, whole)
            heads["VAR"].append(_declared(printer.name(variable), kind, extent))
        heads["VAR"].append(_declared(COUNTER, "int", 0))
        used = {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
        for constant, value in (*places().items(), *constants.items()):
            if constant in used:
                heads["VAR CONSTANT"].append(_constant(constant, value, printer))
        lines += ["", f"FUNCTION_BLOCK {PREFIX}{name.upper()}"]
        for head, declarations in heads.items():
            lines += [head, *(f"{INDENT}{text}" for text in declarations), "END_VAR"]
        lines += [*printer.body(function.body), "END_FUNCTION_BLOCK"]
    return "\n".join(lines) + "\n"


def _constant(name: str, value: float | tuple[float, ...], printer: StPrinter) -> str:
    if isinstance(value, tuple):
        table = printer.listed(value, 2 * INDENT)
        return f"{name} : ARRAY[0..{len(value) - 1}] OF LREAL := [\n{table}];"
    return f"{name} : {'DINT' if type(value) is int else 'LREAL'} := {printer.number(value)};"


def _extent(size: ast.expr, whole: Mapping[str, int]) -> int:
    match size:
        case ast.Constant(int(value)):
            return value
        case ast.Name(name):
            return whole[name]
        case ast.BinOp(left, ast.Add(), right):
            return _extent(left, whole) + _extent(right, whole)
    raise BessError(f"decision.py line {size.lineno}: {ast.unparse(size)}: is no size of an array")


def _declared(name: str, kind: Kind, extent: int) -> str:
    array = f"ARRAY[0..{extent - 1}] OF " if kind in ("Floats", "Flags") else ""
    return f"{name} : {array}{TYPES[kind]};"
