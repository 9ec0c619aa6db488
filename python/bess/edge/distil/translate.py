"""Translations of :mod:`bess.control.explicit.decision` into C99, structured text (IEC 61131-3) and Rust.

Each language is a table of how it writes an expression, a statement, a declaration; :class:`Printer` walks
the syntax tree of the Python source. What the three have in common, and what the source may therefore use, is
said there.
"""

from __future__ import annotations

import ast
import inspect
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import ClassVar, Final, Literal

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


class Printer(ABC):
    """Writes the body of a function in another language, line by line."""

    def __init__(self) -> None:
        self._depth = 1

    # How the language writes things.

    words: ClassVar[dict[str, str]]
    """``not``, ``and``, ``or``, ``==``, ``!=``, ``True``, ``False``, ``max``, ``min``, ``abs``, ``sqrt``."""

    @abstractmethod
    def name(self, name: str) -> str:
        """A variable, an argument, a table or a constant."""

    @abstractmethod
    def number(self, value: float) -> str:
        """A literal."""

    @abstractmethod
    def index(self, array: str, index: str) -> str:
        """An element of an array."""

    @abstractmethod
    def declare(self, name: str, kind: Kind, value: str) -> Iterator[str]:
        """A scalar with its first value."""

    @abstractmethod
    def clear(self, name: str, kind: Kind, size: str) -> Iterator[str]:
        """An array of zeros (or of False)."""

    @abstractmethod
    def assign(self, target: str, value: str) -> str:
        """An assignment."""

    @abstractmethod
    def block(self, head: Literal["if", "elif", "while"], condition: str) -> str:
        """The line that opens a block."""

    @abstractmethod
    def loop(self, counter: str, size: str) -> str:
        """The line that opens a loop from 0 to below ``size``."""

    @abstractmethod
    def otherwise(self) -> str:
        """The line between both branches."""

    @abstractmethod
    def close(self, head: Literal["if", "while", "for"]) -> str:
        """The line that ends a block."""

    def listed(self, values: Sequence[float], indent: str) -> str:
        """Literals of a table, eight on a line."""
        rows = [values[first : first + 8] for first in range(0, len(values), 8)]
        return ",\n".join(indent + ", ".join(self.number(float(value)) for value in row) for row in rows)

    def call(self, function: str, arguments: list[str]) -> str:
        """A call of ``max``, ``min``, ``abs`` or ``sqrt``."""
        return f"{self.words[function]}({', '.join(arguments)})"

    # The walk.

    def expression(self, node: ast.expr) -> str:
        """An expression; every operation in brackets, so that no language has a say in the order.

        Raises
        ------
        BessError
            With the line of the decision that has no translation.
        """
        match node:
            case ast.BinOp(left, operator, right) if type(operator) in SUMS:
                return f"({self.expression(left)} {SUMS[type(operator)]} {self.expression(right)})"
            case ast.UnaryOp(ast.USub(), operand):
                return f"(-{self.expression(operand)})"
            case ast.UnaryOp(ast.Not(), operand):
                return f"({self.words['not']} {self.expression(operand)})"
            case ast.BoolOp(operator, values):
                word = self.words["and" if isinstance(operator, ast.And) else "or"]
                return f"({f' {word} '.join(map(self.expression, values))})"
            case ast.Compare(left, [operator], [right]):
                words = {ast.Eq: self.words["=="], ast.NotEq: self.words["!="], **COMPARISONS}
                return f"({self.expression(left)} {words[type(operator)]} {self.expression(right)})"
            case ast.Constant(value):
                return self.words[str(value)] if isinstance(value, bool) else self.number(value)  # type: ignore[arg-type]
            case ast.Name(name):
                return self.name(name)
            case ast.Subscript(array, index):
                return self.index(self.expression(array), self.expression(index))
            case ast.Call(ast.Name(function), operands):
                return self.call(function, [self.expression(each) for each in operands])
        raise BessError(f"decision.py line {node.lineno}: {ast.unparse(node)}: has no translation")

    def body(self, statements: list[ast.stmt]) -> Iterator[str]:
        """Statements, indented."""
        for statement in statements:
            for line in self._statement(statement):
                yield f"{INDENT * self._depth}{line}"

    def _statement(self, node: ast.stmt) -> Iterator[str]:
        match node:
            case ast.Expr(ast.Constant()):
                return
            case ast.AnnAssign(ast.Name(name), annotation) if _name(annotation) in ("Floats", "Flags"):
                yield from self.clear(self.name(name), _name(annotation), self.expression(_size(node)))  # type: ignore[arg-type]
            case ast.AnnAssign(ast.Name(name), annotation, value) if value is not None:
                yield from self.declare(self.name(name), _name(annotation), self.expression(value))  # type: ignore[arg-type]
            case ast.Assign([target], value):
                yield self.assign(self.expression(target), self.expression(value))
            case ast.AugAssign(target, ast.Add(), value):
                old = self.expression(target)
                yield self.assign(old, f"({old} + {self.expression(value)})")
            case ast.If(test, then, orelse):
                yield self.block("if", self.expression(test))
                yield from self._inner(then)
                while len(orelse) == 1 and isinstance(orelse[0], ast.If):
                    test, then, orelse = orelse[0].test, orelse[0].body, orelse[0].orelse
                    yield self.block("elif", self.expression(test))
                    yield from self._inner(then)
                if orelse:
                    yield self.otherwise()
                    yield from self._inner(orelse)
                yield self.close("if")
            case ast.While(test, statements):
                yield self.block("while", self.expression(test))
                yield from self._inner(statements)
                yield self.close("while")
            case ast.For(ast.Name(counter), ast.Call(ast.Name("range"), [size]), statements):
                yield self.loop(counter, self.expression(size))
                yield from self._inner(statements)
                yield self.close("for")
            case _:
                raise BessError(f"decision.py line {node.lineno}: {ast.unparse(node)}: has no translation")

    def _inner(self, statements: list[ast.stmt]) -> Iterator[str]:
        depth, self._depth = self._depth, 1
        yield from self.body(statements)
        self._depth = depth


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
