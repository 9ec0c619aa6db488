"""Claims about docstrings: what a function raises by itself, it says."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import bess

SOURCE = Path(bess.__file__).parent


def own(node: ast.AST) -> Iterator[ast.AST]:
    """What belongs to a function, without the functions inside it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            yield child
            yield from own(child)


def public_functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and (not node.name.startswith("_") or node.name == "__call__"):
            setters = [part for part in node.decorator_list if ast.unparse(part).endswith(".setter")]
            if not setters:  # a property is described where it is read
                yield node


def test_every_public_function_that_raises_says_so() -> None:
    silent, raising = [], 0
    for path in sorted(SOURCE.rglob("*.py")):
        if path.parent.name == "cli":  # docstrings of commands are what --help shows
            continue
        for function in public_functions(ast.parse(path.read_text(encoding="utf-8"))):
            if any(isinstance(part, ast.Raise) and part.exc is not None for part in own(function)):
                raising += 1
                said = ast.get_docstring(function) or ""
                if "\nRaises\n------" not in said and not re.match(r"Raise .*Error", said):
                    silent.append(f"{path.relative_to(SOURCE)}:{function.lineno} {function.name}")
    assert raising > 100
    assert silent == []
