"""Expansion of scenarios and sweep axes to named studies."""

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from os.path import commonpath
from pathlib import Path
from typing import Any

import numpy as np

from bess.errors import InputError
from bess.study.keys import value_at
from bess.study.sections import Axis
from bess.study.study import Study, names_file

_MAX_RUNS = 100_000

Part = tuple[str, Mapping[str, Any]]
"""A scenario or a point of an axis: its part of the name of a run, and the keys that it sets."""


def expand(study: Study) -> dict[str, Study]:
    """Return the runs of a study by name; a study without scenarios and axes is a single run.

    All scenarios and axes are combined. The name of a run consists of the scenario and the last part of each
    swept key with its value, such as ``S2_horizon_steps=4``. It is also the name of the folder.

    Raises
    ------
    InputError
        Unknown key, value out of range, a key that is set twice, or two runs of one folder.
    """
    plain = study.model_copy(update={"scenario": (), "sweep": ()})
    if not study.scenario and not study.sweep:
        return {study.name: plain}
    named: list[Part] = [(each.name, each.set) for each in study.scenario] or [("", {})]
    count = len(named) * math.prod(axis.size for axis in study.sweep)
    if count > _MAX_RUNS:
        many = str(count) if count < 10**15 else "its"
        raise InputError(
            f"{study.name}: sweep: {many} runs exceed the maximum of {_MAX_RUNS}; reduce the axes"
        )
    keys = Counter(key for axis in study.sweep for key in axis.simplex or (axis.key,))
    keys.update({key for scenario in study.scenario for key in scenario.set})
    if twice := [key for key, count in keys.items() if count > 1]:
        raise InputError(
            f"{study.name}: sweep: {twice[0]} is set by several axes, or by scenarios as well; set it in one"
        )
    runs: dict[str, Study] = {}
    folder_of: dict[str, str] = {}
    for parts in itertools.product(named, *map(_points, study.sweep)):
        name = "_".join(filter(None, (label for label, _ in parts)))
        if (earlier := folder_of.setdefault(name.casefold(), name)) in runs:
            raise InputError(
                f"{study.name}: the runs {earlier!r} and {name!r} have one folder; use scenario names and "
                "values that differ, not only in upper and lower case"
            )
        values = {key: value for _, settings in parts for key, value in settings.items()}
        runs[name] = plain.with_values({"name": name, **values})
    return runs


def refined(
    study: Study, runs: Mapping[str, Study], kpis: Mapping[str, Mapping[str, float]]
) -> dict[str, Study]:
    """Return further runs of a search: half-way between the best value and its neighbours.

    Runs without a finite value of the KPI are left out.

    Parameters
    ----------
    study
        The study, whose axis names what to ``maximise``; without it there are no further runs.
    runs, kpis
        Runs so far, and the KPIs of the finished ones, by name.
    """
    axis = next((axis for axis in study.sweep if axis.maximise is not None), None)
    if axis is None or axis.key is None or axis.maximise is None:
        return {}
    if len(study.sweep) > 1 or study.scenario:
        raise InputError(f"{study.name}: sweep.maximise: a search has one axis and no scenarios")
    points, unknown = {}, ""
    for name, run in runs.items():
        value = value_at(run.document(), axis.key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{study.name}: {axis.key} = {value!r}: a search needs numbers")
        if name not in kpis:  # failed
            continue
        found = kpis[name].get(axis.maximise)
        if found is not None and math.isfinite(found):
            points[value] = found
        else:
            unknown = f"run {name} has no such KPI" if found is None else f"it is {found} in run {name}"
    if unknown and not points:
        raise InputError(
            f"{study.name}: sweep.maximise = {axis.maximise!r}: {unknown}; name another "
            "(a net present value needs more than a year)"
        )
    values = sorted(points)
    if len(values) < 2:  # nothing is between
        return {}
    best = max(range(len(values)), key=lambda place: points[values[place]])
    around = values[max(0, best - 1) : best + 2]
    between = (_between(study, axis.key, *pair) for pair in itertools.pairwise(around))
    new = tuple(value for value in between if value not in points)
    return expand(study.model_copy(update={"sweep": (Axis(key=axis.key, values=new),)})) if new else {}


def _between(study: Study, key: str, low: float, high: float) -> float:
    """Return the mean of two values; of integers the one below, if the key needs them."""
    mean = _plain((low + high) / 2.0)
    if isinstance(low, int) and isinstance(high, int) and isinstance(mean, float):
        try:
            study.with_values({key: mean})
        except InputError:
            return (low + high) // 2
    return mean


def _plain(value: float) -> float:
    return int(value) if value == int(value) else value


def _points(axis: Axis) -> Iterator[Part]:
    folder = _common_folder(axis)
    for settings in _settings(axis):
        yield "_".join(_label(key, value, folder) for key, value in settings.items()), settings


def _settings(axis: Axis) -> Iterator[dict[str, Any]]:
    if axis.simplex is not None:
        assert axis.divisions is not None
        # Bars between the keys separate the parts of the total.
        end = axis.divisions + len(axis.simplex) - 1
        for bars in itertools.combinations(range(end), len(axis.simplex) - 1):
            parts = [after - before - 1 for before, after in itertools.pairwise((-1, *bars, end))]
            yield {key: part / axis.divisions for key, part in zip(axis.simplex, parts, strict=True)}
        return
    assert axis.key is not None
    values = axis.values
    if values is None:
        assert axis.start is not None and axis.stop is not None and axis.count is not None
        values = tuple(map(_plain, np.linspace(axis.start, axis.stop, axis.count).tolist()))
    yield from ({axis.key: value} for value in values)


def _common_folder(axis: Axis) -> Path | None:
    """Return the folder of all files of an axis, if there is one: a label names a file from there on."""
    values = axis.values if axis.values is not None and names_file(axis.key or "") else ()
    paths = [Path(value) for value in values if isinstance(value, str)]
    try:
        return Path(commonpath([path.parent for path in paths if path.is_absolute()]))
    except ValueError:  # no files, or files on several drives
        return None


def _label(key: str, value: Any, folder: Path | None) -> str:
    shown = f"{value:.6g}" if isinstance(value, float) else str(value)
    if folder is not None and Path(shown).is_absolute():
        shown = str(Path(shown).relative_to(folder))
    return re.sub(r"[^A-Za-z0-9._=+-]+", "-", f"{key.rpartition('.')[2]}={shown}").strip("-")
