"""Rows in UTC to a regular series without gaps."""

from itertools import pairwise
from typing import Final, get_args

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.errors import InputError
from bess.files import Fill
from bess.market.clock import Rows
from bess.market.files import fail
from bess.market.repairs import Repairs
from bess.numbers import Array

_HOUR: Final = 3600
_DAY: Final = 24 * _HOUR
_RUN: Final = 3
"""Rows in a row that make another step a change of step, not a gap."""
_SHARE: Final = 0.05
_OFTEN: Final = 8
"""A finer step is one that occurs in this share, or this number, of rows."""


def regular(
    rows: Rows,
    fill: Fill | None,
    repairs: Repairs,
    *,
    longest_step_s: int = _HOUR,
    bridged_s: int = _HOUR,
) -> pd.Series:
    """Return a gap-free series with a regular step, labelled at the interval's start, in UTC.

    Missing values at both ends are cut. Gaps of up to `bridged_s` are bridged by a straight line. Where a
    file changes to a finer step, the coarse values are held if they are no longer than that. All of that is
    reported. With `bridged_s` 0 all of it is refused, unless `fill` says what to do with gaps.

    Raises
    ------
    InputError
        No values; irregular times; a gap longer than `bridged_s` without `fill`.
    """
    if fill is not None and fill not in get_args(Fill):
        raise InputError(f"fill {fill!r} is unknown; allowed are {', '.join(get_args(Fill))}")
    known = np.flatnonzero(~np.isnan(rows.values))
    if known.size < 2:
        first, last = rows.lines[0], rows.lines[-1]
        there = f"from here to line {last} there are {known.size} of {rows.values.size} values"
        fail(rows.path, int(first), f"{there}, and a series needs two; choose another column")
    cut = known[0] + rows.values.size - 1 - known[-1]
    line = rows.lines[0] if known[0] else rows.lines[min(known[-1] + 1, rows.values.size - 1)]
    if cut and not bridged_s and fill is None:
        fail(rows.path, int(line), f"{cut} values at the ends of the series are missing; cut these rows")
    repairs.add("ends-cut", "cut missing values at the ends", cut, line)
    every = rows.take(np.arange(known[0], known[-1] + 1))
    rows = rows.take(known) if bridged_s and _tell_a_step(rows.take(known), every) else every
    seconds = _seconds(rows.utc)
    step, span = _step(rows, np.diff(seconds), longest_step_s, bridged_s)
    place = (seconds - seconds[0]) // step
    _check_share(rows, place, span, step)
    values = np.full(place[-1] + span[-1], np.nan)
    for k in range(int(span.max())):
        held = span > k
        values[place[held] + k] = rows.values[held]
    coarse = span > 1
    if coarse.any():
        text = f"held values of a coarser step over steps of {step // 60} min"
        repairs.add("step-change", text, int(coarse.sum()), rows.lines[int(np.argmax(coarse))])
    _fill_gaps(rows, values, place, step, fill, repairs, bridged_s / _HOUR)
    index = pd.date_range(rows.utc[0], periods=values.size, freq=pd.Timedelta(seconds=step), name="time")
    return pd.Series(values, index=index)


def _tell_a_step(known: Rows, every: Rows) -> bool:
    """Tell whether the rows with values have a step of their own, such as hours among quarter hours.

    A few missing values among a few rows are gaps, and the step is that of the rows.
    """
    step = _usual(np.diff(_seconds(known.utc)))
    often = int((np.diff(_seconds(known.utc)) == step).sum())
    return step <= _usual(np.diff(_seconds(every.utc))) or often >= _OFTEN


def _usual(gaps: npt.NDArray[np.int64]) -> int:
    sizes, counts = np.unique(gaps, return_counts=True)
    return int(sizes[counts == counts.max()].max())


