"""A finished run again under another policy: the same plant, and the same demand, known beforehand."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bess.analysis.provable import unprovable
from bess.ems import Perfect
from bess.errors import InputError
from bess.numbers import Array
from bess.parameters import System
from bess.plant import Plant
from bess.policies import Policy
from bess.record.schema import VARIABLES
from bess.simulation.closed_loop import ClosedLoop
from bess.simulation.demand import ProfileSource
from bess.simulation.inputs import Inputs, limits_of
from bess.study import Study
from bess.study.grid import Grid
from bess.study.plant_choice import build_system

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Replay:
    """What a record says about its run, ready to be run again.

    Attributes
    ----------
    study : Study
        As resolved.
    inputs : Inputs
        System, steps and limits of the run, and its demand as a series that is known.
    record : xarray.Dataset
        The run itself.
    """

    study: Study
    inputs: Inputs
    record: xr.Dataset

    @classmethod
    def of(cls, record: xr.Dataset) -> Replay:
        """Read a record; prices and profiles are in it, so of all files only that of the system is needed.

        Raises
        ------
        InputError
            The record does not say what it is of, its system cannot be read, or nothing can be proven about
            its plant.
        """
        text = record.attrs.get("study")
        if not text:
            raise InputError(
                "hindsight: the record has no study in its attributes, as results of bess.run have"
            )
        if reason := unprovable(record):
            raise InputError(f"hindsight: {reason}")
        study = Study.from_document(tomllib.loads(str(text)), "study of the record")
        system = build_system(study.system, study.run, study.wear)
        seconds = record["time"].values.astype("datetime64[s]").astype(np.int64)
        grid = Grid(int(seconds[0]), round(float(record.attrs["step_h"]) * 3600.0), seconds.size)
        price: Array | None = record["price_eur_mwh"].values if "price_eur_mwh" in record else None
        inputs = Inputs(
            system=system,
            grid=grid,
            horizon_steps=1,
            demand=ProfileSource(Perfect(record["demand_kw"].values)),
            price_eur_mwh=price,
            ambient_c=record["ambient_c"].values,
            limit_kw=limits_of(study.event, system, grid),
            files=[],
            notes=[],
        )
        return cls(study, inputs, record)

    @property
    def system(self) -> System:
        """The plant."""
        return self.inputs.system

    @property
    def served_kw(self) -> Array:
        """Signed demand of every step as far as it is within the power in service [kW]."""
        demand: Array = self.record["demand_kw"].values
        total = self.inputs.limit_kw.sum(axis=1)
        return np.clip(demand, -total, total)

    def under(self, policy: Policy, horizon_steps: int = 1) -> xr.Dataset:
        """Run again under ``policy``, told of so many steps; return a record for key figures and ledger."""
        import xarray as xr

        inputs = replace(self.inputs, horizon_steps=horizon_steps)
        plant = Plant(inputs.system, inputs.system.initial_state(), derating_law=self.study.run.derating_law)
        loop = ClosedLoop(inputs, policy, plant, node_temperatures=False)
        rows: list[dict[str, Any]] = [loop.advance()[0] for _ in range(inputs.grid.n_steps)]
        variables = {name: (VARIABLES[name].dims, np.array([row[name] for row in rows])) for name in rows[0]}
        return xr.Dataset(variables, {"time": self.record["time"]}, self.record.attrs)
