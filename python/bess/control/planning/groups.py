"""Groups of similar strings in similar states, for plans of many strings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.system import State, System

MIN_GROUPS = 16
"""Maximum number of strings planned individually, and minimum number of groups for more strings."""
MAX_GROUPS = 32
"""Maximum number of groups, unless there are more kinds of strings."""
MAX_BOUNDED_KINDS = 64
"""Maximum number of kinds of strings for a bound: each kind needs one dynamic program."""
SOC_SPREAD = 0.1
TEMPERATURE_SPREAD_K = 5.0
LIMIT_SPREAD = 0.05
HEALTH_SPREAD = 0.05
"""Maximum differences within a group in SOC, temperature, limit (relative to nominal power) and capacity
(relative to a new string), within :data:`MAX_GROUPS`."""


def kinds_of(system: System, state: State, limit_kw: Array) -> int:
    """Return the number of kinds of strings; strings of one kind differ in SOC and temperature only.

    Limits [kW] have the shape (n_strings, n_steps).
    """
    strings = np.stack([system.kinds, state.soh_capacity, state.soh_resistance], axis=1)
    return len(np.unique(np.hstack([strings, limit_kw]), axis=0))


def groups_of(system: System, state: State, limit_kw: Array) -> NDArray[np.int64] | None:
    """Return the group of each string, shape (n_strings,); -1 for strings out of service in all steps.

    Strings of a group have equal parameters, and each kind of string starts as one group. The group with the
    largest total differences is halved at the median of its largest difference, until there are
    :data:`MIN_GROUPS`. Then only groups above the maximum differences are halved, up to :data:`MAX_GROUPS`.
    Equal strings are halved by number. Limits [kW] have the shape (n_strings, n_steps).

    Returns
    -------
    ndarray or None
        None if each string is planned individually: up to :data:`MIN_GROUPS` strings, none in service, or
        one string per group.
    """
    in_service = np.flatnonzero((limit_kw > 0.0).any(axis=1))
    if system.n_strings <= MIN_GROUPS or not in_service.size:
        return None
    # Steps of equal limits count once.
    limits = np.unique(limit_kw / system.nominal_kw[:, None], axis=1)
    places = np.column_stack(
        [
            state.soc / SOC_SPREAD,
            state.temperature_c / TEMPERATURE_SPREAD_K,
            limits / LIMIT_SPREAD,
            state.soh_capacity / HEALTH_SPREAD,
        ]
    )
    kinds = np.array(system.kinds)[in_service]
    groups = [in_service[kinds == kind] for kind in np.unique(kinds)]
    while len(groups) < min(MAX_GROUPS, in_service.size):
        widths = [np.ptp(places[members], axis=0) for members in groups]
        if len(groups) < MIN_GROUPS:
            # The string number is included, so that equal strings are halved too.
            sizes = [
                members.size * (1.0 + width.sum()) * (members.size > 1)
                for members, width in zip(groups, widths, strict=True)
            ]
        else:
            sizes = [width.max() for width in widths]
            if max(sizes) <= 1.0:
                break
        widest = int(np.argmax(sizes))
        members = groups[widest]
        axis = int(np.argmax(widths[widest]))
        ordered = members[np.argsort(places[members, axis], kind="stable")]
        half = ordered.size // 2
        groups[widest : widest + 1] = [ordered[:half], ordered[half:]]
    if len(groups) == in_service.size:
        return None
    of_string = np.full(system.n_strings, -1, dtype=np.int64)
    for number, members in enumerate(groups):
        of_string[members] = number
    return of_string
