"""Rows in UTC to a gap-free series with a regular step."""

from itertools import pairwise
from typing import Final, NoReturn, get_args

import numpy as np
import numpy.typing as npt
import pandas as pd

from bess.files import Fill
from bess.market.files import Repairs, fail
from bess.units import SECONDS_PER_DAY, SECONDS_PER_HOUR

_RUN: Final = 3
"""Rows in a row that make another step a change of step, not a gap."""
_SHARE: Final = 0.05
_MIN_ROWS_OF_A_STEP: Final = 8
"""A finer step is one that occurs in this share, or this number, of rows."""

Counts = npt.NDArray[np.int64]


def regular(
    rows: pd.DataFrame,
    fill: Fill | None,
    repairs: Repairs,
    *,
    max_step_h: float = 1.0,
    bridged_h: float = 1.0,
) -> pd.Series:
    """Return a gap-free series with a regular step, labelled at the interval's start, in UTC.

    Missing values at both ends are cut. Gaps of up to `bridged_h` are bridged by a straight line. Where a
    file changes to a finer step, coarse values of up to `bridged_h` are held. These repairs are reported.
    With `bridged_h` 0 they are errors, unless `fill` gives a method for gaps.
    """
    if fill is not None and fill not in get_args(Fill):
        fail(None, f"fill {fill!r} is unknown; allowed are {', '.join(get_args(Fill))}")
    known = np.flatnonzero(rows["value"].notna())
    if known.size < 2:
        _fail_without_series(rows, known.size)
    every, present = rows.iloc[known[0] : known[-1] + 1], rows.iloc[known]
    cut = len(rows) - len(every)
    line = rows.index[0 if known[0] else min(known[-1] + 1, len(rows) - 1)]
    if cut and not bridged_h and fill is None:
        fail(line, f"{cut} values at the ends of the series are missing; cut these rows")
    repairs.add("ends-cut", "cut missing values at the ends", cut, line)
    rows = present if bridged_h and _tell_a_step(present, every) else every
    seconds = _seconds(rows)
    step, span = _step(rows, np.diff(seconds), max_step_h, bridged_h)
    place = (seconds - seconds[0]) // step
    _check_share(rows, place, span, step)
    index = pd.date_range(
        rows["utc"].iloc[0], periods=place[-1] + span[-1], freq=pd.Timedelta(seconds=step), name="time"
    )
    values = np.full(index.size, np.nan)
    for k in range(int(span.max())):
        held = span > k
        values[place[held] + k] = rows["value"].to_numpy()[held]
    text = f"held values of a coarser step over steps of {step // 60} min"
    repairs.add_where("step-change", text, pd.Series(span > 1, rows.index))
    series = pd.Series(values, index=index)
    _fill_gaps(series, rows.index[np.searchsorted(place, np.arange(index.size))], fill, repairs, bridged_h)
    return series


def _fail_without_series(rows: pd.DataFrame, n_values: int) -> NoReturn:
    """Raise InputError for rows with less than two values."""
    if len(rows) == 1:
        found = "is the only row" if n_values else "is the only row, and its value is missing"
        remedy = "give a longer file"
    else:
        found = f"of {len(rows)} rows from here to line {rows.index[-1]}, {n_values or 'none'} has a value"
        remedy = "choose another column"
    fail(rows.index[0], f"{found}; a series needs two values: {remedy}")


def _tell_a_step(known: pd.DataFrame, every: pd.DataFrame) -> bool:
    """Return whether the rows with values have a coarser regular step, such as hours among quarter hours.

    In short series, a few missing values are gaps and do not change the step.
    """
    gaps = np.diff(_seconds(known))
    step = _usual(gaps)
    return step <= _usual(np.diff(_seconds(every))) or int((gaps == step).sum()) >= _MIN_ROWS_OF_A_STEP


def _usual(gaps: Counts) -> int:
    sizes, counts = np.unique(gaps, return_counts=True)
    return int(sizes[counts == counts.max()].max())


