"""Claims: every public name is on the page of the API, and every name on it exists."""

import importlib
import pkgutil
import re

import pytest

import bess
from api_page import PAGE, found, listed

NOT_FOR_PYTHON = {"bess.cli"}
"""The command line has pages of its own."""


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


@pytest.mark.parametrize("package", ["bess", "bess.dispatch", "bess.market", "bess.system.components"])
def test_the_packages_that_a_user_imports_say_what_is_public(package: str) -> None:
    assert any(name.startswith(f"{package}.") and "." not in name[len(package) + 1 :] for name in public())


def test_numbers_that_the_page_quotes_are_those_of_the_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for name in ("edge.distil.GENERATIONS", "control.explicit.N_WEIGHTS", "NO_OPTIMISATION"):
        said = re.search(rf"py:data:: {re.escape(name)}\n\n.*\((\d+)\)\.", page)
        package = "bess" if "." in name else "bess.control.policies"
        assert said is not None and int(said[1]) == found(f"{package}.{name}")


def test_every_name_on_the_page_exists_and_stands_there_once() -> None:
    names = listed()
    assert len(names) == len(set(names))
    for name in names:
        assert found(name) is not None


def test_the_page_on_policies_names_every_bundled_one() -> None:
    from bess.control.policies import POLICIES

    page = PAGE.with_name("howto") / "policies.md"
    bundled = page.read_text(encoding="utf-8").partition("Bundled policies are ")[2].partition("## ")[0]
    assert set(re.findall(r"(?<!})`(\w+)`", bundled)) == set(POLICIES)
