"""The order of imports that ARCHITECTURE.md promises, lazy ones and those for annotations included."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import bess

SOURCE = Path(bess.__file__).parent

# A room may import those above it, never one beside or below it; single modules of the package come first.
ROOMS = [
    (
        "errors",
        "units",
        "_core",
        "files",
        "arrays",
        "checkpoints",
        "convexity",
        "optional_dependencies",
        "display",
    ),
    ("system",),
    ("market", "control"),
    ("plant", "dispatch"),
    ("study",),
    ("simulation",),
    ("report",),
    ("edge",),
    ("cli",),
]
# The same inside the rooms that have rooms of their own; a module beside them is named as it is.
INNER = {
    "system": [("components",), ("",)],
    "control": [("",), ("wear", "explicit", "split", "planning"), ("policies",)],
    "simulation": [("record",), ("analysis",), ("",), ("hindsight", "sweep")],
    "edge": [("distil",), ("plant_io",), ("serve",)],
}
# `Result.plot` draws; whoever reads a record needs no library for figures before.
EXCEPT = {
    ("simulation/record/result.py", name) for name in ("bess.report.figures", "bess.report.figures.Plot")
}


def _ranks(order: list[tuple[str, ...]]) -> dict[str, int]:
    return {name: rank for rank, names in enumerate(order) for name in names}


def _imported(path: Path) -> set[str]:
    """Modules of this package that a file imports, wherever in the file, and however."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value:
            names.add(node.value)  # import_module("bess.report.figures")
    return {name for name in names if name.startswith("bess.") and "://" not in name}


def _inner_room(room: str, parts: tuple[str, ...]) -> str:
    inner = {name for names in INNER[room] for name in names}
    return parts[0] if parts and parts[0] in inner else ""


def test_every_folder_of_code_has_its_place_in_the_order() -> None:
    folders = {path.parent.relative_to(SOURCE).parts[0] for path in SOURCE.glob("*/**/*.py")}
    assert folders - {"data"} <= _ranks(ROOMS).keys()


@pytest.mark.parametrize("room", [name for name in _ranks(ROOMS) if (SOURCE / name).is_dir()])
def test_imports_run_one_way(room: str) -> None:
    ranks = _ranks(ROOMS)
    for path in sorted((SOURCE / room).rglob("*.py")):
        for name in _imported(path):
            other, file = name.split(".")[1], path.relative_to(SOURCE).as_posix()
            if other in ranks and other != room and (file, name) not in EXCEPT:
                assert ranks[other] < ranks[room], f"{file} imports {name}"


@pytest.mark.parametrize("room", INNER)
def test_imports_run_one_way_inside_a_package(room: str) -> None:
    ranks = _ranks(INNER[room])
    for path in sorted((SOURCE / room).rglob("*.py")):
        here = _inner_room(room, path.relative_to(SOURCE / room).parts[:-1])
        for name in _imported(path):
            parts = name.split(".")
            if parts[1] == room and len(parts) > 2:
                other = _inner_room(room, tuple(parts[2:]))
                if other != here:
                    assert ranks[other] < ranks[here], f"{path.relative_to(SOURCE)} imports {name}"


def test_no_module_imports_itself_through_others() -> None:
    modules = {
        ".".join(("bess", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__"): path
        for path in SOURCE.rglob("*.py")
    }

    def module_of(name: str) -> str:
        while name not in modules:
            name = name.rpartition(".")[0]
        return name

    order = TopologicalSorter[str]()
    for module, path in modules.items():
        file = path.relative_to(SOURCE).as_posix()
        own = f"bess.{'.'.join(path.relative_to(SOURCE).parts[:-1])}"  # the package of its templates
        names = {name for name in _imported(path) if (file, name) not in EXCEPT and name != own}
        others = {module_of(name) for name in names}
        order.add(module, *others - {"bess", module})
    order.prepare()  # a CycleError names the modules of a circle