def _check_share(rows: Rows, place: npt.NDArray[np.int64], span: npt.NDArray[np.int64], step: int) -> None:
    """Refuse a series most of which would be invented: its times are hardly meant so."""
    covered, total = int(span[~np.isnan(rows.values)].sum()), int(place[-1] + span[-1])
    if 2 * covered >= total:
        return
    i = int(np.argmax(np.diff(place)))
    fail(
        rows.path,
        int(rows.lines[i + 1]),
        f"follows a gap of {(place[i + 1] - place[i] - 1) * step / _HOUR:g} h from "
        f"{rows.utc[i] + pd.Timedelta(seconds=step):%Y-%m-%d %H:%M} UTC, and only {covered} of {total} steps "
        "have a value; check how the times are written, or choose another file",
    )


def _seconds(utc: pd.DatetimeIndex) -> npt.NDArray[np.int64]:
    return np.asarray(utc.as_unit("s").asi8)


def _step(
    rows: Rows, gaps: npt.NDArray[np.int64], longest_s: int, bridged_s: int
) -> tuple[int, npt.NDArray[np.int64]]:
    """Return the step [s] and how many steps each row covers (1, or more in a part with a coarser step)."""
    sizes, counts = np.unique(gaps, return_counts=True)
    usual = _usual(gaps)
    often = counts >= min(_OFTEN, max(_RUN, _SHARE * gaps.size))
    step = int(min([usual, *(size for size in sizes[often] if usual % size == 0)]))
    odd = gaps % step != 0
    if odd.any():
        i = int(np.argmax(odd))
        fail(
            rows.path,
            int(rows.lines[i + 1]),
            f"comes {gaps[i] / 60:g} min after line {rows.lines[i]}, not a multiple of the step of "
            f"{step / 60:g} min; give a regular series",
        )
    if step > longest_s or _DAY % step:
        fail(
            rows.path,
            int(rows.lines[1]),
            f"the step of {step / _HOUR:g} h does not divide a day, or is above {longest_s / _HOUR:g} h; "
            "export hours or quarter hours",
        )
    span = np.ones(gaps.size + 1, dtype=np.int64)
    edges = np.flatnonzero(np.r_[True, gaps[1:] != gaps[:-1], True])
    for start, end in pairwise(edges):
        if step < gaps[start] <= bridged_s and end - start >= _RUN:
            span[start:end] = gaps[start] // step
            if end == gaps.size:
                span[end] = gaps[start] // step
    return step, span


def _fill_gaps(
    rows: Rows,
    values: Array,
    place: npt.NDArray[np.int64],
    step: int,
    fill: Fill | None,
    repairs: Repairs,
    bridged_h: float,
) -> None:
    """Fill the gaps of `values` in place."""
    missing = np.isnan(values)
    edges = np.flatnonzero(np.diff(np.r_[False, missing, False].astype(np.int8)))
    known = ~missing
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        line = int(rows.lines[np.searchsorted(place, end)])
        duration_h = (end - start) * step / _HOUR
        if duration_h <= bridged_h:
            repairs.add(
                "gap-filled",
                "bridged a gap of up to an hour by a straight line",
                end - start,
                line,
            )
        elif fill is None:
            when = rows.utc[0] + pd.Timedelta(seconds=int(start) * step)
            fail(
                rows.path,
                line,
                f"follows a gap of {duration_h:g} h from {when:%Y-%m-%d %H:%M} UTC"
                f"{f', longer than {bridged_h:g} h' if bridged_h else ''}; complete the file or choose "
                "fill='previous', 'interpolate' or 'previous_day'",
            )
        else:
            repairs.add(f"gap-{fill}", f"filled a gap of {duration_h:g} h ({fill})", end - start, line)
        if duration_h > bridged_h and fill == "previous":
            values[start:end] = values[start - 1]
        elif duration_h > bridged_h and fill == "previous_day":
            if start < _DAY // step:
                fail(
                    rows.path,
                    line,
                    "follows a gap without a day before it; choose fill='interpolate'",
                )
            for position in range(start, end):
                values[position] = values[position - _DAY // step]
        else:
            values[start:end] = np.interp(np.arange(start, end), np.flatnonzero(known), values[known])
