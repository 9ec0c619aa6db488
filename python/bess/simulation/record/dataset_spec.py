"""Times and attributes that turn a record into a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bess import __version__
from bess.control.wear import WearPrices
from bess.plant import Limit
from bess.simulation.record.netcdf import DatasetSpec
from bess.simulation.record.provenance import Identity
from bess.study.grid import TimeGrid
from bess.study.study import Study
from bess.system import System


def describe_frame(
    study: Study, system: System, grid: TimeGrid, statuses: Mapping[int, str]
) -> dict[str, Any]:
    """Plain values, saved with the parts so that a record can be opened without the files of its study."""
    stays = [string.wear.at_end_of_life != "retire" for string in system.strings]
    initial, prices = system.initial_state(), WearPrices.of(system)
    return {
        "start_s": grid.start_s,
        "step_s": grid.step_s,
        "n_steps": grid.n_steps,
        "attrs": {
            "title": study.title or study.name,
            "scenario": study.name,
            "study": study.to_toml(),
            "bess_version": __version__,
            "time_zone": "UTC",
            "step_h": grid.dt_h,
            "initial_soc": initial.soc.tolist(),
            "initial_temperature_c": initial.temperature_c.tolist(),
            "initial_soh_capacity": initial.soh_capacity.tolist(),
            "initial_soh_resistance": initial.soh_resistance.tolist(),
            "wear_eur_per_loss": prices.eur_per_loss.tolist(),
            "residual_eur_per_soh": np.where(stays, prices.eur_per_loss, 0.0).tolist(),
            "end_of_life_soh": prices.end_of_life.tolist(),
        },
        "statuses": {str(code): text for code, text in statuses.items()},
        "limit_flags": {str(int(limit)): str(limit.name).lower() for limit in Limit},
    }


def frame_of(identity: Identity, n_steps: int | None = None) -> DatasetSpec:
    """Return the frame of a run, of its first ``n_steps`` if given."""
    frame = identity["frame"]
    count = frame["n_steps"] if n_steps is None else n_steps
    time = (frame["start_s"] + frame["step_s"] * np.arange(count)).astype("datetime64[s]")
    attrs = {
        key: np.array(value) if isinstance(value, list) else value for key, value in frame["attrs"].items()
    }
    return DatasetSpec(
        time=time,
        attrs=attrs,
        variable_attrs={
            "limits": _flags("flag_masks", frame["limit_flags"]),
            "solver_status": _flags("flag_values", frame["statuses"]),
        },
    )


def _flags(key: str, meanings: Mapping[str, str]) -> dict[str, Any]:
    """CF convention: blank-separated meanings, so a sentence is joined by underscores."""
    words = [
        text.rstrip(".").replace(",", "").replace(";", "").replace(" ", "_") for text in meanings.values()
    ]
    return {key: np.array([int(code) for code in meanings], dtype=np.int32), "flag_meanings": " ".join(words)}
