"""KPIs against the guaranteed figures of the section ``[contract]``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import xarray as xr

_MARGINS = {"round_trip_efficiency_pct": "round_trip_efficiency_pct", "availability_pct": "fulfilment_pct"}
"""Keys of the contract, and the KPIs that they guarantee."""


def contract_kpis(dataset: xr.Dataset, kpis: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    """Yield what a run has above its guarantees, and the throughput that is left of the contract."""
    contract = tomllib.loads(dataset.attrs.get("study", "")).get("contract", {})
    for key, name in _MARGINS.items():
        if key in contract and name in kpis:
            yield f"contract_{key.removesuffix('_pct')}_margin", kpis[name] - contract[key]
    if "throughput_mwh" in contract:
        used_mwh = kpis["discharged_kwh"] / KWH_PER_MWH
        yield "contract_throughput_left_mwh", contract["throughput_mwh"] - used_mwh
