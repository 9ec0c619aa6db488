"""The decision as C99: one header, one source, nothing but ``math.h``."""

from __future__ import annotations

from ast import get_docstring
from collections.abc import Mapping
from typing import Final

from bess.edge.distil.translate import INDENT, Language, arguments, functions, integers, outputs, places

PREFIX: Final = "bess_"
BRACES: Final = {"if": "}", "while": "}", "for": "}"}
C99: Final = Language(
    words={
        "not": "!", "and": "&&", "or": "||", "==": "==", "!=": "!=", "True": "1", "False": "0",
        "max": "larger({0}, {1})", "min": "smaller({0}, {1})", "abs": "fabs({0})", "sqrt": "sqrt({0})",
    },
    types={"float": "double", "int": "int", "bool": "int", "Floats": "double", "Flags": "int"},
    declare="{type} {name} = {value};",
    clear="{type} {name}[{size}] = {{0}};",
    loop="for (int {counter} = 0; {counter} < {size}; {counter}++) {{",
    opens={"if": "if ({0}) {{", "elif": "}} else if ({0}) {{", "while": "while ({0}) {{", "else": "} else {"},
    ends=BRACES,
)  # fmt: skip


def c_header(n_strings: int, steps: int, about: str) -> str:
    """Text of ``split.h``."""
    return f"""/* {about} */
#ifndef BESS_SPLIT_H
#define BESS_SPLIT_H

#define BESS_STRINGS {n_strings}
#define BESS_STEPS {steps}
#define BESS_OUTLOOK {places()["N_OUTLOOK"]}

/* {_summary("look")}
 * ahead_kw: demand of the step that begins and of those after it, positive = discharge, BESS_STEPS values;
 * after the end of a shorter schedule, 0. outlook: BESS_OUTLOOK values, for bess_split. */
{_signature("look")};

/* {_summary("split")}
 * Each array has BESS_STRINGS values. soc and temperature_c are measured; soh_capacity and soh_resistance
 * are capacity and resistance over those of the system file, 1.0 for new strings; limit_kw is the largest
 * power of each inverter, 0.0 where it is out of service. demand_kw is positive in discharge and never above
 * the sum of the limits; request_kw is signed as the demand. */
{_signature("split")};

#endif
"""


def c_source(constants: Mapping[str, float | tuple[float, ...]], about: str) -> str:
    """Text of ``split.c``; compile without contraction of floating-point operations (-ffp-contract=off)."""
    lines = [f"/* {about} */", "#include <math.h>", "", '#include "split.h"', ""]
    lines += [f"enum {{ {name} = {value} }};" for name, value in integers(constants).items()]
    for name, value in constants.items():
        if isinstance(value, tuple):
            table = C99.listed(value, INDENT)
            lines.append(f"static const double {name}[{len(value)}] = {{\n{table}\n}};")
        elif type(value) is not int:
            lines.append(f"static const double {name} = {value!r};")
    lines += ["", "static double larger(double a, double b) { return b > a ? b : a; }"]
    lines += ["static double smaller(double a, double b) { return b < a ? b : a; }"]
    for name, function in functions().items():
        lines += ["", f"{_signature(name)}", "{", *C99.body(function.body), "}"]
    return "\n".join(lines) + "\n"


def _signature(name: str) -> str:
    function = functions()[name]
    filled = outputs(function)
    texts = []
    for argument, kind in arguments(function).items():
        pointer = "*" if kind == "Floats" else ""
        const = "const " if pointer and argument not in filled else ""
        texts.append(f"{const}{C99.types[kind]} {pointer}{argument}")
    return f"void {PREFIX}{name}({', '.join(texts)})"


def _summary(name: str) -> str:
    return (get_docstring(functions()[name]) or "").partition("\n")[0].replace("``", "")
