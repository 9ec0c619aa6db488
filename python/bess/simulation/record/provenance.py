"""Provenance of a run, which prevents its continuation with other inputs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import bess
from bess import __version__
from bess.errors import InputError
from bess.files import parse_json
from bess.simulation.record.files import check_file, sha256
from bess.study.study import Study
from bess.system import System

RECORD_FORMAT = 2
"""Version of the layout of a run directory; a run with another version is not continued."""
IDENTITY = "run.json"
Identity = dict[str, Any]

_NOT_PART_OF_A_RUN = ("cli/", "edge/", "report/", "simulation/hindsight/", "simulation/sweep.py")
"""Folders of the package that do not affect the results of a run."""


def identity_of(study: Study, system: System, files: list[Path]) -> Identity:
    """Version and code, resolved study, all numbers of the system, and a hash of every data file."""
    identity = {
        "format": RECORD_FORMAT,
        "version": __version__,
        "code": _code(),
        "study": study.document(),
        "system": system.document,
        "files": {str(path): _sha256(path) for path in files},
    }
    plain: Identity = json.loads(json.dumps(identity, default=str))
    return plain


def read_identity(directory: Path) -> Identity | None:
    """Return the provenance of the run in ``directory``, or None if there is none."""
    try:
        identity: Identity = parse_json((directory / IDENTITY).read_text(encoding="utf-8"))
        check_file(directory / IDENTITY)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise InputError(
            f"{directory / IDENTITY}: is damaged ({error}); use another output folder"
        ) from error
    if not isinstance(identity, dict) or not {"study", "system", "frame"} <= identity.keys():
        raise InputError(f"{directory / IDENTITY}: is damaged; use another output folder")
    return identity


def differences(old: Identity, new: Identity) -> list[str]:
    """Return the differences as ``key: old -> new``; ``frame`` is left out: it follows from other values."""
    before, after = (dict(leaves({**identity, "frame": None})) for identity in (old, new))
    missing = "(not set)"
    return [
        f"{key}: {before.get(key, missing)} -> {after.get(key, missing)}"
        for key in sorted({*before, *after})
        if before.get(key, missing) != after.get(key, missing)
    ]


def leaves(node: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield the dotted key and the JSON text of every value of nested tables."""
    if isinstance(node, Mapping) and node:
        for key, value in node.items():
            yield from leaves(value, f"{prefix}.{key}" if prefix else key)
    elif isinstance(node, list) and any(isinstance(entry, Mapping) for entry in node):
        for index, value in enumerate(node):
            yield from leaves(value, f"{prefix}[{index}]")
    else:
        yield prefix, json.dumps(node)


def _code() -> dict[str, str]:
    """Hashes of the modules and the compiled core that affect the results."""
    package = Path(bess.__file__).parent
    paths = [*package.rglob("*.py"), *package.glob("_core*")]
    names = {path.relative_to(package).as_posix(): path for path in paths if path.suffix != ".pyi"}
    return {
        name: _sha256(path)[:16]
        for name, path in sorted(names.items())
        if not name.startswith(_NOT_PART_OF_A_RUN)
    }


def _sha256(path: Path) -> str:
    try:
        return sha256(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
