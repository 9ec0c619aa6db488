"""Files of a distilled controller: ``policy.json``, and its law in C99 and structured text (IEC 61131-3).

The core contains the source that its control law is compiled from,
``rust/bess-control/src/explicit/decision.rs``. It uses a part of Rust that has a counterpart in other
languages; a :class:`Language` writes its statements.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

from bess import __version__, _core
from bess.control.explicit import ExplicitController
from bess.errors import BessError

INDENT: Final = "    "
COUNTER: Final = "cell"
"""Counter of the loops that clear an array; no variable of the law has this name."""

Constants = Mapping[str, float | tuple[float, ...]]


@dataclass(frozen=True)
class Function:
    """A function of the law.

    ``arguments`` maps names to Rust types, ``variables`` to the type of an element and the size, which is
    empty for a scalar. A statement ends with ``{``, ``}`` or ``;``.
    """

    arguments: Mapping[str, str]
    variables: Mapping[str, tuple[str, str]]
    statements: Sequence[str]
    constants: frozenset[str]


@cache
def _source() -> str:
    """The law without comments; tables and weights are constants in capitals."""
    text = re.sub(r"//.*|\bf64::", "", _core.Explicit.DECISION).replace("MAX_STRINGS", "STRINGS")
    text = re.sub(r"\[(0\.0|false); ([^]]*)\]", r"array(\1, \2)", text)
    return re.sub(r"\bt\.(\w+)|\bweights(?=\[)", lambda found: (found[1] or "weights").upper(), text)


@cache
def places() -> dict[str, int]:
    """Constants of the law itself: positions of weights and of demand features."""
    return {name: int(value) for name, value in re.findall(r"const (\w+): usize = (\d+);", _source())}


@cache
def functions() -> dict[str, Function]:
    """Functions of the law, by name."""
    found = re.findall(r"fn (\w+)\((.*?)\) \{\n(.*?)^\}", _source(), re.DOTALL | re.MULTILINE)
    return {name: _function(arguments, body) for name, arguments, body in found}


def _function(arguments: str, body: str) -> Function:
    given = re.findall(r"(\w+): (&mut \[f64\]|&\[f64\]|f64)", arguments)
    arrays = re.findall(r"let mut (\w+) = array\((\S+), (.*?)\)", body)
    scalars = re.findall(r"let (?:mut )?(\w+): (\w+) =", body)
    counters = re.findall(r"for (\w+) in", body)
    variables = {name: ("f64" if zero == "0.0" else "bool", size) for name, zero, size in arrays}
    variables |= {name: (kind, "") for name, kind in scalars}
    return Function(
        {name: kind for name, kind in given if name != "weights"},
        {**variables, **dict.fromkeys(counters, ("usize", ""))},
        re.findall(r"\} else[^{]*\{|\}|[^{}; ][^{};]*[{;]", " ".join(body.split())),
        frozenset(re.findall(r"\b[A-Z][A-Z_0-9]+\b", body)),
    )


@dataclass(frozen=True)
class Language:
    """Translation of the statements of the law to one language, by regular expressions."""

    words: Mapping[str, str | Callable[[re.Match[str]], str]]
    """Replacements within a statement, first to last."""
    statements: Mapping[str, str]
    """Replacements of a whole statement, in which words are replaced already; the first that fits applies."""
    ends: Mapping[str, str]
    """Ends of ``if``, ``while`` and ``for``."""

    def text(self, expression: str) -> str:
        """An expression in this language."""
        for pattern, word in self.words.items():
            expression = re.sub(pattern, word, expression)
        return expression

    def body(self, function: Function) -> Iterator[str]:
        """Lines of a function, indented."""
        blocks: list[str] = []
        for statement in function.statements:
            closes = statement.startswith("}")
            indent = INDENT * (len(blocks) + (not closes))
            yield indent + (self.ends[blocks.pop()] if statement == "}" else self._line(statement))
            if statement.endswith("{") and not closes:
                blocks.append(statement.split()[0])

    def _line(self, statement: str) -> str:
        text = self.text(statement)
        for pattern, line in self.statements.items():
            if found := re.fullmatch(pattern, text):
                return found.expand(line)
        raise BessError(f"decision.rs: {statement}: has no translation")


_TARGET: Final = r"(\S+|\w+\[.*?\])"
C99: Final = Language(
    words={
        r"\bf64\b": "double",
        r"\b(usize|bool)\b": "int",
        r"\btrue\b": "1",
        r"\bfalse\b": "0",
        r"\babs\(": "fabs(",
    },
    statements={
        r"for (\w+) in 0\.\.(.*) \{": r"for (int \1 = 0; \1 < \2; \1++) {",
        r"(|\} else )(if|while) (.*) \{": r"\1\2 (\3) {",
        r"(\} else \{)": r"\1",
        r"let mut (\w+) = array\(0\.0, (.*)\);": r"double \1[\2] = {0};",
        r"let mut (\w+) = array\(0, (.*)\);": r"int \1[\2] = {0};",
        r"let (?:mut )?(\w+): (\w+) = (.*);": r"\2 \1 = \3;",
        rf"{_TARGET} \+= (.*);": r"\1 = \1 + (\2);",
        rf"({_TARGET} = .*;)": r"\1",
    },
    ends=dict.fromkeys(("if", "while", "for"), "}"),
)
STRUCTURED_TEXT: Final = Language(
    words={
        r"\bf64\b": "LREAL",
        r"\busize\b": "DINT",
        r"&&": "AND",
        r"\|\|": "OR",
        r"!(?!=)": "NOT ",
        r"!=": "<>",
        r"==": "=",
        r"\b(bool|true|false|abs|sqrt)\b": lambda found: found[1].upper(),
        r"\blarger\b": "MAX",
        r"\bsmaller\b": "MIN",
        r"(\w)_\b": r"\1",  # no name ends with an underscore
    },
    statements={
        r"for (\w+) in 0\.\.(.*) \{": r"FOR \1 := 0 TO \2 - 1 DO",
        r"if (.*) \{": r"IF \1 THEN",
        r"\} else if (.*) \{": r"ELSIF \1 THEN",
        r"\} else \{": "ELSE",
        r"while (.*) \{": r"WHILE \1 DO",
        r"let mut (\w+) = array\((\S+), (.*)\);": (
            rf"FOR {COUNTER} := 0 TO \3 - 1 DO \1[{COUNTER}] := \2; END_FOR;"
        ),
        r"let (?:mut )?(\w+): \w+ = (.*);": r"\1 := \2;",  # variables are declared above
        rf"{_TARGET} \+= (.*);": r"\1 := \1 + (\2);",
        rf"{_TARGET} = (.*);": r"\1 := \2;",
    },
    ends={"if": "END_IF;", "while": "END_WHILE;", "for": "END_FOR;"},
)
"""AND evaluates both sides; names are not case-sensitive. Variables of a function block keep their values
between calls, so arrays are cleared by a loop."""


def c_header(constants: Constants, about: str) -> str:
    """Text of ``split.h``."""
    return f"""/* {about} */
