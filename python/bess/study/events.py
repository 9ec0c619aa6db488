"""Power limits by events: outages and limits of single inverters, announced or not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.study.grid import TimeGrid, seconds_of
from bess.study.sections import Event
from bess.system import System


def check_string(key: str, string: int, system: System) -> None:
    """Raise InputError if a table of a study, at ``key``, names a string that the system does not have."""
    if string >= system.n_strings:
        raise InputError(f"{key}.string = {string}: the system has strings 0 to {system.n_strings - 1}")


def check_events(events: Sequence[Event], system: System, grid: TimeGrid | None = None) -> None:
    """Raise InputError if an event names a string that the system does not have, or is outside the grid."""
    for number, event in enumerate(events):
        check_string(f"event[{number}]", event.string, system)
        nominal_kw = system.nominal_kw[event.string]
        if event.limit_kw > nominal_kw:
            raise InputError(
                f"event[{number}].limit_kw = {event.limit_kw:g}: the inverter of string {event.string} has "
                f"{nominal_kw:g} kW; give less"
            )
        if grid and (seconds_of(event.end) <= grid.start_s or seconds_of(event.start) >= grid.end_s):
            raise InputError(
                f"event[{number}]: {event.start:%Y-%m-%d %H:%M} to {event.end:%Y-%m-%d %H:%M} UTC "
                f"is outside the run, {grid.start:%Y-%m-%d %H:%M} to {grid.end:%Y-%m-%d %H:%M}; change its "
                "dates, or leave it out (event = [] leaves out all of them)"
            )


def limits_of(events: Sequence[Event], system: System, grid: TimeGrid) -> Array:
    """Power of each inverter in service [kW], shape ``(n_steps, n_strings)``.

    Without events it is a view of one row: a decade of a thousand strings would be 3 GB.
    """
    limit = np.broadcast_to(system.nominal_kw, (grid.n_steps, system.n_strings))
    if events:
        limit = limit.copy()
    for event in events:
        first, last = (
            (seconds_of(instant) - grid.start_s) / grid.step_s for instant in (event.start, event.end)
        )
        # A limit that applies to a part of a step applies to the whole step.
        steps = slice(max(0, int(np.floor(first))), max(0, int(np.ceil(last))))
        limit[steps, event.string] = np.minimum(limit[steps, event.string], event.limit_kw)
    return limit
