"""Claims about lives of strings: replacement, retirement, augmentation, and the wear price of a life."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest

import bess
from bess.report.runs import Run
from bess.report.words.headline import another_split
from bess.report.words.summary import event_sentences
from bess.report.words.tables import read_sweep
from bess.simulation.analysis.lifetime import cash_by_year, ledger_by_year
from bess.simulation.inputs import prepare
from bess.simulation.runner import closed_loop
from bess.study.plant_choice import build_system
from bess.study.scenarios import expand, refined

HOURLY = {"system.parameters.control": {"step_min": 60.0, "plant_step_s": 300.0}}
AGEING = {
    "run.plant_step_s": 60.0,
    "demand.repeat": True,
    "demand.scale": 0.5,
    "policy.name": "equal",
    "run.days": 4,
    "wear.model": "kokam-75ah",
    "wear.end_of_life": 0.8,
    "wear.replacement_eur_kwh": 100.0,
    "system.initial_soh_capacity": [0.80002, 0.9],
}
"""The first string ends its life within the first two days."""
EUR_PER_LOSS = 100.0 * bess.System.reference(2).nominal_energy_kwh / (1.0 - 0.8)


def run(values: dict[str, Any], **more: Any) -> bess.Result:
    return bess.run(bess.load_study("case1", AGEING | values | more), progress=False)


def two_kinds_of_days(path: Path, days: int) -> Path:
    """A file of prices: one cycle a day, on days of a spread of 160 and of 60 EUR/MWh in turn."""
    hours = pd.date_range("2024-01-01", periods=days * 24, freq="h", tz="UTC")
    spread = np.where(np.arange(hours.size) // 24 % 2 == 0, 160.0, 60.0)
    low = hours.hour.to_numpy() < 12
    price = pd.Series(100.0 + spread / 2.0 * np.where(low, -1.0, 1.0), hours, name="price_eur_mwh")
    price.rename_axis("time").to_csv(path / "prices.csv")
    return path / "prices.csv"


def test_a_renewed_string_is_new_and_the_others_are_as_before() -> None:
    system = bess.load_study("case1", AGEING).with_values({"system.initial_soh_capacity": [0.85, 0.9]})
    parameters = prepare(system).system
    plant = bess.Plant(parameters, parameters.initial_state())
    plant.run(np.full((8, 2), 30.0), 900.0)
    before, nodes = plant.state, plant.snapshot().node_temperature_c
    plant.renew(np.array([True, False]))
    after = plant.state
    assert after.soh_capacity.tolist() == [1.0, before.soh_capacity[1]]
    assert after.soh_resistance.tolist() == [1.0, before.soh_resistance[1]]
    np.testing.assert_array_equal(after.soc, before.soc)
    np.testing.assert_array_equal(plant.snapshot().node_temperature_c, nodes)
    # From then on it ages as the string of a new plant in this state.
    new = bess.Plant(parameters, replace(after, soh_capacity=np.ones(2), soh_resistance=np.ones(2)))
    new.restore(replace(plant.snapshot(), ageing=new.snapshot().ageing))
    for each in (plant, new):
        each.run(np.full((8, 2), -20.0), 900.0)
    assert plant.state.soh_capacity[0] == new.state.soh_capacity[0]


def test_a_range_of_rounding_does_not_age_a_string_of_many_cycles() -> None:
    """Its temperature is the difference of two sums over the life, here of 5,000 cycles: 0 K."""
    study = bess.load_study("wear-price", {"demand.prices": "prices.csv"})
    system = build_system(study.system, study.run, study.wear)
    plant = bess.Plant(system, system.initial_state())
    plant.step([30.0, 30.0])
    whole = plant.snapshot()
    rows, now, first, last = whole.ageing.copy(), 15, 21, 28
    rows[:, 0] = 2
    for mark in (first + 1, last + 1, now):  # SOC travelled, the same times kelvin, hours
        rows[:, mark : mark + 3] = [5000.0, 1.5e6, 4000.0]
    rows[:, last] = rows[:, first] + 1e-14
    for mark in (last + 1, now):
        rows[:, mark] += 2e-12
        rows[:, mark + 2] += 0.25
    plant.restore(replace(whole, soc=rows[:, last].copy(), ageing=rows))
    plant.step([0.0, 0.0])
    assert (plant.state.soh_capacity > 0.999).all()


def test_a_retired_string_has_cost_its_replacement_and_does_no_more() -> None:
    data = run({}, **{"wear.at_end_of_life": "retire"}).dataset
    end = int(data["end_of_life"].values[:, 0].argmax())
    assert data["soh_capacity"].values[end, 0] <= 0.8
    assert not data["request_kw"].values[end + 1 :, 0].any()
    assert data["request_kw"].values[: end + 1, 0].any()
    assert data["request_kw"].values[end + 1 :, 1].any()
    lost = 0.80002 - data["soh_capacity"].values[end, 0]
    assert data["wear_eur"].values[:, 0].sum() == pytest.approx(lost * EUR_PER_LOSS[0])
    assert not data["investment_eur"].values.any()


def test_a_replaced_string_starts_anew_in_the_next_step_at_its_cost() -> None:
    data = run({}, **{"wear.at_end_of_life": "replace"}).dataset
    end = int(data["end_of_life"].values[:, 0].argmax())
    paid = data["investment_eur"].values
    assert np.argwhere(paid).tolist() == [[end + 1, 0]]
    assert paid.sum() == pytest.approx(EUR_PER_LOSS[0] * (1.0 - 0.8))
    said = list(event_sentences({"": cast(Run, SimpleNamespace(dataset=data, study={}))}))
    assert len(said) == 1
    assert said[0].startswith(f"String 0 got a new battery on {str(data['time'].values[end + 1])[:10]} for ")
    capacity = data["soh_capacity"].values
    assert capacity[end, 0] <= 0.8 < 0.99 < capacity[end + 1, 0]
    # Its wear counts from new.
    assert data["wear_eur"].values[end + 1, 0] == pytest.approx(
        (1.0 - capacity[end + 1, 0]) * EUR_PER_LOSS[0]
    )


def test_a_replacement_at_a_date_costs_what_its_table_says() -> None:
    table = {"string": 1, "date": pd.Timestamp("2024-01-02T12:20Z").to_pydatetime(), "eur_kwh": 70.0}
    data = run(
        {"run.start": pd.Timestamp("2024-01-01T00:00Z").to_pydatetime(), "replacement": [table]}
    ).dataset
    paid = data["investment_eur"].to_series()
    ((time, string),) = paid[paid > 0.0].index
    assert (time, string) == (pd.Timestamp("2024-01-02 12:30"), 1)
    assert paid.sum() == pytest.approx(70.0 * bess.System.reference(2).nominal_energy_kwh[1])
    capacity = data["soh_capacity"].sel(string=1).to_series()
    assert capacity[:"2024-01-02 12:15"].max() < 0.9 < 0.99 < capacity["2024-01-02 12:30"]


def test_an_added_string_is_not_there_before_its_date() -> None:
    table = {"string": 2, "date": pd.Timestamp("2024-01-03T00:00Z").to_pydatetime()}
    values = {
        "run.start": pd.Timestamp("2024-01-01T00:00Z").to_pydatetime(),
        "system.n_strings": 3,
        "system.initial_soh_capacity": 1.0,
        "augmentation": [table],
    }
    result = run(values)
    data = result.dataset.sel(string=2)
    before, after = data.sel(time=slice(None, "2024-01-02 23:45")), data.sel(time=slice("2024-01-03", None))
    assert before.sizes["time"] == 192
    assert not before["delivered_kw"].any() and not before["wear_eur"].any()
    assert after["delivered_kw"].any()
    assert after["wear_eur"].sum() == pytest.approx((1.0 - after["soh_capacity"][-1]) * EUR_PER_LOSS[0])
    assert result.kpis["investment_eur"] == pytest.approx(
        100.0 * bess.System.reference(3).nominal_energy_kwh[2]
    )
    shown = SimpleNamespace(dataset=result.dataset, study=values, system=bess.System.reference(3))
    (said,) = event_sentences({"": cast(Run, shown)})
    assert said == f"String 2 was added on 2024-01-03 for {result.kpis['investment_eur']:,.0f} EUR."
    lost_kw = np.ones(data.sizes["time"])
    assert another_split(cast(Run, shown), lost_kw, lost_kw > 0.0) == ""  # it could not have helped


def test_a_contract_is_compared_with_what_came() -> None:
    contract = {"round_trip_efficiency_pct": 85.0, "availability_pct": 99.0, "throughput_mwh": 2.0}
    kpis = run({f"contract.{key}": value for key, value in contract.items()}, **{"run.days": 1}).kpis
    assert kpis["contract_throughput_left_mwh"] == pytest.approx(2.0 - kpis["discharged_kwh"] / 1000.0)
    assert kpis["contract_availability_margin"] == pytest.approx(kpis["fulfilment_pct"] - 99.0)
    margin = kpis["round_trip_efficiency_pct"] - 85.0
    assert kpis["contract_round_trip_efficiency_margin"] == pytest.approx(margin)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"string": 2}, r"replacement\[0\]\.string = 2: the system has strings 0 to 1"),
        ({"string": 0, "date": pd.Timestamp("2023-12-31T00:00Z").to_pydatetime()}, "must be after the start"),
    ],
)
def test_an_impossible_replacement_is_refused(table: dict[str, Any], message: str) -> None:
    table = {"date": pd.Timestamp("2024-01-02T00:00Z").to_pydatetime()} | table
    with pytest.raises(bess.InputError, match=message):
        run({"run.start": pd.Timestamp("2024-01-01T00:00Z").to_pydatetime(), "replacement": [table]})


@pytest.mark.parametrize(
    ("replaced", "added", "message"),
    [
        (
            ["06:00", "06:00"],
            [],
            r"replacement\[1\]\.date = 2024-01-01 06:00.*another battery of string 0",
        ),
        (
            ["06:01"],
            ["06:14"],
            r"augmentation\[0\]\.date = 2024-01-01 06:14.*another battery of string 0",
        ),
        (["06:00"], ["12:00"], "string 0 gets a new battery before it is added"),
    ],
)
def test_a_battery_that_nobody_would_use_is_refused(
    replaced: list[str], added: list[str], message: str
) -> None:
    def tables(hours: list[str]) -> list[dict[str, Any]]:
        return [
            {"string": 0, "date": pd.Timestamp(f"2024-01-01T{hour}Z").to_pydatetime(), "eur_kwh": 50.0}
            for hour in hours
        ]

    with pytest.raises(bess.InputError, match=message):
        run(
            {"run.start": pd.Timestamp("2024-01-01T00:00Z").to_pydatetime()}
            | {"replacement": tables(replaced), "augmentation": tables(added)}
        )


@pytest.mark.parametrize("at_end", ["retire", "replace"])
def test_a_run_continues_from_a_checkpoint_at_an_end_of_life(at_end: str) -> None:
    study = bess.load_study("case1", AGEING | {"wear.at_end_of_life": at_end})
    whole, steps = closed_loop(study, prepare(study)), 240
    rows = [whole.advance_part(1)[0] for _ in range(steps)]
    end = int(np.argmax([row["end_of_life"][0, 0] for row in rows]))
    first = closed_loop(study, prepare(study))
    for _ in range(end + 1):
        first.advance_part(1)
    second = closed_loop(study, prepare(study))
    second.restore(first.checkpoint())
    for row in rows[end + 1 :]:
        again = second.advance_part(1)[0]
        for name in ("soh_capacity", "request_kw", "wear_eur", "investment_eur"):
            np.testing.assert_array_equal(again[name], row[name])


def test_the_cash_of_years_follows_from_the_record(tmp_path: Path) -> None:
    study = bess.load_study(
        "lifetime",
        {
            "demand.prices": str(two_kinds_of_days(tmp_path, 30)),
            "demand.plan": "linear",
            "demand.replan_h": 36.0,
            "policy.name": "equal",
            "run.days": 400,
            "system.parameters.control": {"step_min": 240.0, "plant_step_s": 900.0},
            "system.initial_soh_capacity": 0.72,
            "wear.at_end_of_life": "replace",
        },
    )
    result = bess.run(study, progress=False)
    data, cash = result.dataset, cash_by_year(result)
    paid = data["investment_eur"].values
    assert paid.any()
    price = 120.0 * bess.System.reference(2).nominal_energy_kwh / (1.0 - 0.7)
    residual = ((data["soh_capacity"].values[-1] - 0.7) * price).sum()
    ledger = ledger_by_year(result)
    year = np.where(data["time"].values < data["time"].values[0] + np.timedelta64(366, "D"), 1, 2)
    for k in (1, 2):
        income = ledger.loc[k, "net_eur"] + data["wear_eur"].values[year == k].sum()
        expected = income - paid[year == k].sum() + residual * (k == 2)
        assert cash.loc[k, "cash_eur"] == pytest.approx(expected)
    for name, eur in (("cash_npv_eur", cash["cash_eur"]), ("npv_eur", ledger["net_eur"])):
        assert result.kpis[name] == pytest.approx(eur[1] / 1.05 + eur[2] / 1.05 ** (1.0 + 34.0 / 365.0))
    assert result.kpis["investment_eur"] == pytest.approx(paid.sum())
    start = np.full((1, 2), 0.5 * (1.0 - 0.72))
    cycles = np.diff(np.concatenate([start, data["cyclic_loss"].values]), axis=0).clip(min=0.0).sum(axis=0)
    per_mwh = 1000.0 * (cycles * price).sum() / result.kpis["discharged_kwh"]
    assert result.kpis["cycle_wear_eur_mwh"] == pytest.approx(per_mwh)


def test_a_string_added_after_the_run_is_worth_nothing_at_its_end(tmp_path: Path) -> None:
    def residual_eur(**date: str) -> float:
        dates = [pd.Timestamp(text, tz="UTC").to_pydatetime() for text in date.values()]
        values = HOURLY | {
            "demand.prices": str(two_kinds_of_days(tmp_path, 3)),
            "policy.name": "equal",
            "run.days": 2,
            "system.initial_soh_capacity": [0.9, 1.0],
            "augmentation": [{"string": 1, "date": each} for each in dates],
        }
        result = bess.run(bess.load_study("lifetime", values), progress=False)
        return float(cash_by_year(result)["residual_eur"].sum())

    later, during = residual_eur(date="2024-01-03"), residual_eur(date="2024-01-03", earlier="2024-01-02")
    of_a_new_battery = 120.0 * bess.System.reference(2).nominal_energy_kwh[0]
    assert later == pytest.approx(of_a_new_battery * 0.2 / 0.3, rel=0.01)
    assert during == pytest.approx(later + of_a_new_battery, rel=0.01)


def test_a_battery_bought_in_the_run_is_worth_no_more_than_was_paid_for_it(tmp_path: Path) -> None:
    values = HOURLY | {
        "demand.prices": str(two_kinds_of_days(tmp_path, 3)),
        "policy.name": "equal",
        "run.days": 2,
        "replacement": [
            {"string": 1, "date": pd.Timestamp("2024-01-02", tz="UTC").to_pydatetime(), "eur_kwh": 80.0}
        ],
    }
    cash = cash_by_year(bess.run(bess.load_study("lifetime", values), progress=False))
    per_kwh = cash["residual_eur"].sum() / bess.System.reference(2).nominal_energy_kwh[0]
    assert per_kwh == pytest.approx(120.0 + 80.0, rel=0.01)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_calendar_and_cycle_wear_are_the_wear_cost_from_the_first_step_on(share: float) -> None:
    values = {"wear.model": "naumann-lfp", "wear.calendar_share": share, "run.days": 1}
    result = run(values, **{"system.initial_soh_capacity": [1.0, 0.9]})
    start = share * (1.0 - np.array([1.0, 0.9]))
    calendar_eur = (result.dataset["calendar_loss"].values[-1] - start) @ np.full(2, EUR_PER_LOSS[0])
    cycle_eur = result.kpis["cycle_wear_eur_mwh"] * result.kpis["discharged_kwh"] / 1000.0
    assert cycle_eur + calendar_eur == pytest.approx(result.kpis["wear_eur"])


@pytest.mark.closed_form
def test_a_life_of_few_cycles_earns_most_on_the_days_that_pay_most(tmp_path: Path) -> None:
    """Four cycles are left, and ageing is linear in them: at no price a plant spends them on four days, good
    and bad in turn, at a price between both spreads on four good days. Over the round trip it buys at
    100 - spread / 2, and sells at 100 + spread / 2."""
    per_cycle = 7.7e-5
    values = HOURLY | {
        "demand.prices": str(two_kinds_of_days(tmp_path, 8)),
        "run.days": 8,
        "system.initial_soh_capacity": 0.8 + 4.0 * per_cycle,
        "system.initial_soc": 0.0,
        "wear.calendar_share": 0.3,
        "sweep": [],
    }
    earned = {}
    for price in (0.0, 100.0):
        study = bess.load_study("wear-price", values | {"wear.eur_per_mwh": price})
        result = bess.run(study, progress=False)
        cash = cash_by_year(result)
        assert not cash["residual_eur"].any()
        earned[price] = float(cash["income_eur"].sum())
        if price == 0.0:
            assert 3.5 < result.kpis["end_of_life_days"] <= 4.0
    assert result.kpis["soh_capacity_min"] - 0.8 < 0.1 * per_cycle
    good, bad = ((100.0 + spread / 2.0) - (100.0 - spread / 2.0) / 0.92 for spread in (160.0, 60.0))
    assert earned[100.0] / earned[0.0] == pytest.approx(4.0 * good / (2.0 * good + 2.0 * bad), rel=0.06)


@pytest.mark.closed_form
def test_a_search_closes_in_on_the_top_of_a_hump() -> None:
    study = bess.load_study("wear-price", {"demand.prices": "prices.csv"})
    runs = expand(study)
    for _ in range(study.refinements):
        kpis = {
            name: {"cash_npv_eur": -(((each.wear.eur_per_mwh or 0.0) - 47.0) ** 2)}
            for name, each in runs.items()
        }
        runs |= refined(study, runs, kpis)
    tried = sorted(each.wear.eur_per_mwh or 0.0 for each in runs.values())
    assert tried == [0.0, 20.0, 30.0, 40.0, 45.0, 50.0, 55.0, 60.0, 80.0, 120.0, 160.0]


def test_a_search_of_which_one_run_finished_ends() -> None:
    study = bess.load_study("wear-price", {"demand.prices": "prices.csv"})
    runs = expand(study)
    assert refined(study, runs, {next(iter(runs)): {"cash_npv_eur": 1.0}}) == {}


def tried(study: bess.Study, unknown: float, **kpis: float) -> list[float]:
    """Prices tried in a search for the top at 0, of which the run at a price has other KPIs."""
    runs = expand(study)
    for _ in range(2):
        prices = {name: each.wear.eur_per_mwh or 0.0 for name, each in runs.items()}
        found = {name: {"cash_npv_eur": -eur} if eur != unknown else kpis for name, eur in prices.items()}
        runs |= refined(study, runs, found)
    return sorted(each.wear.eur_per_mwh or 0.0 for each in runs.values())


@pytest.mark.parametrize("kpis", [{"cash_npv_eur": np.nan}, {"cash_npv_eur": np.inf}, {}])
def test_a_search_passes_over_a_run_without_a_number(kpis: dict[str, float]) -> None:
    study = bess.load_study("wear-price", {"demand.prices": "prices.csv"})
    assert tried(study, 160.0, **kpis) == [0.0, 10.0, 20.0, 40.0, 80.0, 120.0, 160.0]
    assert tried(study, 0.0, **kpis) == [0.0, 40.0, 50.0, 60.0, 80.0, 120.0, 160.0]


def test_a_search_in_which_no_run_has_a_number_names_the_kpi() -> None:
    study = bess.load_study("wear-price", {"demand.prices": "prices.csv"})
    runs = expand(study)
    with pytest.raises(bess.InputError, match=r"sweep\.maximise = 'cash_npv_eur'.*is nan in run"):
        refined(study, runs, {name: {"cash_npv_eur": np.nan} for name in runs})


def test_a_search_over_whole_numbers_stays_among_them() -> None:
    axis = {"key": "policy.horizon_steps", "values": [2, 4, 8], "maximise": "net_eur", "refine": 3}
    study = bess.load_study("case1", {"sweep": [axis]})
    runs = expand(study)
    for _ in range(study.refinements):
        steps = {name: each.policy.horizon_steps for name, each in runs.items()}
        runs |= refined(study, runs, {name: {"net_eur": -abs(value - 6.0)} for name, value in steps.items()})
    assert sorted(each.policy.horizon_steps for each in runs.values()) == [2, 3, 4, 5, 6, 7, 8]


def test_a_search_over_texts_is_refused_before_it_runs(tmp_path: Path) -> None:
    axis = {"key": "policy.name", "values": ["equal", "soc"], "maximise": "net_eur", "refine": 1}
    study = bess.load_study("case1", {"run.days": 0.25, "sweep": [axis]})
    with pytest.raises(bess.InputError, match="a search needs numbers"):
        bess.run_scenarios(study, progress=False, out=tmp_path)
    assert not any(tmp_path.glob("*/"))


def test_a_search_writes_a_table_whose_page_names_the_best_price(tmp_path: Path) -> None:
    study = bess.load_study(
        "wear-price",
        HOURLY
        | {
            "demand.prices": str(two_kinds_of_days(tmp_path, 2)),
            "run.days": 2,
            "sweep": [
                {"key": "wear.eur_per_mwh", "values": [0.0, 100.0, 200.0], "maximise": "net_eur", "refine": 1}
            ],
        },
    )
    results = bess.run_scenarios(study, progress=False, out=tmp_path / "search")
    assert len(results) == 5
    table = read_sweep(tmp_path / "search")
    assert table is not None
    best = max(results.values(), key=lambda result: result.kpis["net_eur"])
    said = table.front_sentence()
    price = bess.load_study(
        tmp_path / "search" / best.dataset.attrs["scenario"] / "study.toml"
    ).wear.eur_per_mwh
    assert said.startswith(
        f"Best wear.eur_per_mwh: {price:g}, with net income {best.kpis['net_eur']:,.2f} EUR"
    )
    assert "200 costs" in said and "depreciation price" in said
    assert [figure.name for figure in table.exhibits()][:2] == ["front", "search"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "has no such KPI"),
        ({"scenario": [{"name": "a", "set": {}}]}, "one axis and no scenarios"),
    ],
)
def test_an_invalid_search_is_refused(values: dict[str, Any], message: str) -> None:
    study = bess.load_study("wear-price", {"demand.prices": "prices.csv"} | values)
    with pytest.raises(bess.InputError, match=message):
        refined(study, runs := expand(study), {name: {"net_eur": 0.0} for name in runs})
