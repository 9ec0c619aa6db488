"""Claims about docstrings: what a function of the API raises by itself, it says."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator

from api_page import found, listed


def own(node: ast.AST) -> Iterator[ast.AST]:
    """What belongs to a function, without the functions inside it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            yield child
            yield from own(child)


def public_functions() -> dict[str, ast.FunctionDef]:
    """Functions on the page of the API, and methods and properties of its classes."""
    functions = {}
    for name in listed():
        thing = found(name)
        members = vars(thing) if inspect.isclass(thing) else {"": thing}
        for label, member in members.items():
            function = getattr(member, "fget", None) or getattr(member, "__func__", member)
            if inspect.isfunction(function) and (not label.startswith("_") or label == "__call__"):
                source = textwrap.dedent(inspect.getsource(inspect.unwrap(function)))
                definition = ast.parse(source).body[0]
                if isinstance(definition, ast.FunctionDef):
                    functions[f"{name}.{label}"] = definition
    return functions


def test_every_function_of_the_api_that_raises_says_so() -> None:
    silent, raising = [], 0
    for name, function in public_functions().items():
        if any(isinstance(part, ast.Raise) and part.exc is not None for part in own(function)):
            raising += 1
            said = ast.get_docstring(function) or ""
            if "\nRaises\n------" not in said and not re.match(r"Raise .*Error", said):
                silent.append(name)
    assert raising > 40
    assert silent == []
