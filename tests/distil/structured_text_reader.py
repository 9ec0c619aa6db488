"""Reads ``split.st`` back: enough of structured text for its function blocks, run as Python.

Both sides of AND and OR are evaluated, as a PLC may do.
"""

from __future__ import annotations

import ast
import re
from types import SimpleNamespace
from typing import Any

_WORDS = [
    (r"\bAND\b", "and"),
    (r"\bOR\b", "or"),
    (r"\bNOT\b", "not"),
    (r"\bTRUE\b", "True"),
    (r"\bFALSE\b", "False"),
    (r"<>", "!="),
    (r"(?<![<>:!])=(?!=)", "=="),
    (r"\bMAX\b", "max"),
    (r"\bMIN\b", "min"),
    (r"\bABS\b", "abs"),
    (r"\bSQRT\b", "sqrt"),
]


class StructuredText:
    """The function blocks of a file, with their constants."""

    def __init__(self, text: str) -> None:
        _, *blocks = re.split(r"^FUNCTION_BLOCK ", text, flags=re.M)
        self.blocks = {block.split(None, 1)[0]: _Block(block) for block in blocks}


class _Block:
    def __init__(self, text: str) -> None:
        self.constants: dict[str, Any] = {}
        for name, array, value in re.findall(r"^    (\w+) : (ARRAY[^:]*|\w+) := ([^;]*);", text, flags=re.M):
            self.constants[name] = (
                [float(x) for x in value.strip("[] \n").split(",")] if "ARRAY" in array else _number(value)
            )
        self.variables: dict[str, Any] = {}
        self.declared: list[str] = []
        sections = re.findall(r"^VAR(?:_INPUT|_OUTPUT)?\n(.*?)^END_VAR\n", text, flags=re.M | re.S)
        for name, kind in re.findall(r"^    (\w+) : (.*);$", "".join(sections), flags=re.M):
            self.declared.append(name)
            length = re.match(r"ARRAY\[0\.\.(\d+)\]", kind)
            zero: Any = {"LREAL": 0.0, "DINT": 0, "BOOL": False}[kind.split()[-1]]
            self.variables[name] = [zero] * (int(length[1]) + 1) if length else zero
        body = text.rpartition("END_VAR\n")[2].partition("END_FUNCTION_BLOCK")[0]
        lines = ["from math import sqrt"]
        depth = 0
        for statement in (line.strip() for line in body.splitlines() if line.strip()):
            if re.match(r"END_\w+;$", statement):
                depth -= 1
                continue
            if re.match(r"ELS", statement):
                depth -= 1
            line, opens = _line(statement)
            lines.append("    " * depth + line)
            depth += opens
        tree = ast.fix_missing_locations(_Eager().visit(ast.parse("\n".join(lines))))
        self._code = compile(tree, "split.st", "exec")

    def __call__(self, **inputs: Any) -> SimpleNamespace:
        names = {
            **self.constants,
            **{k: list(v) if isinstance(v, list) else v for k, v in self.variables.items()},
        }
        exec(self._code, {**names, **inputs}, space := {**names, **inputs})
        return SimpleNamespace(**space)


class _Eager(ast.NodeTransformer):
    """Makes AND and OR evaluate both sides."""

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.Call:
        self.generic_visit(node)
        name = ast.Name("all" if isinstance(node.op, ast.And) else "any", ast.Load())
        return ast.Call(name, [ast.List(node.values, ast.Load())], [])


def _line(statement: str) -> tuple[str, int]:
    if clear := re.fullmatch(r"FOR (\w+) := 0 TO (.*) - 1 DO (\w+)\[\w+\] := (\S+); END_FOR;", statement):
        counter, size, array, value = clear.groups()
        return f"for {counter} in range({size}): {array}[{counter}] = {_expression(value)}", 0
    if loop := re.fullmatch(r"FOR (\w+) := 0 TO (.*) DO", statement):
        return f"for {loop[1]} in range({loop[2]} + 1):", 1
    if branch := re.fullmatch(r"(IF|ELSIF|WHILE) (.*) (?:THEN|DO)", statement):
        return f"{branch[1].lower().replace('elsif', 'elif')} {_expression(branch[2])}:", 1
    if statement == "ELSE":
        return "else:", 1
    if assignment := re.fullmatch(r"(\S.*?) := (.*);", statement):
        return f"{assignment[1]} = {_expression(assignment[2])}", 0
    raise AssertionError(f"not understood: {statement}")


def _expression(text: str) -> str:
    for pattern, word in _WORDS:
        text = re.sub(pattern, word, text)
    return text


def _number(text: str) -> float | int:
    return int(text) if re.fullmatch(r"-?\d+", text) else float(text)
