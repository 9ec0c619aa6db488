"""Strings that differ, in the closed loop: the bundled study `differing`, policy by policy."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.control.policies import PolicyInput
from bess.report.charts import operation
from bess.report.contents import comparison
from bess.report.runs import Run, runs_in
from bess.report.words.summary import summary
from bess.simulation.record import Result
from bess.study.scenarios import expand

STUDY = bess.load_study("differing")
RULES = ("equal", "priority", "soc", "temperature")
OUT, LIMITED = STUDY.event
SHORT = {"run.days": 0.75, "policy.horizon_steps": 4, "policy.node_limit": 2}
"""18 h hold the outage, the return and two hours of the limit; a quick search does for what is claimed."""


def window(result: Result, start: object, end: object) -> np.ndarray:
    """Steps from ``start`` on and before ``end``."""
    times = result.dataset["time"].values
    first, last = (np.datetime64(instant.replace(tzinfo=None), "s") for instant in (start, end))
    return (times >= first) & (times < last)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where `bess run` would put the scenarios."""
    return tmp_path_factory.mktemp("differing")


@pytest.fixture(scope="module")
def rules(folder: Path) -> dict[str, Result]:
    """Two days of every policy without a solver."""
    runs = expand(STUDY)
    return {name: bess.run(runs[name], progress=False, out=folder / name) for name in RULES}


@pytest.fixture(scope="module")
def reported(folder: Path, rules: dict[str, Result]) -> dict[str, Run]:
    """The same as the report reads it."""
    runs, problems = runs_in(folder)
    assert (set(runs), problems) == (set(rules), {})
    return runs


@pytest.fixture(scope="module")
def short() -> dict[str, Result]:
    """The first 18 h under the equal split and under the optimiser."""
    runs = expand(STUDY.with_values(SHORT))
    return {name: bess.run(runs[name], progress=False) for name in ("equal", "mpc")}


@pytest.fixture(params=[*RULES, "mpc"])
def result(request: pytest.FixtureRequest, rules: dict[str, Result]) -> Result:
    """Each policy in turn."""
    runs = rules if request.param in rules else request.getfixturevalue("short")
    run: Result = runs[request.param]
    return run


def test_the_study_compares_every_policy_on_the_same_demand_and_strings_that_differ() -> None:
    assert list(expand(STUDY)) == [*RULES, "mpc"]
    system = bess.load_system("unequal-4")
    start = system.initial_state()
    assert np.ptp(start.soc) == pytest.approx(0.3)
    assert np.ptp(start.temperature_c) == pytest.approx(9.0)
    assert np.ptp(system.capacity_ah) > 40.0
    assert np.ptp([string.battery.r_scale for string in system.strings]) == pytest.approx(0.7)


def test_a_string_out_of_service_is_asked_for_nothing_and_serves_again_afterwards(result: Result) -> None:
    request_kw = np.abs(result.dataset["request_kw"].values[:, OUT.string])
    out = window(result, OUT.start, OUT.end)
    assert out.sum() == 36
    assert not request_kw[out].any()
    assert request_kw[np.flatnonzero(out)[-1] + 1 :].any()


def test_the_others_carry_what_was_asked_while_a_string_is_out(result: Result) -> None:
    data = result.dataset
    out = window(result, OUT.start, OUT.end)
    np.testing.assert_allclose(data["request_kw"].values.sum(axis=1)[out], data["demand_kw"].values[out])
    assert not data["unmet_kw"].values.any(), "three strings have the power for it"


def test_a_limited_inverter_is_asked_for_no_more_than_its_limit_and_for_more_elsewhere(
    result: Result,
) -> None:
    request_kw = np.abs(result.dataset["request_kw"].values[:, LIMITED.string])
    limited = window(result, LIMITED.start, LIMITED.end)
    assert limited.any()
    assert request_kw[limited].max() <= LIMITED.limit_kw + 1e-9
    assert request_kw[~limited].max() > 2.0 * LIMITED.limit_kw