def _seconds(rows: pd.DataFrame) -> Counts:
    return np.asarray(pd.DatetimeIndex(rows["utc"]).as_unit("s").asi8)


def _check_share(rows: pd.DataFrame, place: Counts, span: Counts, step: int) -> None:
    """Raise InputError if most values would have to be filled in: the times are then probably misread."""
    covered, total = int(span[rows["value"].notna()].sum()), int(place[-1] + span[-1])
    if 2 * covered >= total:
        return
    i = int(np.argmax(np.diff(place)))
    gap_h = (place[i + 1] - place[i] - 1) * step / SECONDS_PER_HOUR
    begin = rows["utc"].iloc[i] + pd.Timedelta(seconds=step)
    fail(
        rows.index[i + 1],
        f"follows a gap of {gap_h:g} h from {begin:%Y-%m-%d %H:%M} UTC, and only {covered} of {total} steps "
        "have a value; check how the times are written, or choose another file",
    )


def _step(rows: pd.DataFrame, gaps: Counts, max_step_h: float, bridged_h: float) -> tuple[int, Counts]:
    """Return the step [s] and how many steps each row covers (1, or more in a part with a coarser step)."""
    sizes, counts = np.unique(gaps, return_counts=True)
    usual = _usual(gaps)
    often = counts >= min(_MIN_ROWS_OF_A_STEP, max(_RUN, _SHARE * gaps.size))
    step = int(min([usual, *(size for size in sizes[often] if usual % size == 0)]))
    odd = gaps % step != 0
    if odd.any():
        i = int(np.argmax(odd))
        fail(
            rows.index[i + 1],
            f"comes {gaps[i] / 60:g} min after line {rows.index[i]}, not a multiple of the step of "
            f"{step / 60:g} min; give a regular series",
        )
    step_h = step / SECONDS_PER_HOUR
    if step_h > max_step_h or SECONDS_PER_DAY % step:
        fail(
            rows.index[1],
            f"the step of {step_h:g} h does not divide a day, or is above {max_step_h:g} h; "
            "export hours or quarter hours",
        )
    span = np.ones(gaps.size + 1, dtype=np.int64)
    edges = np.flatnonzero(np.r_[True, gaps[1:] != gaps[:-1], True])
    for start, end in pairwise(edges):
        if step < gaps[start] <= bridged_h * SECONDS_PER_HOUR and end - start >= _RUN:
            span[start : end + (end == gaps.size)] = gaps[start] // step
    return step, span


def _fill_gaps(
    series: pd.Series, lines: pd.Index, fill: Fill | None, repairs: Repairs, bridged_h: float
) -> None:
    """Fill the gaps of a series in place; `lines` are the line numbers of the row at or after each step."""
    index = pd.DatetimeIndex(series.index)
    values, missing = series.to_numpy(copy=True), series.isna().to_numpy()
    values[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(~missing), values[~missing])
    edges = np.flatnonzero(np.diff(np.r_[False, missing, False].astype(np.int8)))
    day = round(pd.Timedelta(days=1) / (index[1] - index[0]))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        line, duration_h = lines[end], float((end - start) * (index[1] - index[0]) / pd.Timedelta(hours=1))
        if duration_h <= bridged_h:
            text = "bridged a gap of up to an hour by a straight line"
            repairs.add("gap-filled", text, end - start, line)
            continue
        if fill is None:
            limit = f", longer than {bridged_h:g} h" if bridged_h else ""
            fail(
                line,
                f"follows a gap of {duration_h:g} h from {index[start]:%Y-%m-%d %H:%M} UTC{limit}; "
                "complete the file or choose fill='previous', 'interpolate' or 'previous_day'",
            )
        repairs.add(f"gap-{fill}", f"filled a gap of {duration_h:g} h ({fill})", end - start, line)
        if fill == "previous":
            values[start:end] = values[start - 1]
        if fill == "previous_day":
            if start < day:
                fail(line, "follows a gap without a day before it; choose fill='interpolate'")
            for position in range(start, end):
                values[position] = values[position - day]
    series[:] = values
