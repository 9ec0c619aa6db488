"""Benchmark rules for a finished run: the same plant, start, weather and demand, without optimisation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from bess.control.policies import POLICIES, Settings, build_policy
from bess.control.policies.rule import RulePolicy
from bess.simulation.analysis.kpis import kpis
from bess.simulation.analysis.services import is_reserve
from bess.simulation.hindsight.replay import Replay

if TYPE_CHECKING:
    import xarray as xr

    from bess.system import System


def rules_of(replay: Replay) -> Iterator[tuple[str, RulePolicy]]:
    """Yield the name and policy of every rule of the registry, for the plant of a replay."""
    settings = Settings(dt_h=replay.inputs.grid.dt_h, horizon_steps=1)
    for name in POLICIES:
        if name not in ("mpc", "distilled"):
            policy = build_policy(name, replay.system, settings)
            if isinstance(policy, RulePolicy):
                yield name, policy


def gain_over_rules(
    record: xr.Dataset, policy: str = "", system: System | None = None
) -> dict[str, float | str]:
    """Simulate every rule on the demand of a record and return the gain of the run over the best rule.

    The best rule has the lowest undelivered energy and losses. A tie with the rule of the run itself, as for
    identical strings, is decided for that rule. SOC-dependent demand is replayed as recorded.

    Parameters
    ----------
    record : xarray.Dataset
        Record of a run.
    policy : str
        Name of the policy that ran.
    system : System, optional
        The plant; read from the study of the record if omitted.

    Returns
    -------
    dict
        ``gain_rule``: name of the best rule. ``gain_kwh``: its ``lost_kwh`` minus that of the run [kWh].
        ``gain_stored_kwh``: final stored energy of the run minus that of this rule [kWh]. ``gain_eur``: net
        income of the run minus the highest net income of a rule [EUR]; only with prices, and not for a
        reserve, whose revenue depends on the SOC.

    Raises
    ------
    InputError
        The record does not contain its study, or its system cannot be read.
    """
    replay = Replay.of(record, system)
    runs = {name: replay.under(rule) for name, rule in rules_of(replay)}
    figures = {name: kpis(run) for name, run in runs.items()}
    own = kpis(record)
    best = min(figures, key=lambda name: (figures[name]["lost_kwh"], name != policy))
    gain: dict[str, float | str] = {
        "gain_rule": best,
        "gain_kwh": figures[best]["lost_kwh"] - own["lost_kwh"],
    }
    if "chemical_kw" in record:  # not in records of earlier versions
        drawn_kw = runs[best]["chemical_kw"].values.sum() - record["chemical_kw"].values.sum()
        gain["gain_stored_kwh"] = float(drawn_kw) * replay.inputs.grid.dt_h
    if "net_eur" in own and not is_reserve(record):
        gain["gain_eur"] = own["net_eur"] - max(each["net_eur"] for each in figures.values())
    return gain