#ifndef BESS_SPLIT_H
#define BESS_SPLIT_H

#define BESS_STRINGS {constants["STRINGS"]}
#define BESS_STEPS {constants["STEPS"]}
#define BESS_FEATURES {constants["N_FEATURES"]}

/* Compute the demand features of a forecast.
 * ahead_kw: demand of the step that begins and of those after it, positive = discharge, BESS_STEPS values;
 * after the end of a shorter schedule, 0. features: BESS_FEATURES values, for bess_split. */
{_c_signature("demand_features")};

/* Allocate demand_kw to the strings; request_kw sums to it up to the minimum power.
 * Each array has BESS_STRINGS values. soc and temperature_c are measured; soh_capacity and soh_resistance
 * are capacity and resistance over those of the system file, 1.0 for new strings; limit_kw is the largest
 * power of each inverter, 0.0 where it is out of service. demand_kw is positive in discharge and never above
 * the sum of the limits; request_kw is signed as the demand. */
{_c_signature("split")};

#endif
"""


def c_source(constants: Constants, about: str) -> str:
    """Text of ``split.c``; compile without contraction of floating-point operations (-ffp-contract=off)."""
    lines = [f"/* {about} */", "#include <math.h>", "", '#include "split.h"', ""]
    lines += [f"enum {{ {name} = {value} }};" for name, value in constants.items() if type(value) is int]
    for name, value in constants.items():
        if isinstance(value, tuple):
            lines.append(f"static const double {name}[{len(value)}] = {{\n{_listed(value, INDENT)}\n}};")
        elif type(value) is not int:
            lines.append(f"static const double {name} = {value!r};")
    lines += ["", "static double larger(double a, double b) { return b > a ? b : a; }"]
    lines += ["static double smaller(double a, double b) { return b < a ? b : a; }"]
    for name, function in functions().items():
        lines += ["", _c_signature(name), "{", *C99.body(function), "}"]
    return "\n".join(lines) + "\n"


def _c_signature(name: str) -> str:
    kinds = {"f64": "double ", "&[f64]": "const double *", "&mut [f64]": "double *"}
    texts = (f"{kinds[kind]}{argument}" for argument, kind in functions()[name].arguments.items())
    return f"void bess_{name}({', '.join(texts)})"


def st_source(constants: Constants, about: str) -> str:
    """Text of ``split.st``.

    Each function block contains its constants: the standard allows global ones in a configuration only.
    """
    extents = {"ahead_kw": "STEPS", "features": "N_FEATURES"}

    def declared(name: str, kind: str, size: str = "") -> str:
        parts = [constants.get(part, part) for part in size.split(" + ") if part]
        extent = sum(int(str(part)) for part in parts)
        array = f"ARRAY[0..{extent - 1}] OF " if size else ""
        return STRUCTURED_TEXT.text(f"{name} : {array}{kind};")

    lines = [f"(* {about} *)"]
    for name, function in functions().items():
        heads: dict[str, list[str]] = {"VAR_INPUT": [], "VAR_OUTPUT": [], "VAR": [], "VAR CONSTANT": []}
        for argument, kind in function.arguments.items():
            size = "" if kind == "f64" else extents.get(argument, "STRINGS")
            heads["VAR_OUTPUT" if "mut" in kind else "VAR_INPUT"].append(declared(argument, "f64", size))
        heads["VAR"] += [declared(variable, *kind) for variable, kind in function.variables.items()]
        heads["VAR"].append(declared(COUNTER, "usize"))
        for constant, value in constants.items():
            if constant in function.constants:
                heads["VAR CONSTANT"].append(_st_constant(constant, value))
        lines += ["", f"FUNCTION_BLOCK BESS_{name.upper()}"]
        for head, declarations in heads.items():
            lines += [head, *(f"{INDENT}{text}" for text in declarations), "END_VAR"]
        lines += [*STRUCTURED_TEXT.body(function), "END_FUNCTION_BLOCK"]
    return "\n".join(lines) + "\n"


def _st_constant(name: str, value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return f"{name} : ARRAY[0..{len(value) - 1}] OF LREAL := [\n{_st(_listed(value, 2 * INDENT))}];"
    return f"{name} : {'DINT' if type(value) is int else 'LREAL'} := {_st(repr(value))};"


def _st(numbers: str) -> str:
    """Numbers with a decimal point in the mantissa, as the standard requires."""
    return re.sub(r"(-?\d+)(\.\d+)?e", lambda found: f"{found[1]}{found[2] or '.0'}E", numbers)


def _listed(values: Sequence[float], indent: str) -> str:
    """Numbers of a table, eight on a line."""
    rows = [values[first : first + 8] for first in range(0, len(values), 8)]
    return ",\n".join(indent + ", ".join(repr(float(value)) for value in row) for row in rows)


def constants(controller: ExplicitController) -> Constants:
    """Positions, tables and weights, by their names in the control law."""
    tables = {name.upper(): value for name, value in controller.tables}
    return {**places(), **tables, "WEIGHTS": controller.weights}


def exports(controller: ExplicitController) -> dict[str, str]:
    """Return the contents of the files by file name."""
    tables = controller.tables
    about = (
        f"Power split of {tables.strings} strings ({controller.system}), distilled from study "
        f"{controller.study} by bess {__version__}; kW, positive = discharge."
    )
    values = constants(controller)
    return {
        "policy.json": controller.to_json(),
        "split.c": c_source(values, about),
        "split.h": c_header(values, about),
        "split.st": st_source(values, about),
    }
