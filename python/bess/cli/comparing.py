"""Unique names for the runs of several folders."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from bess.errors import InputError
from bess.report.runs import Run, runs_in


def runs_of(directories: Iterable[Path]) -> dict[str, Run]:
    """Return the runs of all folders by name; runs of the same name get their folder as a prefix."""
    found = [
        (directory, name, run) for directory in directories for name, run in runs_in(directory)[0].items()
    ]
    if len(found) < 2:
        raise InputError(
            "bess compare needs at least two runs: specify two folders, or one folder with several scenarios"
        )
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
