"""Claims: every public name is on the page of the API, and every name on it exists."""

import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import bess

PAGE = Path(__file__).parents[2] / "docs" / "api.rst"
NOT_FOR_PYTHON = {"bess.cli"}
"""The command line has pages of its own."""


def listed() -> list[str]:
    """Full names on the page, each after the module that is current there."""
    names, module, in_summary = [], "", False
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith(".. currentmodule::"):
            module = line.split("::")[1].strip()
        elif line.startswith(".. py:data::"):
            names.append(f"{module}.{line.split('::')[1].strip()}")
        elif line and not line.startswith(" "):
            in_summary = line.startswith(".. autosummary::")
        elif in_summary and (entry := re.fullmatch(r"   ([A-Za-z_][\w.]*)", line)):
            name = entry[1]
            names.append(name if name.startswith("bess.") else f"{module}.{name}")
    return names


def found(name: str) -> object:
    """What a full name stands for."""
    module, _, attribute = name.rpartition(".")
    return getattr(importlib.import_module(module), attribute)


def public() -> dict[str, object]:
    """Every name in ``__all__`` of the package and of its sub-packages."""
    packages = ["bess"]
    packages += [module.name for module in pkgutil.walk_packages(bess.__path__, "bess.") if module.ispkg]
    return {
        f"{package}.{name}": getattr(importlib.import_module(package), name)
        for package in packages
        if package not in NOT_FOR_PYTHON
        for name in getattr(importlib.import_module(package), "__all__", ())
    }


def test_every_public_name_is_on_the_page() -> None:
    """Under one of its names: ``bess.Plant`` and ``bess.plant.Plant`` are one thing."""
    names = set(listed())
    there = {id(found(name)) for name in names if not isinstance(found(name), (int, float, str))}
    missing = [name for name, thing in public().items() if name not in names and id(thing) not in there]
    assert missing == []


@pytest.mark.parametrize("package", ["bess", "bess.ems", "bess.market", "bess.components"])
def test_the_packages_that_a_user_imports_say_what_is_public(package: str) -> None:
    assert any(name.startswith(f"{package}.") and "." not in name[len(package) + 1 :] for name in public())


def test_numbers_that_the_page_quotes_are_those_of_the_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name in ("distil.GENERATIONS", "explicit.N_WEIGHTS", "NO_OPTIMISATION"):
        said = re.search(rf"py:data:: {re.escape(name)}\n\n.*\((\d+)\)\.", page)
        package = "bess" if "." in name else "bess.policies"
        assert said is not None and int(said[1]) == found(f"{package}.{name}")


def test_every_name_on_the_page_exists_and_stands_there_once() -> None:
    names = listed()
    assert len(names) == len(set(names))
    for name in names:
        assert found(name) is not None
