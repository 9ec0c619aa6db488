"""HTTP interface of the OpenEMS power solver, for an edge of commit 66b5cba that requests a split.

The edge sends ``{"SetActivePower": W, "powerDistribution": {"ess0": {"soc": 50}, ...}}`` and accepts
``{"powerDistribution": {"ess0": {"pdist": 60.0}, ...}}``, shares in per cent. It sends charge as an absolute
value, so the direction is lost. :func:`answer` therefore computes the split for both directions, and returns
mean shares. These are optimal if the direction does not matter. If it does, they are a compromise: a fuller
string should discharge more and charge less. The REST channels (:mod:`bess.edge.plant_io.openems`) include
direction, temperatures and limits, and are preferable.

An HTTP service mounts :func:`answer`, which performs no input or output, as a POST route.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from bess.arrays import Array
from bess.edge.plant_io.link import number
from bess.errors import InputError

Split = Callable[[float, Array], Array]
"""Maps demand [kW, positive = discharge] and SOC, shape ``(n_strings,)``, to set-points [kW]."""


def answer(body: object, n_strings: int, split: Split) -> dict[str, Any]:
    """Return the answer to one request of the edge.

    Parameters
    ----------
    body
        The request as parsed JSON. Batteries are taken in the order of the numbers in their names.
    n_strings
        Number of strings of the controller.
    split
        Called twice, with the demand and with its negative.

    Returns
    -------
    dict
        Shares [%] of all batteries in the request; they sum to less than 100 if the plant cannot deliver the
        demand.

    Raises
    ------
    InputError
        The request does not have this form.
    """
    demand_kw, soc = _request(body, n_strings)
    both = [np.asarray(split(sign * demand_kw, np.array(list(soc.values())))) for sign in (1.0, -1.0)]
    shares = 100.0 * np.mean(np.abs(both), axis=0) / demand_kw
    return {
        "powerDistribution": {name: {"pdist": float(share)} for name, share in zip(soc, shares, strict=True)}
    }


def _request(body: object, n_strings: int) -> tuple[float, dict[str, float]]:
    """Return the demand [kW] and SOC, 0 to 1, by name in the order of the strings."""
    request = body if isinstance(body, Mapping) else {}
    asked, batteries = request.get("SetActivePower"), request.get("powerDistribution")
    power_kw = number(asked) / 1000.0
    if not power_kw > 0.0:
        raise InputError(f"SetActivePower: {asked!r}, expected a power above 0 W")
    if not isinstance(batteries, Mapping) or len(batteries) != n_strings:
        count = len(batteries) if isinstance(batteries, Mapping) else "no"
        raise InputError(f"powerDistribution: {count} batteries, expected {n_strings}, one for each string")
    if odd := [name for name in batteries if not re.fullmatch("[A-Za-z0-9_]{1,99}", name)]:
        raise InputError(
            f"powerDistribution: {odd[0][:99]!a}, expected a name of letters and digits, such as ess0"
        )
    soc = {}
    for name in sorted(batteries, key=_natural):
        said = batteries[name].get("soc") if isinstance(batteries[name], Mapping) else None
        soc[name] = share = number(said) / 100.0
        if not 0.0 <= share <= 1.0:
            raise InputError(f"powerDistribution.{name}.soc: {said!r}, expected 0 to 100 %")
    return power_kw, soc


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key by which ess10 comes after ess9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", name)]
