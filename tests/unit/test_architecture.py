"""The order of imports that ARCHITECTURE.md promises, those for annotations included."""

import ast
from pathlib import Path

import pytest

import bess

SOURCE = Path(bess.__file__).parent

# Every folder may import those to its left, never one to its right.
ORDER = [
    ("errors", "units", "_core", "files", "numbers", "convexity", "extras", "display"),
    ("components",),
    ("parameters",),
    ("wear", "explicit"),
    ("market", "plant", "split"),
    ("foresight",),
    ("ems", "policies"),
    ("study",),
    ("record",),
    ("analysis",),
    ("simulation",),
    ("distil",),
    ("retrospect",),
    ("sweep",),
    ("report",),
    ("plants",),
    ("serve",),
    ("cli",),
]
RANK = {name: rank for rank, names in enumerate(ORDER) for name in names}


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("bess."):
            names.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            names |= {a.name.split(".")[1] for a in node.names if a.name.startswith("bess.")}
    return names & RANK.keys()


def test_every_folder_of_code_has_its_place_in_the_order() -> None:
    folders = {path.parent.relative_to(SOURCE).parts[0] for path in SOURCE.glob("*/**/*.py")}
    assert folders - {"data"} <= RANK.keys()


@pytest.mark.parametrize("folder", [name for name in RANK if (SOURCE / name).is_dir()])
def test_imports_run_one_way(folder: str) -> None:
    for path in sorted((SOURCE / folder).rglob("*.py")):
        for name in _imported(path) - {folder}:
            assert RANK[name] < RANK[folder], f"{path.relative_to(SOURCE)} imports bess.{name}"
