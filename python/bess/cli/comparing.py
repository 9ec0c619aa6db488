"""Runs of several folders under names of their own."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from bess.errors import InputError
from bess.report.runs import Run, runs_in


def runs_of(directories: Iterable[Path]) -> dict[str, Run]:
    """Return the runs of all folders by name, and by folder and name where names would be the same."""
    found = [
        (directory, name, run) for directory in directories for name, run in runs_in(directory)[0].items()
    ]
    if len(found) < 2:
        raise InputError("bess compare needs two runs or more: name two folders, or one of several scenarios")
    names = [name for _, name, _ in found]
    runs: dict[str, Run] = {}
    for directory, name, run in found:
        shown = name
        if names.count(name) > 1:
            shown = directory.name if run.directory == directory else f"{directory.name}/{name}"
        if shown in runs:
            shown = str(run.directory)
        runs[shown] = run
    return runs
