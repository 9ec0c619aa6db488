"""Claims about what the report says: it warns when it must, marks the best, and judges the paper fairly."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from folders import write_run
from synthetic import kpis, record, with_reserve

import bess
from bess.control.policies.planned import PLANNED
from bess.errors import InputError
from bess.report.contents import optimiser
from bess.report.runs import Run, runs_in
from bess.report.words.headline import limit_sentences, tiles
from bess.report.words.paper import Verdict, comparisons, is_case_2, reading
from bess.report.words.summary import subject, summary, warnings
from bess.report.words.tables import SweepTable, decision_table, kpi_groups
from bess.simulation.analysis.kpis import kpis as compute

BASE = {
    "availability_pct": 99.0, "derating_efficiency_pct": 98.0, "inverter_efficiency_pct": 97.0,
    "battery_efficiency_pct": 98.0, "system_efficiency_pct": 96.0, "peak_mean_temperature_c": 45.0,
}  # fmt: skip
# What section 8 of the model specification expects of S1 to S3.
PAPER = {
    "S1": BASE
    | {"inverter_efficiency_pct": 97.9, "peak_mean_temperature_c": 51.0, "derating_efficiency_pct": 96.8},
    "S2": BASE
    | {"inverter_efficiency_pct": 97.8, "battery_efficiency_pct": 98.5, "system_efficiency_pct": 96.3},
    "S3": BASE
    | {"battery_efficiency_pct": 99.0, "derating_efficiency_pct": 100.0, "peak_mean_temperature_c": 41.0},
}


def one(directory: Path, **changes: object) -> dict[str, Run]:
    data = record(2, 96)
    data["fallback"][:] = 0
    data["solver_search_gap"][:] = 1e-4
    for name, value in changes.items():
        data[name][5] = value
    write_run(directory / "run", data)
    return runs_in(directory / "run")[0]


@pytest.mark.parametrize(
    ("policy", "gain_kwh", "said"),
    [
        ({"mode": "certified"}, -9.0, True),
        ({"mode": "certified"}, 9.0, False),
        ({"mode": "plan"}, -9.0, False),
        ({"mode": "certified", "name": "equal"}, -9.0, False),
    ],
)
def test_certified_splits_that_lose_more_than_a_rule_point_to_plans(
    policy: dict[str, str], gain_kwh: float, said: bool, tmp_path: Path
) -> None:
    write_run(tmp_path / "run", record(2, 96), policy=policy)
    runs = runs_in(tmp_path / "run")[0]
    (run,) = runs.values()
    run.kpis["gain_kwh"] = gain_kwh
    assert any("Plans look a day ahead" in sentence for sentence in summary(runs)) == said


def test_a_clean_run_has_no_warnings(tmp_path: Path) -> None:
    assert warnings(one(tmp_path), {}) == []


def test_a_run_of_one_step_has_the_length_of_its_step(tmp_path: Path) -> None:
    pd.Series(
        [100.0, 100.0], pd.date_range("2024-01-01", periods=2, freq="h", tz="UTC", name="time"), name="power"
    ).to_csv(tmp_path / "power.csv")
    values = {
        "demand.file": str(tmp_path / "power.csv"),
        "policy.name": "equal",
        "system.parameters": {"control": {"step_min": 60.0}},
        "run.days": 1 / 24,
    }
    bess.run(bess.load_study("policies", {"scenario": [], **values}), out=tmp_path / "run", progress=False)
    runs, _ = runs_in(tmp_path / "run")
    assert "Discharged: 100 kWh of 100 kWh demand, 100.0 %." in summary(runs)
    assert subject(runs).startswith("2 strings · 1 h from 2024-01-01 00:00 UTC")


@pytest.mark.parametrize(
    ("variable", "value", "message"),
    [
        ("fallback", 1, "In 1 of 96 steps a fallback"),
        ("ledger_residual_kwh", -0.5, "residual of up to 0.5 kWh"),
    ],
)
def test_what_limits_the_numbers_is_said(tmp_path: Path, variable: str, value: float, message: str) -> None:
    (sentence,) = warnings(one(tmp_path, **{variable: value}), {})
    assert message in sentence


def test_a_warning_that_runs_share_is_said_once_with_their_names(tmp_path: Path) -> None:
    for name in ("day", "night"):
        data = record(2, 96)
        data["fallback"][:] = np.arange(96) == 5
        write_run(tmp_path / "set" / name, data, name)
    (sentence,) = warnings(runs_in(tmp_path / "set")[0], {})
    assert sentence.startswith("day and night: in 1 of 96 steps a fallback")


def test_net_income_is_what_the_entries_beside_it_add_up_to(tmp_path: Path) -> None:
    data = with_reserve(record(2, 960, price=True))
    write_run(tmp_path / "run", data)
    runs = runs_in(tmp_path / "run")[0]
    (sentence,) = [text for text in summary(runs) if text.startswith("Net income")]
    net, *entries = (float(found.replace(",", "")) for found in re.findall(r"(-?[\d,.]+) EUR", sentence))
    earned = len(re.findall(" EUR", sentence.split(" less ")[0])) - 1
    assert "capacity revenue" in sentence and "penalty" in sentence
    assert sum(entries[:earned]) - sum(entries[earned:]) == pytest.approx(net, abs=3.0)
    (tile,) = [tile for tile in tiles(runs["demo"]) if tile.label == "Net income"]
    revenue, costs = (float(found.replace(",", "")) for found in re.findall(r"-?[\d,.]+", tile.detail))
    assert revenue == pytest.approx(sum(entries[:earned]), abs=2.0)
    assert costs == pytest.approx(sum(entries[earned:]), abs=3.0)


def test_money_for_charging_at_negative_prices_is_no_cost_with_a_minus(tmp_path: Path) -> None:
    data = record(2, 96, price=True)
    data["price_eur_mwh"][:] = np.where(data["demand_kw"].values < 0.0, -80.0, 40.0)
    write_run(tmp_path / "run", data)
    runs = runs_in(tmp_path / "run")[0]
    (sentence,) = [text for text in summary(runs) if text.startswith("Net income")]
    assert re.search(r"from discharge revenue [\d.]+ EUR and negative charge cost [\d.]+ EUR less", sentence)
    (tile,) = [tile for tile in tiles(runs["demo"]) if tile.label == "Net income"]
    assert re.fullmatch(r"[\d,.]+ revenue, -[\d,.]+ costs", tile.detail)


def test_what_limits_the_plant_is_its_largest_loss_with_the_hours_and_energy_of_the_record(
    tmp_path: Path,
) -> None:
    data = record(2, 96)
    data["derating_loss_kw"][:] = 0.0
    data["derating_loss_kw"][10:18, 0] = 40.0  # eight quarters of an hour, 80 kWh
    data["inverter_starts"][:] = 1
    write_run(tmp_path / "run", data)
    (run,) = runs_in(tmp_path / "run")[0].values()
    first, *_, last = limit_sentences(run)
    assert first.startswith("Derating of hot strings in 2 h: 80.0 kWh") and "More cooling" in first
    # A rule starts what its demand starts: no price of a study changes that.
    assert last == "96 starts of each inverter a day."
    run.dataset["solver_status"][:] = PLANNED
    assert limit_sentences(run)[-1].endswith(
        "Fewer starts: raise policy.objectives.start_kwh, the price of a start."
    )


@pytest.mark.parametrize("n_strings", [1, 2])
def test_one_inverter_at_a_time_and_less_than_a_day_have_remedies_of_their_own(
    n_strings: int, tmp_path: Path
) -> None:
    data = record(n_strings, 8, concentrate=1.0)
    data["delivered_kw"][:] *= 0.3
    write_run(tmp_path / "run", data)
    (run,) = runs_in(tmp_path / "run")[0].values()
    said = " ".join(limit_sentences(run))
    assert "A smaller inverter would help." in said and "Fewer inverters" not in said
    run.kpis["starts_per_day"] = 96.0
    assert "starts of each inverter" not in " ".join(limit_sentences(run))


def test_energy_that_other_strings_had_left_is_what_another_split_can_give(tmp_path: Path) -> None:
    data = record(2, 96)
    for name in ("availability", "derating", "inverter", "battery", "hysteresis"):
        data[f"{name}_loss_kw"][:] = 0.0
    data["limits"][:] = 0
    data["demand_kw"][20], data["delivered_kw"][20, :] = 92.0, [0.0, 32.0]
    data["availability_loss_kw"][20, 0], data["limits"][20, 0], data["soc"][20, 1] = 60.0, 4, 0.9
    (tmp_path / "x").mkdir()
    for name, soc in (("left", 0.9), ("none", 0.0)):
        data["soc"][20, 1] = soc
        write_run(tmp_path / name, data)
        (run,) = runs_in(tmp_path / name)[0].values()
        first = limit_sentences(run)[0]
        assert first.startswith("Empty strings in 0.25 h: 15.0 kWh")
        assert ("For 100 % of it other strings had" in first) == (name == "left")


def test_a_reserve_leads_with_what_was_sold_not_sustained_and_earned_for_each_mw(tmp_path: Path) -> None:
    data = with_reserve(record(2, 960, price=True))  # 100 kW for 240 h, 90 kW of it sustained
    write_run(tmp_path / "run", data)
    (run,) = runs_in(tmp_path / "run")[0].values()
    sold, lacking, per_mw, *_ = tiles(run)
    assert (sold.label, sold.figure, sold.unit) == ("Reserve sold", "100", "kW")
    assert (lacking.figure, lacking.unit) == ("240.00", "h")
    assert per_mw.figure == f"{run.kpis['net_eur'] / 0.1:,.0f}" and per_mw.unit == "EUR/MW"
    assert per_mw.detail == f"{run.kpis['net_eur'] / 0.1 / 240.0:.2f} EUR/MW/h"


def test_years_lead_with_present_value_years_to_the_end_of_life_and_the_budget(tmp_path: Path) -> None:
    year = record(1, 2_192)
    year["time"] = year["time"].values[0] + 4 * np.timedelta64(1, "h") * np.arange(2_192)
    year.attrs["step_h"] = np.float64(4.0)
    write_run(tmp_path / "run", year)
    (run,) = runs_in(tmp_path / "run")[0].values()
    end = run.system.strings[0].wear.end_of_life
    run.kpis.update({"npv_eur": 1234.5, "soh_capacity_min": 1.0 - (1.0 - end) / 8.0, "budget_used_pct": 50.0})
    run.study["budget"] = {"cycles_per_year": 300.0, "throughput_mwh_per_year": 1500.0}
    named = {tile.label: tile for tile in tiles(run)}
    assert list(named)[:4] == [
        "Net present value",
        "To end of life",
        "Capacity left",
        "Budget used",
    ]
    assert named["To end of life"].figure == "8.0"
    used = named["Budget used"]
    assert (used.figure, used.unit) == ("50.00", "%")
    assert used.detail == "of 300 full cycles and 1,500 MWh discharged a year, in the year of most use"
    run.kpis["end_of_life_days"] = 365.25 * 6.5
    assert {tile.label: tile.figure for tile in tiles(run)}["End of life"] == "6.5"


def test_a_stopped_run_is_shown_as_far_as_it_got(tmp_path: Path) -> None:
    data = record(2, 96)
    write_run(tmp_path / "run", data, done=40)
    runs, _ = runs_in(tmp_path / "run")
    assert any("first 40 of 96 steps" in sentence for sentence in warnings(runs, {}))
    expected = kpis(data.isel(time=slice(40)))
    assert runs["demo"].kpis["system_efficiency_pct"] == pytest.approx(expected["system_efficiency_pct"])


def test_of_many_scenarios_the_warnings_are_counted(tmp_path: Path) -> None:
    for index in range(10):
        data = record(2, 24)
        data["fallback"][:] = index // 8
        write_run(tmp_path / f"w{index}", data, f"w{index}")
    (tmp_path / "w3" / "results.nc").unlink()
    found = warnings(runs_in(tmp_path)[0], {})
    assert found == [
        "1 of 10 scenarios stopped early, among them w3; run the sweep again to continue.",
        "2 of 10 scenarios: steps in which a fallback replaced the optimiser's answer; most in w8, 24.",
    ]


def test_solve_times_are_those_of_their_steps(tmp_path: Path) -> None:
    times = one(tmp_path)["demo"].solve_time_s
    assert times is not None and len(times) == 96
    assert np.isnan(times[::5]).all() and np.isfinite(times[1:5]).all()


def scenarios(directory: Path, **shares: float) -> dict[str, Run]:
    for name, share in shares.items():
        write_run(directory / name, record(2, 96, concentrate=share), name, policy={"name": name})
    return runs_in(directory)[0]


def test_the_summary_names_all_that_lose_least_and_says_who_did_the_same(tmp_path: Path) -> None:
    runs = scenarios(tmp_path, A=0.0, B=0.0, C=1.0)
    lost = {name: run.kpis["lost_kwh"] for name, run in runs.items()}
    assert lost["A"] == lost["B"] != lost["C"]
    first, second = summary(runs)[:2]
    assert first == "A and B are identical in every step."
    assert second.startswith(
        "Lowest undelivered + losses: " + ("C," if lost["C"] < lost["A"] else "A and B,")
    )


def test_a_gap_is_said_with_what_it_is_worth(tmp_path: Path) -> None:
    runs = one(tmp_path, solver_gap=0.5)
    data = runs["demo"].dataset
    names = ("availability_loss_kw", "derating_loss_kw", "inverter_loss_kw", "battery_loss_kw")
    lost_kw = sum(data[name].values.sum(axis=1) for name in names)
    worth = 0.25 * float((data["solver_gap"].values * lost_kw).sum())
    assert worth > 0.1
    assert f", or {worth:,.1f} kWh of the undelivered energy" in summary(runs)[-1]


def planned(directory: Path, like: dict[str, str] | None = None, **policy: float) -> None:
    data = record(2, 96)
    for name, other in (like or {}).items():
        data[name] = 0.0 * data[other]
    data["solver_status"][:] = PLANNED
    data["solver_gap"][:] = data["solver_search_gap"][:] = np.nan
    data["solver_nodes"][:] = data["fallback"][:] = 0
    write_run(directory, data, directory.name, policy=policy)


def test_a_planned_run_says_how_far_its_plans_may_be_from_the_best(tmp_path: Path) -> None:
    """Of plans that were bounded: no effort of a certified split is drawn, and none of its gaps stated."""
    planned(tmp_path / "run")
    runs = runs_in(tmp_path / "run")[0]
    assert summary(runs)[-1].startswith("Every step was planned over 30 h. No plan has a bound.")
    (run,) = runs.values()
    for name, gap in (("solver_gap", 0.25), ("solver_search_gap", 0.015)):
        run.dataset[name][0] = gap
    run.kpis.update(compute(run.dataset))
    assert (
        "within 1.5 % of the estimated lower bound and within 25 % of the rigorous one" in summary(runs)[-1]
    )
    assert warnings(runs, {}) == []
    assert list(optimiser(run)) == []
    assert not [name for name in run.kpis if name.startswith(("solver_gap", "solver_nodes"))]
    del run.kpis["plan_gap_pct"]
    assert "Plans are within 1.5 % of the estimated lower bound (medians" in summary(runs)[-1]


@pytest.mark.parametrize(
    "flows",
    [
        {"reactive_kvar": "delivered_kw", "reactive_demand_kvar": "demand_kw"},
        {"investment_eur": "delivered_kw"},
    ],
)
def test_hindsight_is_offered_only_where_it_does_not_refuse(tmp_path: Path, flows: dict[str, str]) -> None:
    planned(tmp_path / "set" / "air")
    planned(tmp_path / "set" / "other", like=flows)
    for name, offers in (("air", True), ("other", False)):
        (run,) = runs_in(tmp_path / "set" / name)[0].values()
        assert ("--hindsight" in summary({name: run})[-1]) is offers
        assert "--hindsight" not in " ".join(summary({name: run}, hindsight=True))
    said = [sentence for sentence in summary(runs_in(tmp_path / "set")[0]) if "planned" in sentence]
    assert ["--hindsight" in sentence for sentence in said] == [True, False]


def test_hindsight_is_not_offered_where_hysteresis_heats_the_strings(tmp_path: Path) -> None:
    planned(tmp_path / "run")
    (run,) = runs_in(tmp_path / "run")[0].values()
    run.identity["system"]["battery"]["hysteresis_heat"] = True
    assert "--hindsight" not in summary({"run": run})[-1]


def test_events_are_those_of_each_run_up_to_its_end_and_announced_where_a_plan_knew_them(
    tmp_path: Path,
) -> None:
    runs = scenarios(tmp_path, mpc=0.0, soc=0.0, equal=0.0)
    first = pd.Timestamp(runs["mpc"].dataset["time"].values[0], tz="UTC")

    def event(hour: int, announced: bool = True) -> dict[str, object]:
        start, end = ((first + pd.Timedelta(hours=at)).isoformat() for at in (hour, hour + 2))
        return {"string": 0, "start": start, "end": end, "announced": announced}

    runs["mpc"].study["event"] = [event(30), event(6), event(2)]
    runs["soc"].study["event"] = [event(2)]
    said = [sentence for sentence in summary(runs) if "String 0" in sentence]
    times = [f"{first + pd.Timedelta(hours=hour):%Y-%m-%d %H:%M}" for hour in (2, 4, 6, 8)]
    assert said == [
        f"mpc: String 0 was out of service from {times[0]} to {times[1]} UTC, as announced.",
        f"mpc: String 0 was out of service from {times[2]} to {times[3]} UTC, as announced.",
        f"soc: String 0 was out of service from {times[0]} to {times[1]} UTC.",
    ]


def test_a_comparison_says_which_runs_were_planned_and_how_far(tmp_path: Path) -> None:
    planned(tmp_path / "set" / "day")
    planned(tmp_path / "set" / "short", foresight_h=6.0)
    write_run(tmp_path / "set" / "split", record(2, 96), "split")
    said = [sentence for sentence in summary(runs_in(tmp_path / "set")[0]) if "planned" in sentence]
    assert [sentence.split(".")[0] for sentence in said] == [
        "day: every step was planned over 30 h",
        "short: every step was planned over 6 h",
    ]


def test_the_best_of_each_row_is_marked_and_the_rest_are_behind() -> None:
    rows = {row.label: row for rows in kpi_groups(PAPER).values() for row in rows}
    inverter = rows["Inverter efficiency (%)"].cells
    assert [cell.best for cell in inverter] == [True, False, False]
    assert [cell.behind for cell in inverter] == ["", "-0.10", "-0.90"]
    temperature = rows["Peak mean temperature (°C)"].cells
    assert [cell.text for cell in temperature if cell.best] == ["41.0"]
    assert not any(cell.best for cell in rows["Availability (%)"].cells)


def test_every_figure_is_in_the_table_under_its_heading_and_details_are_marked() -> None:
    figures = {"unmet_kwh": 1200.0, "solver_gap_p95": float("nan"), "soc_spread_mean": 0.0123, "own": 2.0}
    rows = {
        (heading, row.label): (row.cells[0].text, row.detail)
        for heading, of_heading in kpi_groups({"": BASE | figures}).items()
        for row in of_heading
    }
    assert len(rows) == len(BASE) + len(figures)
    assert rows["Losses", "Unmet demand (kWh)"] == ("1,200.0", False)
    assert rows["Strings and inverters", "SOC spread, mean over the run"] == ("0.012", True)
    assert rows["Solver and energy balance", "Rigorous gap, 95th percentile (%)"] == ("–", True)
    assert rows["Strings and inverters", "own"] == ("2.000", True)


def test_nothing_is_best_where_only_one_run_has_the_figure() -> None:
    (row,) = decision_table({"a": {"net_eur": 3.0}, "b": {}})
    assert [(cell.text, cell.best) for cell in row.cells] == [("3.00", False), ("–", False)]


def test_all_statements_agree_on_the_numbers_the_specification_expects() -> None:
    rows = comparisons(PAPER)
    assert len(rows) == 10 and {row.verdict for row in rows} == {Verdict.YES}
    assert reading(rows)[0] == "10 of the paper's 10 statements are reproduced."


def test_a_difference_much_smaller_than_the_papers_is_not_called_agreement() -> None:
    changed = PAPER | {"S2": PAPER["S2"] | {"battery_efficiency_pct": 98.2}}
    rows = {row.statement: row for row in comparisons(changed)}
    assert rows["S2 over S1, battery efficiency"].verdict is Verdict.DIRECTION
    assert "less than half of the size: “S2 over S1, battery efficiency”" in reading(list(rows.values()))[0]


@pytest.mark.parametrize(
    ("scenario", "key", "value", "statement"),
    [
        ("S3", "inverter_efficiency_pct", 99.0, "Highest inverter efficiency"),
        ("S1", "system_efficiency_pct", 97.0, "Highest system efficiency"),
        ("S2", "peak_mean_temperature_c", 50.5, "Peak of S2 below that of S1"),
        ("S2", "availability_pct", 98.0, "Availability of S2 not below that of S1"),
    ],
)
def test_an_ordering_that_does_not_come_out_is_said(
    scenario: str, key: str, value: float, statement: str
) -> None:
    changed = {name: dict(entry) for name, entry in PAPER.items()}
    changed[scenario][key] = value
    rows = comparisons(changed)
    assert statement in [row.statement for row in rows if row.verdict is not Verdict.YES]
    assert statement in reading(rows)[0]


def test_only_the_papers_weights_are_compared_with_the_paper(tmp_path: Path) -> None:
    def runs(weights: dict[str, tuple[float, float]]) -> dict[str, Run]:
        return {
            name: Run(
                name,
                tmp_path,
                {"study": {"policy": {"objectives": {"inverter": w3, "battery": {"weight": w4}}}}},
            )
            for name, (w3, w4) in weights.items()
        }

    case_2 = {"S1": (1.0, 0.0), "S2": (0.5, 0.5), "S3": (0.0, 1.0)}
    assert is_case_2(runs(case_2))
    assert not is_case_2(runs(case_2 | {"S2": (0.4, 0.6)}))
    assert not is_case_2(runs({"S1": (1.0, 0.0)}))


def test_scenarios_keep_the_order_of_their_study(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        write_run(tmp_path / name, record(1, 8), name)
    (tmp_path / "kpis.json").write_text('{"c": {}, "a": {}}')
    assert list(runs_in(tmp_path)[0]) == ["c", "a", "b"]


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no run"):
        runs_in(tmp_path)


def test_two_points_are_no_front_with_a_knee_however_often_they_were_found() -> None:
    points = {"0": (99.0, 96.0), "1": (98.0, 97.0), "2": (98.0, 97.0), "3": (98.0, 97.0)}
    rows = {
        name: BASE
        | {"battery_efficiency_pct": x, "inverter_efficiency_pct": y, "unmet_kwh": 0.0, "demand_kwh": 9.0}
        for name, (x, y) in points.items()
    }
    table = SweepTable({name: {"policy.gap": name} for name in points}, rows, {})
    assert table.front_sentence().endswith(
        "no knee, because it has only 2 of 4 points: policy.gap 1; policy.gap 0."
    )


def test_a_search_whose_best_earns_nothing_has_no_shares_of_it() -> None:
    rows = {name: BASE | {"net_eur": net} for name, net in (("0", -8.0), ("1", 0.0), ("2", -2.0))}
    parameters = {name: {"wear.eur_per_mwh": name} for name in rows}
    said = SweepTable(parameters, rows, {}, "net_eur").front_sentence()
    assert said.endswith("0 costs 8.00 EUR, 2 costs 2.00 EUR.")


def test_a_search_is_told_over_the_runs_that_have_a_number() -> None:
    rows = {str(i): BASE | {"net_eur": net} for i, net in enumerate((math.nan, -1.0, 4.0, -2.0, math.nan))}
    parameters = {name: {"wear.eur_per_mwh": name} for name in rows}
    table = SweepTable(parameters, rows, {}, "net_eur")
    said = table.front_sentence()
    assert said == (
        "Best wear.eur_per_mwh: 2, with net income 4.00 EUR. 1 costs 5.00 EUR (125.0 %), 3 costs 6.00 EUR "
        "(150.0 %)."
    )
    assert "search" in [figure.name for figure in table.exhibits()]
    for lacking in ({name: BASE | {"net_eur": math.nan} for name in rows}, dict.fromkeys(rows, BASE)):
        table = SweepTable(parameters, lacking, {}, "npv_eur")
        assert table.front_sentence() == ""
        assert "search" not in [figure.name for figure in table.exhibits()]
