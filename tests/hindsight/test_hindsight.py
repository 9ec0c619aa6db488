"""Hindsight of a finished run."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import bess


def study(**values: object) -> bess.Study:
    document = {"name": "sight", "demand": {"file": "two-cycle-48h"}, "policy": {"name": "priority"}}
    return bess.study.Study.from_document(document, "test").with_values({"run.days": 1, **values})


def test_a_run_lost_no_less_than_was_possible_and_that_no_less_than_is_proven() -> None:
    result = bess.run(study(), progress=False)
    sight = bess.hindsight(result)
    assert sight.bound_kwh < sight.found_kwh < sight.lost_kwh == result.kpis["lost_kwh"]
    assert sight.found_by == "a plan of 24 h"
    assert sight.found_eur is None
    small = bess.Hindsight(lost_kwh=1.78, found_kwh=1.72, bound_kwh=1.68, found_by="equal")
    assert ": 1.8 kWh; best known: 1.7 kWh (equal); lower bound: 1.6 kWh." in str(small)


def test_over_seven_days_a_plan_of_the_whole_run_finds_what_plans_of_a_day_miss() -> None:
    values = {"run.days": 7, "demand.repeat": True, "policy.name": "soc"}
    sight = bess.hindsight(bess.run(study(**values), progress=False))
    assert sight.found_by == "a plan of 168 h"
    assert sight.found_kwh < 720.0  # closed loops of plans of 24 to 48 h lose 740 to 754


def test_what_was_possible_is_no_worse_than_any_rule_run_as_a_study() -> None:
    values = {"system.initial_soc": [0.2, 0.8], "system.ambient_c": 30.0}
    sight = bess.hindsight(bess.run(study(**values), progress=False))
    rules = ("equal", "priority", "soc", "temperature")
    lost = {
        rule: bess.run(study(**values, **{"policy.name": rule}), progress=False).kpis["lost_kwh"]
        for rule in rules
    }
    assert sight.found_kwh <= min(lost.values()) * (1.0 + 1e-12)


def test_a_record_serves_as_well_as_a_result(tmp_path: Path) -> None:
    result = bess.run(study(**{"policy.name": "soc"}), progress=False, out=tmp_path / "run")
    sight = bess.hindsight(bess.open_result(tmp_path / "run"))
    assert sight == bess.hindsight(result)


def test_strings_out_of_service_and_demand_beyond_the_plant_are_taken_into_account() -> None:
    event = [{"string": 1, "start": "2024-01-01T02:00:00Z", "end": "2024-01-01T12:00:00Z"}]
    result = bess.run(study(event=event, **{"demand.scale": 1.6}), progress=False)
    assert result.kpis["unmet_kwh"] > 10.0
    sight = bess.hindsight(result)
    assert 0.0 < sight.bound_kwh <= sight.found_kwh <= sight.lost_kwh


def test_with_prices_hindsight_is_told_in_euros_too(tmp_path: Path) -> None:
    times = pd.date_range("2024-01-01", periods=48, freq="h", tz="UTC")
    price = 60.0 + 60.0 * np.sin(np.arange(48) / 3.5)
    table = pd.DataFrame({"time": times.strftime("%Y-%m-%dT%H:%M:%SZ"), "DE-LU": price})
    table.to_csv(tmp_path / "prices.csv", index=False)
    document = {
        "name": "market",
        "demand": {"prices": str(tmp_path / "prices.csv")},
        "policy": {"name": "priority"},
        "run": {"days": 1},
    }
    result = bess.run(bess.study.Study.from_document(document, "test"), progress=False)
    sight = bess.hindsight(result)
    assert sight.lost_eur is not None and sight.found_eur is not None and sight.bound_eur is not None
    assert sight.bound_eur <= sight.found_eur <= sight.lost_eur
    assert 0.0 < sight.lost_eur < 100.0
    assert "Net income below a lossless plant" in str(sight)


@pytest.mark.parametrize("service", ["fcr", "fcr-arbitrage", "peak-shaving", "self-consumption"])
def test_of_services_no_euro_is_proven_that_is_not_paid_for_kilowatt_hours(service: str) -> None:
    values = {"run.days": 0.25, "policy.name": "equal"}
    result = bess.run(bess.load_study(service, values), progress=False)
    assert "net_eur" in result.kpis
    sight = bess.hindsight(result)
    assert sight.bound_kwh <= sight.found_kwh <= sight.lost_kwh
    assert sight.lost_eur is sight.found_eur is sight.bound_eur is None
    assert "EUR" not in str(sight)


def test_a_bound_of_nothing_is_no_negative_cent() -> None:
    sight = bess.Hindsight(1.0, 1.0, 0.0, "equal", lost_eur=2.0, found_eur=1.0, bound_eur=-1e-12)
    assert "lower bound: 0.00 EUR" in str(sight)


def test_a_report_tells_it_when_asked(tmp_path: Path) -> None:
    result = bess.run(study(**{"run.days": 0.25}), progress=False, out=tmp_path / "run")
    sentence = str(bess.hindsight(result))
    page = bess.write_report(tmp_path / "run")
    assert sentence not in page.read_text(encoding="utf-8")
    page = bess.write_report(tmp_path / "run", hindsight=True)
    assert sentence in page.read_text(encoding="utf-8")


def test_what_is_no_record_of_a_study_and_an_unknown_effort_are_refused() -> None:
    result = bess.run(study(**{"run.days": 0.25}), progress=False)
    with pytest.raises(bess.InputError, match="effort = 'endless'"):
        bess.hindsight(result, effort="endless")
    with pytest.raises(bess.InputError, match="no study in its attributes"):
        bess.hindsight(result.dataset.drop_attrs())
    with pytest.raises(bess.InputError, match="hindsight needs a result"):
        bess.hindsight("results/case1")  # type: ignore[arg-type]
