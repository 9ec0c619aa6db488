"""Claims about trade behind a meter: load, generation, limits of the connection, the peak of a month."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from interrupted import continued

import bess
from bess.control.policies import PolicyInput
from bess.dispatch import Arbitrage, GridConnection, PeakTariff, PerfectForecast, monthly_peaks_kw
from bess.errors import InputError

PRICE = np.array([0.0, 0.0, 100.0])


def planned(
    eur_kw: float | None, net_kw: Any = 0.0, price: Any = PRICE, so_far_kw: float = 0.0, **limits: float
):
    """Plan of a store of 100 kW and 100 kWh without losses over steps of 1 h."""
    net_kw, n = np.broadcast_to(net_kw, len(price)), len(price)
    tariff = None if eur_kw is None else PeakTariff(eur_kw, np.zeros(n, np.int64), np.arange(n))
    connection = GridConnection(PerfectForecast(net_kw), 1.0, tariff=tariff, **limits)
    connection.raise_peak(so_far_kw)
    return Arbitrage(
        PerfectForecast(price), np.zeros(n), power_kw=100.0, energy_kwh=100.0, efficiency=1.0,
        look_ahead_h=float(n), replan_h=1.0, dt_h=1.0, connection=connection,
    ).plan(0, 0.0)  # fmt: skip


@pytest.mark.closed_form
def test_a_peak_is_worth_what_its_two_hours_of_charging_earn() -> None:
    """A kW charges 2 kWh, which earn 0.20 EUR."""
    np.testing.assert_allclose(planned(0.19), [-50.0, -50.0, 100.0], atol=1e-4)
    np.testing.assert_allclose(planned(0.21), 0.0, atol=1e-4)


@pytest.mark.closed_form
def test_what_is_below_the_peak_so_far_is_free() -> None:
    np.testing.assert_allclose(planned(9.0, so_far_kw=30.0), [-30.0, -30.0, 60.0], atol=1e-4)
    np.testing.assert_allclose(planned(9.0, net_kw=[40.0, 0.0, 0.0]), [0.0, -40.0, 40.0], atol=1e-4)


@pytest.mark.closed_form
def test_a_store_shaves_the_peak_of_a_load_where_that_pays_more_than_trade() -> None:
    shaved = planned(9.0, net_kw=[0.0, 0.0, 90.0], price=np.array([50.0, 50.0, 50.0]))
    np.testing.assert_allclose(shaved, [-30.0, -30.0, 60.0], atol=1e-4)


@pytest.mark.closed_form
def test_limits_hold_at_the_meter_and_generation_above_them_is_charged() -> None:
    plan = planned(None, net_kw=[-80.0, 20.0, -10.0], max_export_kw=40.0, max_import_kw=60.0)
    np.testing.assert_allclose(plan[0] + plan[1], -30.0, atol=1e-4)  # no more than is sold later
    assert plan[2] == pytest.approx(30.0) and plan[1] >= -40.0
    surplus = planned(None, net_kw=[-80.0, 0.0, 0.0], price=np.array([10.0, 9.0, 10.0]), max_export_kw=40.0)
    assert surplus[0] == pytest.approx(-40.0) and surplus[1:].sum() == pytest.approx(40.0)


@pytest.mark.closed_form
def test_a_fee_on_imports_is_not_paid_on_own_generation() -> None:
    price = np.array([50.0, 50.0, 70.0])
    np.testing.assert_allclose(planned(None, price=price, import_fee_eur_mwh=30.0), 0.0, atol=1e-4)
    charged = planned(None, net_kw=[-40.0, 0.0, 0.0], price=price, import_fee_eur_mwh=30.0)
    np.testing.assert_allclose(charged, [-40.0, 0.0, 40.0], atol=1e-4)


def test_peaks_are_means_of_a_quarter_of_an_hour_by_month() -> None:
    tariff = PeakTariff(1.0, np.array([1, 1, 1, 1, 2, 2]), np.array([0, 0, 1, 1, 2, 2]))
    peaks = monthly_peaks_kw(np.array([10.0, 30.0, 50.0, -30.0, -5.0, 1.0]), tariff)
    np.testing.assert_allclose(peaks, [0.0, 20.0, 20.0, 20.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    hours = pd.date_range("2024-01-30", periods=96, freq="1h", tz="UTC")
    price = 60.0 + 50.0 * np.sin(2.0 * np.pi * hours.hour / 12.0) + np.arange(96) % 7
    path = tmp_path_factory.mktemp("prices") / "prices.csv"
    pd.Series(price, hours, name="price_eur_mwh").rename_axis("time").to_csv(path)
    return {
        "demand.prices": str(path),
        "demand.plan": "linear",
        "demand.look_ahead_h": 24.0,
        "demand.max_export_kw": 60.0,
        "demand.meter.load": "commercial-week",
        "demand.meter.pv": "solar-week",
        "demand.meter.repeat": True,
        "demand.meter.forecast": "persistence",
        "demand.meter.import_fee_eur_mwh": 40.0,
        "demand.meter.peak_eur_kw_month": 4.0,
        "policy.name": "equal",
        "wear.model": "none",
        "run.start": "2024-01-30T00:00:00Z",
        "run.days": 3.0,
    }


def test_the_ledger_is_the_difference_of_two_bills_to_the_cent(values: dict[str, Any]) -> None:
    result = bess.run(bess.load_study("arbitrage-2024", values), progress=False)
    record = result.dataset
    net_kw = (record["load_kw"] - record["generation_kw"]).values
    meter_kw = net_kw - record["delivered_kw"].values.sum(axis=1)
    local = pd.DatetimeIndex(record["time"].values, tz="UTC").tz_convert("Europe/Berlin")

    def bill(kw: Any) -> float:
        price = record["price_eur_mwh"].values
        energy = np.where(kw > 0.0, kw * price, np.maximum(kw, -60.0) * (price - 40.0)).sum() * 0.25 / 1000.0
        return float(energy) + 4.0 * float(pd.Series(kw).clip(lower=0.0).groupby(local.month).max().sum())

    entries = bess.ledger(result)
    own = sum(float(entries[name].sum()) for name in ("wear_eur", "start_eur", "auxiliary_eur"))
    assert float(entries["net_eur"].sum()) == pytest.approx(bill(net_kw) - bill(meter_kw) - own, abs=0.005)
    assert result.kpis["peak_charge_eur"] == pytest.approx(float(entries["peak_charge_eur"].sum()))
    assert meter_kw.min() >= min(-60.0, net_kw.min()) - 1e-6
    assert len(set(local.month)) == 2


def test_a_policy_has_the_forecast_of_the_prices_and_their_fee(values: dict[str, Any]) -> None:
    seen: list[Any] = []

    def equal(inputs: PolicyInput) -> np.ndarray:
        seen.append(inputs.price_eur_mwh)
        return np.full(inputs.limit_kw.size, inputs.demand_kw[0] / inputs.limit_kw.size)

    keys = {"demand.forecast": "persistence", "demand.replan_h": 24.0, "run.start": "2024-01-31T00:00:00Z"}
    study = bess.load_study("arbitrage-2024", values | keys | {"run.days": 0.5})
    paid = bess.run(study, policy=equal, progress=False).dataset["price_eur_mwh"].values
    price = pd.read_csv(values["demand.prices"])["price_eur_mwh"].to_numpy().repeat(4) + 40.0
    for step, ahead in enumerate(seen):
        hour_ends = 4 - step % 4
        np.testing.assert_allclose(ahead[:hour_ends], paid[step])
        np.testing.assert_allclose(ahead[hour_ends : 48 - step], price[step + hour_ends : 48])


def test_a_peak_is_not_shaved_by_the_energy_of_a_string_out_of_service(values: dict[str, Any]) -> None:
    """As little is undelivered as by the other string alone, 15 kWh; it was 21 kWh."""
    out = {"string": 1, "start": "2024-01-30T00:00:00Z", "end": "2024-02-02T00:00:00Z"}
    full = {"event": [out], "system.initial_soc": [0.0, 1.0]}
    alone = {"system.n_strings": 1, "system.initial_soc": 0.0}
    full_kwh, alone_kwh = (
        bess.run(bess.load_study("arbitrage-2024", values | keys), progress=False).kpis["undelivered_kwh"]
        for keys in (full, alone)
    )
    assert full_kwh < 1.05 * alone_kwh


def test_a_run_that_is_continued_knows_its_peak(
    values: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study("arbitrage-2024", values | {"run.days": 1.0})
    whole = bess.run(study, progress=False).dataset
    resumed = continued(study, tmp_path / "run", monkeypatch)
    assert resumed.drop_attrs().identical(whole.drop_attrs())


def test_each_month_has_the_lowest_peak_of_its_own() -> None:
    numbers = {"power_kw": 30.0, "capacity_kwh": 60.0, "stored_kwh": 60.0, "one_way_efficiency": 1.0}
    limit = bess.dispatch.min_peak_kw(np.array([50.0, 100.0, 40.0, 60.0]), 1.0, month=[1, 1, 2, 2], **numbers)
    np.testing.assert_allclose(limit, [70.0, 70.0, 35.0, 35.0], atol=5.1)
    assert limit[0] == pytest.approx(70.0) and limit[2] == limit[3] < 60.0


def test_peak_shaving_settles_the_peak_of_a_month() -> None:
    study = bess.load_study(
        "peak-shaving", {"policy.name": "equal", "run.days": 2.0, "demand.peak_eur_kw_month": 10.0}
    )
    kpis = bess.run(study, progress=False).kpis
    spared = kpis["peak_before_kw"] - kpis["peak_draw_kw"]
    assert spared > 0.0 and kpis["peak_charge_eur"] == pytest.approx(-10.0 * spared)
    assert "capacity_revenue_eur" not in kpis


def test_a_meter_that_cannot_be_planned_with_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(InputError, match='meter: only plan = "linear"'):
        bess.load_study("arbitrage-2024", values | {"demand.plan": "aware"})
    alone = {key: value for key, value in values.items() if key.split(".")[-1] not in ("load", "pv")}
    study = bess.load_study("arbitrage-2024", alone | {"system.parameters.control.step_min": 30.0})
    with pytest.raises(InputError, match="30 min does not divide a quarter of an hour"):
        bess.run(study, progress=False)
