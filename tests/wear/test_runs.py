"""Claims about studies of strings that wear: what is recorded, what it costs, and how long they last."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tomli_w
from numpy.typing import NDArray

import bess
from bess.simulation.analysis.lifetime import ledger_by_year, net_present_value
from bess.study import expand

DAYS = 6
AGED = {
    "policy.name": "soc",
    "run.days": DAYS,
    "demand.repeat": True,
    "system.ambient_c": 35.0,
    "wear.model": "kokam-75ah",
    "wear.replacement_eur_kwh": 250.0,
    "wear.end_of_life": 0.7,
}


def run(values: dict[str, Any], **more: Any) -> bess.Result:
    return bess.run(bess.load_study("case1", values | more), progress=False)


@pytest.fixture(scope="module")
def aged() -> bess.Result:
    return run(
        AGED,
        **{"system.initial_soh_capacity": [1.0, 0.85], "system.initial_soh_resistance": [1.0, 1.4]},
    )


def test_wear_in_eur_is_the_loss_of_health_at_its_price(aged: bess.Result) -> None:
    frame = aged.dataset[["soh_capacity", "wear_eur", "calendar_loss", "cyclic_loss"]].to_dataframe()
    lost = np.array([1.0, 0.85]) - frame["soh_capacity"].groupby("string").last().to_numpy()
    price = 250.0 * bess.System.reference(2).nominal_energy_kwh / (1.0 - 0.7)
    np.testing.assert_allclose(frame["wear_eur"].groupby("string").sum(), lost * price, rtol=1e-9)
    np.testing.assert_allclose(frame[["soh_capacity", "calendar_loss", "cyclic_loss"]].sum(axis=1), 1.0)
    assert aged.kpis["wear_eur"] == pytest.approx(frame["wear_eur"].sum())
    assert aged.kpis["soh_capacity_min"] == frame["soh_capacity"].min()
    assert aged.kpis["soh_resistance_max"] > 1.4


def test_strings_of_different_age_age_differently_and_keep_their_charge(aged: bess.Result) -> None:
    data = aged.dataset
    # A young string loses faster.
    lost = np.array([1.0, 0.85]) - data["soh_capacity"].values[-1]
    assert lost[0] > lost[1] > 0.0
    capacity_ah = 376.0 * data["soh_capacity"].values[-1]
    drawn_ah = data["current_a"].values.sum(axis=0) * 0.25
    start_ah = 376.0 * np.array([1.0, 0.85]) * data.attrs["initial_soc"]
    left_ah = start_ah - drawn_ah - data["aged_charge_ah"].values.sum(axis=0)
    np.testing.assert_allclose(capacity_ah * data["soc"].values[-1], left_ah, rtol=1e-9)


def test_a_price_of_throughput_changes_nothing_but_the_bill() -> None:
    free = run(AGED, **{"wear.model": "none"})
    priced = run(AGED, **{"wear.model": "throughput", "wear.eur_per_mwh": 40.0})
    delivered = free.dataset["delivered_kw"]
    assert priced.dataset["delivered_kw"].identical(delivered)
    expected = np.maximum(delivered.values, 0.0) * 0.25 / 1000.0 * 40.0
    np.testing.assert_allclose(priced.dataset["wear_eur"].values, expected)
    assert free.kpis["wear_eur"] == 0.0
    assert priced.kpis["soh_capacity_min"] == 1.0
    assert "end_of_life" not in priced.dataset


def test_a_string_of_a_system_file_may_wear_by_a_model_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    document = bess.System.reference(3).document | {
        "wear": {"model": "nmc-a-75ah"},
        "string": [{}, {"wear": {"model": "naumann-lfp"}}, {"wear": {"model": "none"}}],
    }
    path.write_text(tomli_w.dumps(document))
    light = AGED | {"policy.name": "equal", "demand.scale": 0.3}
    given = {"wear.model": "schmalstieg", "system.n_strings": 3}

    def left(**values: Any) -> NDArray[np.float64]:
        return np.asarray(run(light, **given, **values).dataset["soh_capacity"].values[-1])

    mixed = left(**{"system.file": str(path)})
    # The study's model takes the place of the system's, not of that of a single string.
    assert mixed[0] == pytest.approx(left()[0], abs=1e-6)
    given["wear.model"] = "naumann-lfp"
    assert mixed[1] == pytest.approx(left()[1], abs=1e-6)
    assert mixed[0] + 1e-5 < mixed[1] < 0.999
    assert mixed[2] == 1.0


def test_the_end_of_life_is_an_event_of_its_string_and_the_run_goes_on() -> None:
    result = run(AGED, **{"system.initial_soh_capacity": [0.7002, 0.9], "wear.end_of_life": 0.7})
    event = result.dataset["end_of_life"]
    assert event.values.sum(axis=0).tolist() == [1, 0]
    step = int(event.values[:, 0].argmax())
    capacity = result.dataset["soh_capacity"].values[:, 0]
    assert capacity[step] <= 0.7 < capacity[step - 1]
    assert result.kpis["end_of_life_days"] == pytest.approx((step + 1) / 96)
    assert result.dataset.sizes["time"] == 96 * DAYS


@pytest.mark.parametrize("soh", [0.01, 0.03])
def test_the_smallest_capacity_is_not_raised_by_ageing(soh: float) -> None:
    result = run(AGED, **{"system.initial_soh_capacity": soh})
    assert 0.01 <= result.dataset["soh_capacity"].values.max() <= soh
    assert result.kpis["wear_eur"] >= 0.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"wear.model": "rust"}, "is no model of ageing; allowed: none, throughput, kokam-75ah"),
        ({"wear.model": "throughput"}, 'model = "throughput" needs eur_per_mwh'),
        ({"wear.end_of_life": 1.0}, "wear.end_of_life = 1.0: must be in [0, 1)"),
        ({"system.initial_soh_capacity": [1.0, 0.001]}, "must be in [0.01, 1.5]"),
    ],
)
def test_invalid_wear_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(bess.InputError) as error:
        run(AGED | values)
    assert message in str(error.value)


@pytest.fixture(scope="module")
def years(tmp_path_factory: pytest.TempPathFactory) -> bess.Result:
    """Three years of a price file of one leap year, in steps of four hours."""
    folder = tmp_path_factory.mktemp("prices")
    hours = pd.date_range("2024-01-01", "2025-01-01", freq="h", inclusive="left", tz="UTC")
    price = pd.Series(
        50.0 + 40.0 * np.sin(np.arange(hours.size) * np.pi / 12.0) + hours.day_of_year.to_numpy(), hours
    )
    price.rename("price_eur_mwh").rename_axis("time").to_csv(folder / "prices.csv")
    study = bess.load_study(
        "lifetime",
        {
            "demand.prices": str(folder / "prices.csv"),
            "system.parameters.control": {"step_min": 240.0, "plant_step_s": 900.0},
            "demand.plan": "linear",
            "demand.replan_h": 24.0,
            "run.days": 3 * 365 + 1,
        },
    )
    return bess.run(study, progress=False)


def test_the_year_of_a_price_file_repeats_on_its_days_of_the_calendar(years: bess.Result) -> None:
    price = years.dataset["price_eur_mwh"].to_series()
    assert price.index[0] == pd.Timestamp("2024-01-01")
    assert price.index[-1] == pd.Timestamp("2026-12-31 20:00")
    for later in ("2025", "2026"):
        year = price[later]
        assert year.size == 365 * 6
        first = price["2024"][~((price["2024"].index.month == 2) & (price["2024"].index.day == 29))]
        np.testing.assert_allclose(year.to_numpy(), first.to_numpy(), rtol=1e-9)


def test_the_ledger_by_year_and_its_present_value_add_up(years: bess.Result) -> None:
    by_year = ledger_by_year(years)
    assert by_year.index.tolist() == [1, 2, 3]
    np.testing.assert_allclose(by_year.sum()["net_eur"], years.kpis["net_eur"])
    np.testing.assert_allclose(by_year.sum()["wear_eur"], years.kpis["wear_eur"])
    net = by_year["net_eur"]
    assert years.kpis["npv_eur"] == pytest.approx(net[1] / 1.05 + net[2] / 1.05**2 + net[3] / 1.05**3)
    assert by_year["wear_eur"].is_monotonic_decreasing


def test_a_present_value_is_that_of_a_pocket_calculator() -> None:
    assert net_present_value([110.0, 121.0], 0.1) == pytest.approx(200.0)
    assert net_present_value([], 0.1) == 0.0
    with pytest.raises(bess.InputError, match="discount_rate -1"):
        net_present_value([1.0], -1.0)


@pytest.mark.closed_form
@pytest.mark.parametrize("days", [30, 365, 400, 760])
def test_the_part_of_a_year_is_discounted_from_its_own_end(days: int) -> None:
    """Of income of 1 EUR a day, the present value is that of daily amounts within half a year of interest."""
    whole, left = divmod(days - 1, 365)
    amounts, last_year = [365.0] * whole + [left + 1.0], (left + 1.0) / 365.0
    value = net_present_value(amounts, 0.05, last_year=last_year)
    expected = 365.0 * (1.0 - 1.05**-whole) / 0.05 + (left + 1.0) * 1.05 ** -(days / 365.0)
    assert value == pytest.approx(expected)
    daily = sum(1.05 ** -((day + 0.5) / 365.0) for day in range(days))
    assert daily / 1.05**0.51 < value < daily


@pytest.mark.parametrize("last_year", [0.0, -0.5, 1.5, np.nan])
def test_a_last_year_is_a_share_of_one(last_year: float) -> None:
    with pytest.raises(bess.InputError, match="last_year"):
        net_present_value([1.0], 0.05, last_year=last_year)


@pytest.mark.slow
def test_ten_times_as_long_costs_ten_times_as_much_also_with_ageing() -> None:
    """A year without ageing and ten with it, both a tenth as long; processor time, as a ratio."""
    values = {"policy.name": "equal", "demand.repeat": True, "demand.scale": 0.5}

    def seconds(days: float, model: str) -> float:
        start = time.process_time()
        run(values, **{"run.days": days, "wear.model": model})
        return time.process_time() - start

    seconds(2.0, "none")
    assert seconds(365.0, "kokam-75ah") < 12.0 * seconds(36.5, "none")


def test_a_sweep_over_the_price_of_wear_has_its_best_inside(tmp_path: Path) -> None:
    """Days whose spread pays for the wear of a cycle, and days whose spread does not."""
    hours = pd.date_range("2024-01-01", periods=6 * 24, freq="h", tz="UTC")
    spread = np.where(np.arange(hours.size) // 24 % 2 == 0, 160.0, 50.0)
    price = 60.0 + spread / 2.0 * np.where(hours.hour.to_numpy() % 12 < 6, -1.0, 1.0)
    pd.Series(price, hours, name="price_eur_mwh").rename_axis("time").to_csv(tmp_path / "prices.csv")
    values = {"demand.prices": str(tmp_path / "prices.csv"), "run.days": 6}
    runs = expand(bess.load_study("wear-price", values))
    assert len(runs) >= 5
    chosen = {study.wear.eur_per_mwh: study for study in runs.values()}
    net = {price: bess.run(chosen[price], progress=False).kpis["net_eur"] for price in (0.0, 80.0, 160.0)}
    assert net[80.0] > net[0.0]
    assert net[80.0] > net[160.0]
