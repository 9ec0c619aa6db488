"""Which runs hindsight can say something about: what it proves holds for some kinds of plants only."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr


def unprovable(dataset: xr.Dataset) -> str | None:
    """Return why :func:`bess.hindsight` refuses a record, as the end of a sentence; None where it does not.

    Parameters
    ----------
    dataset : xarray.Dataset
        Record of a run.
    """
    if "reactive_kvar" in dataset:
        return (
            "this run carried reactive power, for which neither the best found nor the bound is proven; "
            "leave out [reactive] of its study"
        )
    if "auxiliary_kw" in dataset:
        return (
            "the plant of this run has a section [cooling]; what is proven impossible is known for air of "
            "the ambient only, without that section"
        )
    if "reversible_heat_kw" in dataset:
        return "the cells of this run have reversible heat, and the lower bound supports ohmic heat only"
    return None
