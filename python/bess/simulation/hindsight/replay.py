"""Replays of a finished run under other policies: same plant, start, weather and (known) demand."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bess.arrays import Array
from bess.control.policies import Policy
from bess.control.policies.registry import RULES
from bess.control.policies.rule import RulePolicy
from bess.dispatch import PerfectForecast
from bess.errors import InputError
from bess.plant import Plant
from bess.simulation.analysis.kpis import kpis
from bess.simulation.analysis.services import is_reserve, is_site
from bess.simulation.closed_loop import ClosedLoop
from bess.simulation.inputs import Inputs, known_reactive
from bess.simulation.installations import Installations
from bess.simulation.record.dataset import VARIABLES, begins_with_run, check_record, fingerprint
from bess.study import Study
from bess.study.demands.profile import ProfileSource
from bess.study.events import limits_of
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


_DRAWN_KW = "drawn_kw"


@dataclass(frozen=True)
class Replay:
    """Inputs of a recorded run, for a replay."""

    study: Study
    inputs: Inputs
    """System, steps and limits of the run, and its demand as a known series."""
    record: xr.Dataset

    @classmethod
    def of(cls, record: xr.Dataset, system: System | None = None) -> Replay:
        """Read a record. It contains prices and profiles, so only the system file is needed."""
        text = record.attrs.get("study")
        if not text:
            raise InputError(
                "hindsight: the record has no study in its attributes, as results of bess.run have"
            )
        check_record(record, ("demand_kw", "ambient_c", "chemical_kw"), "hindsight")
        if not begins_with_run(record):
            raise InputError(
                "hindsight: the record is a later part of a run; give the record from its start on"
            )
        study = Study.from_document(tomllib.loads(str(text)), "study of the record")
        if system is None:
            system = build_system(study.system, study.run, study.wear)
            if record.attrs.get("system_sha256", fingerprint(system)) != fingerprint(system):
                raise InputError(
                    f"hindsight: the run had another system than system.file = {study.system.file!r} is now; "
                    "give the result of bess.run, or use bess report DIR --hindsight"
                )
        grid = TimeGrid.of_record(record)
        limit_kw = limits_of(study.event, system, grid)
        price: Array | None = record["price_eur_mwh"].values if "price_eur_mwh" in record else None
        inputs = Inputs(
            system=system,
            grid=grid,
            horizon_steps=1,
            demand=ProfileSource(PerfectForecast(record["demand_kw"].values)),
            price_eur_mwh=price,
            ambient_c=record["ambient_c"].values,
            limit_kw=limit_kw,
            announced_kw=limit_kw,
            unannounced_kw=np.broadcast_to(system.nominal_kw, limit_kw.shape),
            installations=Installations(system, study, grid),
            files=[],
            notes=[],
            series={name: record[name].values for name in _AT_THE_METER if name in record},
            reactive=(
                known_reactive(PerfectForecast(record["reactive_demand_kvar"].values))
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

    @cached_property
    def rules(self) -> dict[str, dict[str, float]]:
        """KPIs of every rule on this demand, by its name, and the power drawn from the cells."""
        figures = {}
        for name in RULES:
            record = self.under(RulePolicy(self.system, self.inputs.grid.dt_h, name), name)
            figures[name] = kpis(record) | {_DRAWN_KW: _drawn_kw(record)}
        return figures

    def under(self, policy: Policy, name: str, horizon_steps: int = 1) -> xr.Dataset:
        """Simulate ``policy`` with this forecast length [steps]; return a record for KPIs and ledger.

        ``name`` is that of the policy in errors.
        """
        import xarray as xr

        installations = Installations(self.system, self.study, self.inputs.grid)
        inputs = replace(self.inputs, horizon_steps=horizon_steps, installations=installations)
        plant = Plant(inputs.system, inputs.system.initial_state(), derating_law=self.study.run.derating_law)
        loop = ClosedLoop(inputs, policy, plant, node_temperatures=False, policy_name=name)
        run, _ = loop.advance_part(inputs.grid.n_steps)
        variables = {name: (VARIABLES[name].dims, values) for name, values in run.items()}
        return xr.Dataset(variables, {"time": self.record["time"]}, self.record.attrs)


def gain_over_rules(replay: Replay, policy: str = "") -> dict[str, float | str]:
    """Return the gain of a run over the best rule on its demand.

    The best rule has the lowest undelivered energy and losses. A tie with the rule of the run itself, as for
    identical strings, is decided for that rule. SOC-dependent demand is replayed as recorded.

    Parameters
    ----------
    replay : Replay
        Replay of the run.
    policy : str
        Name of the policy that ran.

    Returns
    -------
    dict
        ``gain_rule``: name of the best rule. ``gain_kwh``: its ``lost_kwh`` minus that of the run [kWh].
        ``gain_stored_kwh``: final stored energy of the run minus that of this rule [kWh]. ``gain_eur``: net
        income of the run minus the highest net income of a rule [EUR]; only with prices, and not for a
        reserve or behind a meter, where the demand of a rule would depend on its own SOC.
    """
    record, rules, own = replay.record, replay.rules, kpis(replay.record)
    best = min(rules, key=lambda name: (rules[name]["lost_kwh"], name != policy))
    gain: dict[str, float | str] = {
        "gain_rule": best,
        "gain_kwh": rules[best]["lost_kwh"] - own["lost_kwh"],
        "gain_stored_kwh": (rules[best][_DRAWN_KW] - _drawn_kw(record)) * replay.inputs.grid.dt_h,
    }
    if "net_eur" in own and not (is_reserve(record) or is_site(record)):
        gain["gain_eur"] = own["net_eur"] - max(each["net_eur"] for each in rules.values())
    return gain


def _drawn_kw(record: xr.Dataset) -> float:
    """Power drawn from the cells, summed over strings and steps."""
    return float(record["chemical_kw"].values.sum())