def test_policies_know_announced_events_beforehand_and_others_from_their_begin_on() -> None:
    seen = []

    def watching(inputs: PolicyInput) -> np.ndarray:
        seen.append(inputs.expected_limit_kw)
        return inputs.demand_kw[0] * inputs.limit_kw / inputs.limit_kw.sum()

    # During an announced outage, a limit of the same string that was not announced is still expected to last.
    also = OUT.model_copy(update={"start": OUT.start - timedelta(hours=2), "limit_kw": 20.0})
    events = (OUT.model_copy(update={"announced": True}), LIMITED, also)
    event = [each.model_dump() for each in events]
    study = expand(STUDY.with_values({**SHORT, "event": event, "policy.horizon_steps": 96}))["mpc"]
    data = bess.run(study, policy=watching, progress=False).dataset
    times = data["time"].values[0] + np.timedelta64(15, "m") * np.arange(data.sizes["time"] + 96)
    nominal_kw = bess.load_system("unequal-4").nominal_kw
    for step, limit_kw in enumerate(seen):
        ahead = times[step : step + 96]
        out, limited, low = (
            (ahead >= np.datetime64(event.start.replace(tzinfo=None)))
            & (ahead < np.datetime64(event.end.replace(tzinfo=None)))
            for event in events
        )
        expected_kw = also.limit_kw if low[0] else nominal_kw[OUT.string]
        np.testing.assert_array_equal(limit_kw[OUT.string], np.where(out, 0.0, expected_kw))
        expected_kw = LIMITED.limit_kw if limited[0] else nominal_kw[LIMITED.string]
        np.testing.assert_array_equal(limit_kw[LIMITED.string], expected_kw)


def test_sharing_by_energy_closes_the_spread_of_soc_and_a_fixed_order_opens_it(
    rules: dict[str, Result],
) -> None:
    end = {name: result.kpis["soc_spread_end"] for name, result in rules.items()}
    assert all(result.kpis["soc_spread_start"] == pytest.approx(0.3) for result in rules.values())
    assert end["soc"] < 0.02
    assert max(end["equal"], end["temperature"]) < 0.3, "by chance: they never look at it"
    assert end["priority"] > 0.3


def test_sharing_by_energy_never_opens_the_spread_while_all_strings_serve(rules: dict[str, Result]) -> None:
    data = rules["soc"].dataset
    soc = np.vstack([data.attrs["initial_soc"], data["soc"].values])
    free = ~(window(rules["soc"], OUT.start, OUT.end) | window(rules["soc"], LIMITED.start, LIMITED.end))
    growth = np.diff(np.ptp(soc, axis=1))[free]
    # Shares are by energy at the mean voltage, SOC moves by charge: per step they differ by this much.
    assert growth.max() < 0.006
    assert growth.sum() < 0.0


def test_sharing_by_temperature_narrows_the_spread_of_temperature_on_average(
    rules: dict[str, Result],
) -> None:
    mean_k = {name: result.kpis["temperature_spread_mean_k"] for name, result in rules.items()}
    assert mean_k["temperature"] < mean_k["equal"] < mean_k["priority"]


def test_the_optimiser_delivers_what_the_equal_split_does_with_less_loss(short: dict[str, Result]) -> None:
    equal, mpc = (short[name].kpis for name in ("equal", "mpc"))
    assert mpc["availability_pct"] >= equal["availability_pct"]
    assert mpc["system_efficiency_pct"] > equal["system_efficiency_pct"] + 0.5


def test_kpis_of_the_spread_are_those_of_the_record(result: Result) -> None:
    data, kpis = result.dataset, result.kpis
    for name, label in (("soc", "soc_spread_{}"), ("temperature_c", "temperature_spread_{}_k")):
        spread = np.ptp(np.vstack([data.attrs[f"initial_{name}"], data[name].values]), axis=1)
        expected = {"start": spread[0], "end": spread[-1], "mean": spread.mean(), "max": spread.max()}
        for moment, value in expected.items():
            assert kpis[label.format(moment)] == pytest.approx(value)


def test_the_report_draws_the_spread_of_every_policy_over_one_another(rules: dict[str, Result]) -> None:
    chart = operation.string_spread({name: result.dataset for name, result in rules.items()})
    for panel, start, end, factor in (
        (chart.panels[0], "soc_spread_start", "soc_spread_end", 100.0),
        (chart.panels[1], "temperature_spread_start_k", "temperature_spread_end_k", 1.0),
    ):
        assert [line.label for line in panel.series] == list(RULES)
        for line, result in zip(panel.series, rules.values(), strict=True):
            assert line.y[0] == pytest.approx(factor * result.kpis[start])
            assert line.y[-1] == pytest.approx(factor * result.kpis[end])


def test_the_report_compares_the_spread_as_one_of_its_figures(reported: dict[str, Run]) -> None:
    assert "spread" in [exhibit.name for exhibit in comparison(reported)]


def test_the_report_says_what_happened_to_strings_and_how_far_apart_they_ended(
    reported: dict[str, Run],
) -> None:
    sentences = summary(reported)
    assert "String 1 was out of service from 2024-01-01 05:00 to 2024-01-01 14:00 UTC." in sentences
    assert "String 0 was limited to 15 kW from 2024-01-01 16:00 to 2024-01-02 08:00 UTC." in sentences
    spread = next(sentence for sentence in sentences if sentence.startswith("Largest minus smallest SOC"))
    for name, run in reported.items():
        assert f"{name} 30.0 to {100.0 * run.kpis['soc_spread_end']:.1f}" in spread
