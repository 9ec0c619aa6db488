"""The decision as C99: one header, one source, nothing but ``math.h``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Final, Literal

from bess.edge.distil.translate import INDENT, Kind, Printer, arguments, functions, integers, outputs, places

TYPES: Final = {"float": "double", "int": "int", "bool": "int", "Floats": "double", "Flags": "int"}
PREFIX: Final = "bess_"


class CPrinter(Printer):
    """C99."""

    words: ClassVar[dict[str, str]] = {
        "not": "!", "and": "&&", "or": "||", "==": "==", "!=": "!=", "True": "1", "False": "0",
        "max": "larger", "min": "smaller", "abs": "fabs", "sqrt": "sqrt",
    }  # fmt: skip

    def name(self, name: str) -> str:
        """As it is."""
        return name

    def number(self, value: float) -> str:
        """As Python writes it: the shortest text that reads back to the same number."""
        return repr(value)

    def index(self, array: str, index: str) -> str:
        """``a[i]``."""
        return f"{array}[{index}]"

    def declare(self, name: str, kind: Kind, value: str) -> Iterator[str]:
        """``double x = 0.0;``."""
        yield f"{TYPES[kind]} {name} = {value};"

    def clear(self, name: str, kind: Kind, size: str) -> Iterator[str]:
        """``double x[N] = {0};``."""
        yield f"{TYPES[kind]} {name}[{size}] = {{0}};"

    def assign(self, target: str, value: str) -> str:
        """``x = y;``."""
        return f"{target} = {value};"

    def block(self, head: Literal["if", "elif", "while"], condition: str) -> str:
        """``if (a) {``."""
        return f"{ {'elif': '} else if'}.get(head, head) } ({condition}) {{"

    def loop(self, counter: str, size: str) -> str:
        """``for (int i = 0; i < n; i++) {``."""
        return f"for (int {counter} = 0; {counter} < {size}; {counter}++) {{"

    def otherwise(self) -> str:
        """``} else {``."""
        return "} else {"

    def close(self, head: Literal["if", "while", "for"]) -> str:
        """``}``."""
        return "}"


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
    printer = CPrinter()
    lines += [f"enum {{ {name} = {value} }};" for name, value in integers(constants).items()]
    for name, value in constants.items():
        if isinstance(value, tuple):
            table = printer.listed(value, INDENT)
            lines.append(f"static const double {name}[{len(value)}] = {{\n{table}\n}};")
        elif type(value) is not int:
            lines.append(f"static const double {name} = {value!r};")
    lines += ["", "static double larger(double a, double b) { return b > a ? b : a; }"]
    lines += ["static double smaller(double a, double b) { return b < a ? b : a; }"]
    for name, function in functions().items():
        lines += ["", f"{_signature(name)}", "{", *printer.body(function.body), "}"]
    return "\n".join(lines) + "\n"


def _signature(name: str) -> str:
    function = functions()[name]
    filled = outputs(function)
    texts = []
    for argument, kind in arguments(function).items():
        pointer = "*" if kind == "Floats" else ""
        const = "const " if pointer and argument not in filled else ""
        texts.append(f"{const}{TYPES[kind]} {pointer}{argument}")
    return f"void {PREFIX}{name}({', '.join(texts)})"


def _summary(name: str) -> str:
    from ast import get_docstring

    return (get_docstring(functions()[name]) or "").partition("\n")[0].replace("``", "")
