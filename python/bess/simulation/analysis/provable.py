"""Applicability of hindsight: its lower bound is valid for some kinds of plants only."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr


def unprovable(dataset: xr.Dataset) -> str | None:
    """Return the reason why :func:`bess.hindsight` does not support a record; None if it does.

    Parameters
    ----------
    dataset : xarray.Dataset
        Record of a run.
    """
    if "reactive_kvar" in dataset:
        return (
            "this run carried reactive power, which hindsight does not support; "
            "leave out [reactive] of its study"
        )
    if "auxiliary_kw" in dataset:
        return (
            "the plant of this run has a section [cooling], and the lower bound supports ambient-air cooling "
            "only"
        )
    if "investment_eur" in dataset:
        return "strings of this run are added, replaced or retired, which hindsight does not support"
    if "reversible_heat_kw" in dataset:
        return "the cells of this run have reversible heat, and the lower bound supports ohmic heat only"
    return None
