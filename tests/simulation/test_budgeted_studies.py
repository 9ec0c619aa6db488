"""Claims about studies with a budget of a year."""

import os
import signal
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import bess
from bess.study.grid import TimeGrid
from power_cut import before_steps

DAYS = 8.0
CYCLES = 2.5


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    hours = pd.date_range("2023-01-01", periods=24 * int(DAYS), freq="1h", tz="UTC")
    price = 60.0 + 50.0 * np.sin(2.0 * np.pi * hours.hour / 12.0) + 20.0 * np.sin(np.arange(hours.size) // 24)
    path = tmp_path_factory.mktemp("prices") / "prices.csv"
    pd.Series(price, hours, name="price_eur_mwh").rename_axis("time").to_csv(path)
    return {
        "demand.prices": str(path),
        "policy.name": "equal",
        "wear.model": "none",
        "budget.cycles_per_year": CYCLES * 365.0 / DAYS,
    }


@pytest.mark.parametrize(("plan", "soh"), [("linear", 1.0), ("aware", 0.7)])
def test_a_run_keeps_its_budget_and_the_record_says_at_what_price(
    values: dict[str, Any], plan: str, soh: float
) -> None:
    aged = {"system.initial_soh_capacity": soh, "demand.plan": plan}
    study = bess.load_study("arbitrage-2024", values | aged)
    result = bess.run(study, progress=False)
    record = result.dataset
    change = np.diff(record["soc"].values, axis=0, prepend=np.array([record.attrs["initial_soc"]]))
    change *= soh  # a cycle is the nominal energy of the system file
    cycles = max(np.maximum(sign * change, 0.0).mean(axis=1).sum() for sign in (1.0, -1.0))
    assert 0.8 * CYCLES < cycles <= CYCLES
    assert soh * result.kpis["full_cycles"] <= cycles
    assert result.kpis["budget_used_pct"] == pytest.approx(100.0 * cycles / CYCLES)
    used = np.maximum(*(np.maximum(sign * change, 0.0).mean(axis=1).cumsum() for sign in (1.0, -1.0)))
    np.testing.assert_allclose(record["budget_cycles"].values[1:], used[:-1], atol=1e-12)
    assert (record["budget_price_eur_mwh"].values > 0.0).all()


def first_price(values: dict[str, Any], **more: Any) -> float:
    result = bess.run(bess.load_study("arbitrage-2024", values | {"run.days": 1.0} | more), progress=False)
    return float(result.dataset["budget_price_eur_mwh"].values[0])


def with_capacity(values: dict[str, Any], share: float, **keys: Any) -> dict[str, Any]:
    """Limits on energy of a plant of which ``share`` is there, with ``keys``."""
    whole = {"budget.cycles_per_year": values["budget.cycles_per_year"] / share}
    return values | whole | {key.replace("__", "."): value for key, value in keys.items()}


@pytest.mark.parametrize("plan", ["linear", "aware"])
@pytest.mark.parametrize("wear", [{}, {"wear.model": "nmc-a-75ah", "wear.eur_per_mwh": 20.0}])
def test_the_price_for_an_aged_plant_is_that_for_a_new_one_of_its_capacity(
    values: dict[str, Any], plan: str, wear: dict[str, Any]
) -> None:
    """Budgets of the same energy; resistance aside, a smaller cell is an aged one."""
    values = values | {"demand.plan": plan, "budget.cycles_per_year": 400.0} | wear
    smaller = with_capacity(values, 0.6, system__parameters={"battery": {"cell_capacity_ah": 0.6 * 94.0}})
    aged = first_price(values | {"system.initial_soh_capacity": 0.6})
    assert aged == pytest.approx(first_price(smaller), rel=1e-6)
    assert aged < 0.9 * first_price(values)


@pytest.mark.parametrize("plan", ["linear", "aware"])
def test_the_price_while_a_string_is_out_is_that_of_a_plant_without_it(
    values: dict[str, Any], plan: str
) -> None:
    """Also if the string that is out has another age, and so another price of wear."""
    values = values | {"demand.plan": plan, "wear.model": "naumann-lfp"}
    day = {"start": datetime(2023, 1, 1, tzinfo=UTC), "end": datetime(2023, 1, 2, tzinfo=UTC)}
    out = {"event": [{"string": 1} | day], "system.initial_soh_capacity": [1.0, 0.85]}
    alone = first_price(with_capacity(values, 0.5, system__n_strings=1))
    assert first_price(values | out) == pytest.approx(alone, rel=1e-6)


def test_a_plant_of_which_no_string_is_in_service_has_no_price(values: dict[str, Any]) -> None:
    day = {"start": datetime(2023, 1, 1, tzinfo=UTC), "end": datetime(2023, 1, 2, tzinfo=UTC)}
    assert first_price(values | {"event": [{"string": string} | day for string in (0, 1)]}) == 0.0


def test_throughput_is_energy_discharged(values: dict[str, Any]) -> None:
    limits = {"budget.cycles_per_year": 1e4, "budget.throughput_mwh_per_year": 1.2 * 365.0 / DAYS}
    kpis = bess.run(bess.load_study("arbitrage-2024", values | limits), progress=False).kpis
    assert 0.8 * 1.2e3 < kpis["discharged_kwh"] <= 1.2e3
    assert kpis["budget_used_pct"] == pytest.approx(100.0 * kpis["discharged_kwh"] / 1.2e3)


@pytest.mark.parametrize("plan", ["linear", "aware"])
@pytest.mark.parametrize("cycles_per_day", [1.0, 8.0])
def test_a_budget_that_a_run_would_not_use_does_not_change_it(
    values: dict[str, Any], plan: str, cycles_per_day: float
) -> None:
    """With fees and wear, or a daily limit, that leave more than a cycle of it."""
    given = values | {
        "run.days": 4.0,
        "wear.model": "throughput",
        "demand.plan": plan,
        "demand.cycles_per_day": cycles_per_day,
        "settlement.charge_fee_eur_mwh": 15.0,
        "settlement.discharge_fee_eur_mwh": 15.0,
    }
    del given["budget.cycles_per_year"]
    free = bess.run(bess.load_study("arbitrage-2024", given), progress=False)
    cycles = free.kpis["full_cycles"] + 1.5
    given["budget.cycles_per_year"] = cycles * 365.0 / 4.0
    kept = bess.run(bess.load_study("arbitrage-2024", given), progress=False)
    np.testing.assert_allclose(kept.dataset["demand_kw"], free.dataset["demand_kw"], atol=1e-6)


def test_a_plant_whose_throughput_is_used_up_has_no_demand(values: dict[str, Any]) -> None:
    """Without a limit of cycles, the charging power of the budget is infinite."""
    limits = {"budget.cycles_per_year": None, "budget.throughput_mwh_per_year": 0.01 * 365.0 / DAYS}
    given = {key: value for key, value in (values | limits).items() if value is not None}
    result = bess.run(bess.load_study("arbitrage-2024", given | {"demand.plan": "linear"}), progress=False)
    demand_kw = result.dataset["demand_kw"].values
    assert 5.0 < result.kpis["discharged_kwh"] <= 10.0
    assert np.isfinite(demand_kw).all() and not demand_kw[-96:].any()


def test_a_run_that_was_stopped_goes_on_with_what_it_had_used(
    values: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study("arbitrage-2024", values | {"demand.plan": "linear"})
    whole = bess.run(study, progress=False).dataset
    taken = iter(range(10**6))

    def interrupted(steps: int) -> None:
        if 500 in islice(taken, steps):
            os.kill(os.getpid(), signal.SIGINT)

    with monkeypatch.context() as patch:
        before_steps(patch, interrupted)
        with pytest.raises(bess.StoppedEarly):
            bess.run(study, progress=False, out=tmp_path / "run")
    resumed = bess.run(study, progress=False, out=tmp_path / "run", resume=True).dataset
    assert 0 < int(np.argmax(whole["budget_cycles"].values > 0.5)) < 500
    for name in whole.data_vars:
        np.testing.assert_array_equal(resumed[name].values, whole[name].values, err_msg=str(name))


def test_trade_beside_a_reserve_leaves_it_the_cycles_that_it_needs() -> None:
    study = bess.load_study("fcr-arbitrage", {"policy.name": "equal", "run.days": 4.0})
    free = bess.run(study, progress=False)
    cycles = 0.6 * free.kpis["full_cycles"]
    kept = bess.run(study.with_values({"budget.cycles_per_year": cycles * 366.0 / 4.0}), progress=False)
    assert kept.kpis["full_cycles"] < cycles
    assert 80.0 < kept.kpis["budget_used_pct"] <= 100.0
    assert kept.kpis["outside_window_h"] <= free.kpis["outside_window_h"]
    asked = kept.dataset["response_kw"] + kept.dataset["schedule_kw"]
    np.testing.assert_allclose(kept.dataset["demand_kw"].values, asked.values, atol=1e-9)


def test_the_price_beside_a_reserve_is_that_of_the_strings_in_service() -> None:
    """The second string is out: a plant of one string with the same reserve, or without the power for it."""
    start = datetime(2024, 1, 1, tzinfo=UTC)
    out = {"event": [{"string": 1, "start": start, "end": datetime(2024, 1, 2, tzinfo=UTC)}]}

    def price(capacity_kw: float, cycles: float, **more: Any) -> float:
        values = {"policy.name": "equal", "run.days": 1.0, "budget.cycles_per_year": cycles}
        reserve = {
            "demand.capacity_kw": capacity_kw,
            "demand.recharge_kw": 10.0,
            "demand.cycles_per_day": 8.0,
        }
        result = bess.run(bess.load_study("fcr-arbitrage", values | reserve | more), progress=False)
        return float(result.dataset["budget_price_eur_mwh"].values[0])

    alone = price(40.0, 400.0, **{"system.n_strings": 1})
    assert price(40.0, 200.0, **out) == pytest.approx(alone, rel=1e-6)
    assert 0.0 < alone < 0.95 * price(40.0, 200.0)
    assert price(85.0, 200.0, **out) == 0.0


def test_a_reserve_is_not_there_once_the_budget_is_used() -> None:
    values = {"policy.name": "equal", "run.days": 1.0, "budget.cycles_per_year": 0.2 * 366.0}
    result = bess.run(bess.load_study("fcr-arbitrage", values), progress=False)
    assert result.kpis["budget_used_pct"] <= 100.0
    assert (result.dataset["capacity_able_kw"].values[-8:] == 0.0).all()


def test_a_demand_that_does_not_trade_has_no_budget() -> None:
    with pytest.raises(bess.InputError, match=r'demand\.kind = "profile" does not trade'):
        bess.load_study("case1", {"budget.cycles_per_year": 300.0})


@pytest.mark.parametrize(
    ("start", "days", "years"),
    [
        (datetime(2024, 1, 1, tzinfo=UTC), 366.0, [0, 366]),
        (datetime(2023, 12, 31, 23, tzinfo=UTC), 366.0, [0, 366]),
        (datetime(2023, 3, 1, tzinfo=UTC), 367.0, [0, 366, 731]),
        (datetime(2024, 2, 29, tzinfo=UTC), 1.0, [0, 365]),
    ],
)
def test_a_year_lasts_to_the_same_day_of_the_next(start: datetime, days: float, years: list[int]) -> None:
    grid = TimeGrid.of(start, 900.0, days)
    assert (grid.years / 96).tolist() == years
