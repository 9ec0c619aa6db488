"""Claims about closed loops under ``mpc`` with foresight: what plans are worth, and what a study refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
import bess.simulation.runner as run_module
from bess.control.policies.planned import PLANNED
from power_cut import cut_off

PLANNED_CASE = {"policy.mode": "plan", "policy.objectives.kind": "energy", "policy.rollouts": 40}


def run(values: dict[str, Any]) -> bess.Result:
    return bess.run(
        bess.load_study("case1", {"policy.mode": "plan", "policy.objectives.kind": "energy", **values}),
        progress=False,
    )


@pytest.mark.parametrize("after", [1, 20, 50])
def test_a_planned_run_continues_to_the_same_bits(
    after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study("case1", {"run.days": 1, "policy.foresight_h": 8, **PLANNED_CASE})
    reference = bess.run(study, progress=False)
    assert (reference.dataset.solver_status == PLANNED).sum() > 60
    monkeypatch.setattr(run_module, "MAX_PART_STEPS", 16)
    cut_off(study, tmp_path / "run", after, monkeypatch)
    bess.run(study, progress=False, out=tmp_path / "run", resume=True)
    assert bess.open_result(tmp_path / "run").identical(reference.dataset)


@pytest.mark.parametrize(
    "values",
    [
        pytest.param({"run.days": 2}, id="two strings, two days"),
        pytest.param(
            {"run.days": 1, "system.file": "unequal-4", "demand.scale": 1.6}, id="four that differ, a day"
        ),
        pytest.param(
            {"run.days": 2, "system.file": "unequal-4", "demand.scale": 2.2},
            id="four, asked for too much",
        ),
    ],
)
def test_a_plan_loses_less_than_an_equal_split_and_delivers_as_much(values: dict[str, Any]) -> None:
    planned, equal = run(values).kpis, run({**values, "policy.name": "equal"}).kpis
    assert planned["lost_kwh"] < 0.95 * equal["lost_kwh"]
    assert planned["undelivered_kwh"] <= equal["undelivered_kwh"]


def test_a_demand_shorter_than_the_plan_is_planned_to_its_end_with_nothing_after() -> None:
    result = run({"run.days": 0.25, "demand.repeat": False, "policy.foresight_h": 48, "policy.rollouts": 10})
    request = result.dataset.request_kw.sum("string")
    np.testing.assert_allclose(request, result.dataset.demand_kw, atol=1e-9)


def test_an_outage_is_met_by_a_plan_without_the_string() -> None:
    study = bess.load_study(
        "case1",
        {
            **PLANNED_CASE,
            "run.days": 0.25,
            "policy.foresight_h": 6,
            "event": [{"string": 1, "start": "2024-01-01T01:00:00Z", "end": "2024-01-01T03:00:00Z"}],
        },
    )
    data = bess.run(study, progress=False).dataset
    assert not data.request_kw.values[4:12, 1].any()
    assert data.request_kw.values[:4, 1].any() or data.request_kw.values[12:, 1].any()
    np.testing.assert_allclose(data.request_kw.sum("string"), data.demand_kw, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"policy.foresight_h": 24, "policy.horizon_steps": 8}, "use only one of them"),
        ({"policy.foresight_h": 24, "policy.objectives.kind": "paper"}, "has priorities"),
        ({"policy.foresight_h": 49}, r"\[0, 48\] h"),
        ({"policy.foresight_h": float("nan")}, "foresight_h"),
        ({"policy.rollouts": -1}, "rollouts"),
        ({"policy.foresight_h": 0}, "foresight_h = 0 is for a certified split, mode = plan for a plan"),
        ({"policy.mode": "certified", "policy.foresight_h": 24}, "foresight_h = 24 h is for a plan"),
        ({"policy.mode": "certified", "policy.objectives.kind": "money"}, "is planned"),
    ],
)
def test_a_study_that_cannot_be_planned_is_refused(values: dict[str, Any], says: str) -> None:
    with pytest.raises(bess.InputError, match=says):
        bess.load_study("case1", {"policy.mode": "plan", "policy.objectives.kind": "energy", **values})


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"policy.objectives.kind": "money"}, "no prices"),
        ({"policy.objectives.availability": {"priority": 2}}, "priorit"),
    ],
)
def test_a_run_that_cannot_be_planned_is_refused(values: dict[str, Any], says: str) -> None:
    with pytest.raises(bess.InputError, match=says):
        run({"run.days": 0.125, **values})


def test_a_run_in_another_currency_has_the_same_set_points(tmp_path: Path) -> None:
    """Nine hours, prices in part below zero, in units of 1,024 EUR: set-points differed by up to 1.1 kW."""
    hours = pd.date_range("2024-06-01", periods=24, freq="1h", tz="UTC")
    price = 30.0 - 50.0 * np.cos(np.arange(24) / 4.0)

    def run(unit: float) -> bess.Result:
        path = tmp_path / f"{unit}.csv"
        pd.Series(unit * price, hours, name="price_eur_mwh").rename_axis("time").to_csv(path)
        fees = {"shortfall_eur_mwh": 50.0, "charge_fee_eur_mwh": 4.0, "start_eur": 0.05}
        values = {f"settlement.{name}": unit * eur for name, eur in fees.items()} | {
            "demand.prices": str(path),
            "wear.eur_per_mwh": unit * 12.0,
            "run.days": 0.375,
        }
        return bess.run(bess.load_study("arbitrage-2024", values), progress=False)

    euros, others = run(1.0), run(2.0**-10)
    for name in ("demand_kw", "request_kw", "soc"):
        np.testing.assert_array_equal(others.dataset[name], euros.dataset[name])
    assert others.kpis["net_eur"] == 2.0**-10 * euros.kpis["net_eur"]
