"""Translations of :mod:`bess.control.explicit.decision` into C99, structured text (IEC 61131-3) and Rust.

Each language is a table of words and templates, a :class:`Language`, by which the syntax tree of the Python
source is written. What the three have in common, and what the source may therefore use, is said there.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

from bess.control.explicit import decision
from bess.errors import BessError

Kind = Literal["float", "int", "bool", "Floats", "Flags"]

COMPARISONS: Final = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
SUMS: Final = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
INDENT: Final = "    "


@cache
def _module() -> ast.Module:
    return ast.parse(inspect.getsource(decision))


def functions() -> dict[str, ast.FunctionDef]:
    """Functions of the decision, by name."""
    return {node.name: node for node in _module().body if isinstance(node, ast.FunctionDef)}


def places() -> dict[str, int]:
    """Constants of the decision itself: places of weights and of numbers of the outlook."""
    return {name: value for name, value in vars(decision).items() if name.isupper() and type(value) is int}


def arguments(function: ast.FunctionDef) -> dict[str, Kind]:
    """Arguments of a function with their kinds."""
    return {each.arg: _name(each.annotation) for each in function.args.args}  # type: ignore[misc]


def locals_of(function: ast.FunctionDef) -> dict[str, tuple[Kind, ast.expr | None]]:
    """Variables of a function, each with its kind and, for arrays, its size; loop counters included."""
    found: dict[str, tuple[Kind, ast.expr | None]] = {}
    for node in ast.walk(function):
        if isinstance(node, ast.AnnAssign):
            kind: Kind = _name(node.annotation)  # type: ignore[assignment]
            found[_name(node.target)] = (kind, _size(node) if kind in ("Floats", "Flags") else None)
        elif isinstance(node, ast.For):
            found[_name(node.target)] = ("int", None)
    return found


def outputs(function: ast.FunctionDef) -> set[str]:
    """Arguments that a function fills."""
    targets = [
        target.value
        for node in ast.walk(function)
        for target in (node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)])
        if isinstance(target, ast.Subscript)
    ]
    return {_name(target) for target in targets} & arguments(function).keys()


@dataclass(frozen=True)
class Language:
    """How a language writes the decision: words, and templates of lines with named fields.

    Attributes
    ----------
    words : dict
        ``not``, ``and``, ``or``, ``==``, ``!=``, ``True``, ``False``, and the calls ``max``, ``min``,
        ``abs``, ``sqrt`` with their arguments ``{0}``, ``{1}``.
    types : dict
        Type of each kind of variable.
    declare, clear, assign, loop : str
        A scalar with its first value; an array of zeros (or of False); an assignment; the line that opens a
        loop from 0 to below a size.
    opens, ends : dict
        Lines that open ``if``, ``elif``, ``while`` with a condition, and ``else``; lines that end ``if``,
        ``while`` and ``for``.
    name, number : callable
        Text of a variable, argument, table or constant, and of a literal.
    """

    words: Mapping[str, str]
    types: Mapping[Kind, str]
    declare: str
    clear: str
    loop: str
    opens: Mapping[str, str]
    ends: Mapping[str, str]
    assign: str = "{target} = {value};"
    name: Callable[[str], str] = str
    number: Callable[[float], str] = repr

    def listed(self, values: Sequence[float], indent: str) -> str:
        """Literals of a table, eight on a line."""
        rows = [values[first : first + 8] for first in range(0, len(values), 8)]
        return ",\n".join(indent + ", ".join(self.number(float(value)) for value in row) for row in rows)

    def expression(self, node: ast.expr) -> str:
        """An expression; every operation in brackets, so that no language has a say in the order.

        Raises
        ------
        BessError
            With the line of the decision that has no translation.
        """
        write, words = self.expression, self.words
        match node:
            case ast.BinOp(left, operator, right) if type(operator) in SUMS:
                return f"({write(left)} {SUMS[type(operator)]} {write(right)})"
            case ast.UnaryOp(ast.USub(), operand):
                return f"(-{write(operand)})"
            case ast.UnaryOp(ast.Not(), operand):
                return f"({words['not']} {write(operand)})"
            case ast.BoolOp(operator, values):
                word = words["and" if isinstance(operator, ast.And) else "or"]
                return f"({f' {word} '.join(map(write, values))})"
            case ast.Compare(left, [operator], [right]):
                signs = {ast.Eq: words["=="], ast.NotEq: words["!="], **COMPARISONS}
                return f"({write(left)} {signs[type(operator)]} {write(right)})"
            case ast.Constant(value):
                return words[str(value)] if isinstance(value, bool) else self.number(value)  # type: ignore[arg-type]
            case ast.Name(name):
                return self.name(name)
            case ast.Subscript(array, index):
                return f"{write(array)}[{write(index)}]"
            case ast.Call(ast.Name(function), operands):
                return words[function].format(*map(write, operands))
        raise _untranslated(node)

    def body(self, statements: list[ast.stmt]) -> Iterator[str]:
        """Lines of statements, indented."""
        for statement in statements:
            for line in self._statement(statement):
                yield f"{INDENT}{line}"

    def _statement(self, node: ast.stmt) -> Iterator[str]:
        write = self.expression
        match node:
            case ast.Expr(ast.Constant()):
                return
            case ast.AnnAssign(ast.Name(name), annotation, value) if value is not None:
                kind: Kind = _name(annotation)  # type: ignore[assignment]
                is_array = kind in ("Floats", "Flags")
                yield (self.clear if is_array else self.declare).format(
                    name=self.name(name),
                    type=self.types.get(kind),
                    size=write(_size(node)) if is_array else "",
                    value="" if is_array else write(value),
                    zero=self.words["False"] if kind == "Flags" else "0.0",
                )
            case ast.Assign([target], value):
                yield self.assign.format(target=write(target), value=write(value))
            case ast.AugAssign(target, ast.Add(), value):
                yield self.assign.format(target=write(target), value=f"({write(target)} + {write(value)})")
            case ast.If():
                yield from self._branches(node)
                yield self.ends["if"]
            case ast.While(test, statements):
                yield self.opens["while"].format(write(test))
                yield from self.body(statements)
                yield self.ends["while"]
            case ast.For(ast.Name(counter), ast.Call(ast.Name("range"), [size]), statements):
                yield self.loop.format(counter=counter, size=write(size))
                yield from self.body(statements)
                yield self.ends["for"]
            case _:
                raise _untranslated(node)

    def _branches(self, node: ast.If, head: str = "if") -> Iterator[str]:
        """An ``if`` with all of its branches, but for the line that ends it."""
        yield self.opens[head].format(self.expression(node.test))
        yield from self.body(node.body)
        match node.orelse:
            case [ast.If() as following]:
                yield from self._branches(following, "elif")
            case [_, *_]:
                yield self.opens["else"]
                yield from self.body(node.orelse)


def _untranslated(node: ast.expr | ast.stmt) -> BessError:
    return BessError(f"decision.py line {node.lineno}: {ast.unparse(node)}: has no translation")


def integers(constants: Mapping[str, float | tuple[float, ...]]) -> dict[str, int]:
    """What is whole among the decision's own constants and these, by name."""
    return {name: value for name, value in (*places().items(), *constants.items()) if type(value) is int}


def _name(node: object) -> str:
    if isinstance(node, ast.Name):
        return node.id
    raise BessError(f"decision.py: {ast.dump(node) if isinstance(node, ast.AST) else node} is no name")


def _size(node: ast.AnnAssign) -> ast.expr:
    """Size of an array that is declared with ``zeros`` or ``falses``."""
    match node.value:
        case ast.Call(ast.Name("zeros" | "falses"), [size]):
            return size
    raise BessError(f"decision.py line {node.lineno}: an array begins as zeros or falses")
