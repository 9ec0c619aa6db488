"""The decision as structured text (IEC 61131-3): two function blocks that need nothing else."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Final

from bess.edge.distil.translate import (
    INDENT,
    Kind,
    Language,
    arguments,
    functions,
    integers,
    locals_of,
    outputs,
    places,
)
from bess.errors import BessError

PREFIX: Final = "BESS_"
COUNTER: Final = "cell"
"""Counter of the loops that clear an array; no variable of the decision has this name."""


def _named(name: str) -> str:
    """As it is; a name may not end with an underscore."""
    return name.rstrip("_")


def _number(value: float) -> str:
    """With a decimal point in the mantissa, as the standard asks."""
    mantissa, e, exponent = repr(value).partition("e")
    if e and "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}E{exponent}" if e else mantissa


STRUCTURED_TEXT: Final = Language(
    words={
        "not": "NOT", "and": "AND", "or": "OR", "==": "=", "!=": "<>", "True": "TRUE", "False": "FALSE",
        "max": "MAX({0}, {1})", "min": "MIN({0}, {1})", "abs": "ABS({0})", "sqrt": "SQRT({0})",
    },
    types={"float": "LREAL", "int": "DINT", "bool": "BOOL", "Floats": "LREAL", "Flags": "BOOL"},
    declare="{name} := {value};",  # variables are declared above
    clear=f"FOR {COUNTER} := 0 TO {{size}} - 1 DO {{name}}[{COUNTER}] := {{zero}}; END_FOR;",
    loop="FOR {counter} := 0 TO {size} - 1 DO",
    opens={"if": "IF {0} THEN", "elif": "ELSIF {0} THEN", "while": "WHILE {0} DO", "else": "ELSE"},
    ends={"if": "END_IF;", "while": "END_WHILE;", "for": "END_FOR;"},
    assign="{target} := {value};",
    name=_named,
    number=_number,
)  # fmt: skip
"""AND evaluates both sides; names are not case-sensitive. Variables of a function block keep their values
from call to call, so arrays are cleared by a loop."""


def st_source(constants: Mapping[str, float | tuple[float, ...]], about: str) -> str:
    """Text of ``split.st``.

    Each function block holds the constants that it uses: the standard knows global ones in a configuration
    alone, which a file of function blocks has none of.
    """
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
            heads["VAR"].append(_declared(_named(variable), kind, extent))
        heads["VAR"].append(_declared(COUNTER, "int", 0))
        used = {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
        for constant, value in (*places().items(), *constants.items()):
            if constant in used:
                heads["VAR CONSTANT"].append(_constant(constant, value))
        lines += ["", f"FUNCTION_BLOCK {PREFIX}{name.upper()}"]
        for head, declarations in heads.items():
            lines += [head, *(f"{INDENT}{text}" for text in declarations), "END_VAR"]
        lines += [*STRUCTURED_TEXT.body(function.body), "END_FUNCTION_BLOCK"]
    return "\n".join(lines) + "\n"


def _constant(name: str, value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        table = STRUCTURED_TEXT.listed(value, 2 * INDENT)
        return f"{name} : ARRAY[0..{len(value) - 1}] OF LREAL := [\n{table}];"
    return f"{name} : {'DINT' if type(value) is int else 'LREAL'} := {_number(value)};"


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
    return f"{name} : {array}{STRUCTURED_TEXT.types[kind]};"
