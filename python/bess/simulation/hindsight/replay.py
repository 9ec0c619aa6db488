"""Replay of a finished run under another policy, with the same plant and perfect forecast of its demand."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bess.arrays import Array
from bess.control.policies import Policy
from bess.dispatch import PerfectForecast
from bess.errors import InputError
from bess.plant import Plant
from bess.simulation.closed_loop import ClosedLoop
from bess.simulation.demand import ProfileSource
from bess.simulation.inputs import Inputs, limits_of
from bess.simulation.installations import Installations
from bess.simulation.reactive_demand import Foreseen
from bess.simulation.record.schema import VARIABLES
from bess.study import Study
from bess.study.grid import TimeGrid
from bess.study.plant_choice import build_system
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr

_AT_THE_METER = (
    "load_kw",
    "generation_kw",
    "grid_limit_kw",
    "export_price_eur_mwh",
    "demand_charge_eur_kw_h",
    "export_limit_kw",
    "peak_price_eur_kw",
    "billing_month",
    "position_kw",
    "auction_price_eur_mwh",
)
"""Variables of a record that the ledger needs and that do not depend on the split."""


@dataclass(frozen=True)
class Replay:
    """Inputs of a recorded run, for a replay.

    Attributes
    ----------
    study : Study
        As resolved.
    inputs : Inputs
        System, steps and limits of the run, and its demand as a known series.
    record : xarray.Dataset
        Record of the run.
    """

    study: Study
    inputs: Inputs
    record: xr.Dataset

    @classmethod
    def of(cls, record: xr.Dataset, system: System | None = None) -> Replay:
        """Read a record. It contains prices and profiles, so only the system file is needed.

        Raises
        ------
        InputError
            The record does not contain its study, or its system is not given and cannot be read.
        """
        text = record.attrs.get("study")
        if not text:
            raise InputError(
                "hindsight: the record has no study in its attributes, as results of bess.run have"
            )
        study = Study.from_document(tomllib.loads(str(text)), "study of the record")
        system = system or build_system(study.system, study.run, study.wear)
        seconds = record["time"].values.astype("datetime64[s]").astype(np.int64)
        grid = TimeGrid(int(seconds[0]), round(float(record.attrs["step_h"]) * 3600.0), seconds.size)
        price: Array | None = record["price_eur_mwh"].values if "price_eur_mwh" in record else None
        inputs = Inputs(
            system=system,
            grid=grid,
            horizon_steps=1,
            demand=ProfileSource(PerfectForecast(record["demand_kw"].values)),
            price_eur_mwh=price,
            ambient_c=record["ambient_c"].values,
            limit_kw=limits_of(study.event, system, grid),
            installations=Installations(system, study, grid),
            files=[],
            notes=[],
            series={name: record[name].values for name in _AT_THE_METER if name in record},
            reactive=(
                Foreseen(PerfectForecast(record["reactive_demand_kvar"].values))
                if "reactive_demand_kvar" in record
                else None
            ),
        )
        return cls(study, inputs, record)

    @property
    def system(self) -> System:
        """The plant."""
        return self.inputs.system

    @property
    def served_kw(self) -> Array:
        """Signed demand of every step, without unmet demand [kW]."""
        demand: Array = self.record["demand_kw"].values
        total = self.inputs.limit_kw.sum(axis=1)
        return np.clip(demand, -total, total)

    def under(self, policy: Policy, horizon_steps: int = 1) -> xr.Dataset:
        """Simulate ``policy`` with this forecast length [steps]; return a record for KPIs and ledger."""
        import xarray as xr

        installations = Installations(self.system, self.study, self.inputs.grid)
        inputs = replace(self.inputs, horizon_steps=horizon_steps, installations=installations)
        plant = Plant(inputs.system, inputs.system.initial_state(), derating_law=self.study.run.derating_law)
        loop = ClosedLoop(inputs, policy, plant, node_temperatures=False)
        rows: list[dict[str, Any]] = [loop.advance()[0] for _ in range(inputs.grid.n_steps)]
        variables = {name: (VARIABLES[name].dims, np.array([row[name] for row in rows])) for name in rows[0]}
        return xr.Dataset(variables, {"time": self.record["time"]}, self.record.attrs)
