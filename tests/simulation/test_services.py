"""Claims about services: what they ask, what they keep, what they earn."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from interrupted import continued
from scipy.optimize import linprog

import bess
from bess.dispatch import (
    EnergyWindow,
    GridPowerTarget,
    RechargeScheduler,
    StorageEstimator,
    bundled_profile,
    droop_response,
    min_peak_kw,
)
from bess.errors import InputError
from bess.market import read_capacity_prices, read_frequency
from bess.report.charts import operation
from bess.simulation.analysis.settlement import COSTS
from bess.simulation.inputs import prepare
from bess.study.demands.source import StepInputs

DATA = Path(__file__).parents[3] / "shared" / "data"
FREQUENCY = DATA / "bess" / "frequency_france_2019_05_10s.csv.zip"
PRICES = DATA / "fcr" / "fcr_prices_regelleistung_2024.csv.gz"
measured = pytest.mark.skipif(
    not (FREQUENCY.exists() and PRICES.exists()), reason="needs measured files in ../shared/data"
)

LOSSLESS = {
    "system.parameters.battery.r_scale": 1e-9,
    "system.parameters.battery.ocv_v": {"soc": [0.0, 1.0], "charge": [3.7, 3.7], "discharge": [3.7, 3.7]},
    "system.parameters.inverter": {
        "load": [0.0, 1.0],
        "loss_charge": [0.0, 0.0],
        "loss_discharge": [0.0, 0.0],
    },
    "demand.efficiency": 1.0,
    "policy.name": "soc",
}


def outcome(name: str, **values: object) -> bess.Result:
    keys = {key.replace("__", "."): value for key, value in values.items()}
    return bess.run(bess.load_study(name, keys), progress=False)


# What the droop asks


def test_droop_is_in_proportion_outside_of_the_dead_band_and_opposes_the_deviation() -> None:
    deviation = [-300.0, -200.0, -50.0, -10.0, 0.0, 9.0, 10.5, 100.0, 250.0]
    np.testing.assert_allclose(
        droop_response(deviation), [1.0, 1.0, 0.25, 0.0, 0.0, 0.0, -0.0525, -0.5, -1.0], atol=1e-15
    )


def test_a_dead_band_as_wide_as_the_droop_is_refused() -> None:
    with pytest.raises(InputError, match=r"dead_band_mhz = 200 mHz .* below demand\.droop_mhz = 200 mHz"):
        droop_response([0.0], 200.0, 200.0)


@pytest.mark.parametrize("step_min", [1.0, 5.0, 15.0])
def test_a_control_step_asks_for_the_mean_response_within_it(step_min: float, tmp_path: Path) -> None:
    times = pd.date_range("2024-05-01", periods=360, freq="10s", tz="UTC")
    mhz = pd.Series(60.0 * np.sin(np.arange(360) / 17.0), times, name="mhz")
    path = tmp_path / "frequency.csv"
    mhz.to_csv(path, index_label="time")
    values = {
        "demand.frequency": str(path),
        "demand.capacity_kw": 100.0,
        "demand.recharge_kw": 0.0,
        "policy.name": "equal",
        "run.days": 1.0 / 24.0,
        "run.start": times[0].to_pydatetime(),
        "system.parameters.control.step_min": step_min,
    }
    data = bess.run(bess.load_study("fcr", values), progress=False).dataset
    expected = 100.0 * droop_response(mhz).reshape(round(60 / step_min), -1).mean(axis=1)
    np.testing.assert_allclose(data["demand_kw"], expected, atol=1e-9)
    np.testing.assert_allclose(data["response_kw"], expected, atol=1e-9)


# What has to be in store


def test_the_required_window_holds_the_reserve_for_its_duration_in_both_directions() -> None:
    window = EnergyWindow.of(120.0, 15.0, 500.0, 0.9)
    assert window.low_kwh * 0.9 == pytest.approx(120.0 * 0.25)
    assert (500.0 - window.high_kwh) / 0.9 == pytest.approx(120.0 * 0.25)
    assert window.sustainable_kw(120.0, window.low_kwh, 500.0) == pytest.approx(120.0)
    assert window.sustainable_kw(120.0, window.low_kwh / 2.0, 500.0) == pytest.approx(60.0)
    assert window.sustainable_kw(120.0, 500.0, 500.0) == 0.0


def test_a_reserve_that_takes_no_energy_is_always_sustained() -> None:
    """With a duration of almost 0 the window is the whole store."""
    window = EnergyWindow.of(100.0, 1e-300, 200.0, 0.9)
    assert window.sustainable_kw(100.0, 50.0, 200.0) == 100.0


def test_a_recharge_is_agreed_on_ahead_and_reaches_the_band_at_the_end_of_its_slot() -> None:
    recharge = RechargeScheduler(power_kw=50.0, lead_steps=2, slot_steps=1, dt_h=0.25, one_way_efficiency=0.9)
    band, held, shifts = EnergyWindow(100.0, 300.0), 95.5, []
    for step in range(6):
        shift = recharge.advance(step, held, band)
        held += -shift * 0.25 * 0.9 if shift < 0 else -shift * 0.25 / 0.9
        shifts.append(shift)
    assert shifts[:2] == [0.0, 0.0]  # agreed on at step 0, the first shift begins at step 2
    assert shifts[2] == pytest.approx(-(100.0 - 95.5) / 0.9 / 0.25)
    assert shifts[3:] == pytest.approx([0.0] * 3)
    assert held == pytest.approx(100.0)


def test_stored_energy_is_charge_times_voltage() -> None:
    system = bess.System.reference(2)
    store = StorageEstimator(system, 0.9)
    full = bess.State([1.0, 1.0], [25.0, 25.0])
    assert store.stored_kwh(full) == pytest.approx(system.nominal_energy_kwh.sum(), rel=1e-9)
    half = bess.State([0.5, 0.5], [25.0, 25.0], soh_capacity=[0.8, 0.8])
    assert store.stored_kwh(half) < 0.4 * store.stored_kwh(full)
    assert store.soc_at(half, store.stored_kwh(half)) == pytest.approx(0.5, abs=1e-6)


def test_the_round_trip_of_a_store_follows_what_goes_in_and_out_from_the_setting_on() -> None:
    """A store of 0.8 each way that is told 0.95, which counts as much as one full charge."""
    system = bess.System.reference(2)
    store = StorageEstimator(system, 0.95**2)
    empty, full = (bess.State([soc, soc], [25.0, 25.0]) for soc in (0.0, 1.0))
    capacity_kwh = store.capacity_kwh(full)
    store.update(empty, 0.0)
    assert store.one_way_efficiency == pytest.approx(0.95, rel=1e-12)
    seen = []
    for _ in range(10):
        store.update(full, -capacity_kwh / 0.8)
        store.update(empty, capacity_kwh * 0.8)
        seen.append(store.one_way_efficiency)
    assert seen == sorted(seen, reverse=True)
    charged, discharged = capacity_kwh * (1.0 + 10.0 / 0.8), capacity_kwh * (0.95**2 + 10.0 * 0.8)
    assert store.one_way_efficiency == pytest.approx(math.sqrt(discharged / charged), rel=1e-12)
    again = StorageEstimator(system, 0.5)
    again.load_state_dict(store.state_dict())
    assert again.one_way_efficiency == store.one_way_efficiency


def test_a_store_that_was_only_charged_shows_its_round_trip_as_well() -> None:
    store = StorageEstimator(bess.System.reference(2), 0.8**2)
    empty, full = (bess.State([soc, soc], [25.0, 25.0]) for soc in (0.0, 1.0))
    store.update(empty, 0.0)
    store.update(full, -store.capacity_kwh(full) / 0.8)
    assert store.one_way_efficiency == pytest.approx(0.8, rel=1e-12)


def test_more_reserve_than_the_plant_holds_is_refused() -> None:
    with pytest.raises(InputError, match=r"for demand\.duration_min = 240 min .* reduce the reserve"):
        outcome("fcr", demand__duration_min=240.0)
    with pytest.raises(InputError, match="leave no power of the 184 kW of the plant; reduce the reserve"):
        outcome("fcr", demand__capacity_kw=180.0)
    with pytest.raises(InputError, match=r"demand\.band = 0: leaves no energy for trade"):
        outcome("fcr-arbitrage", demand__band=0.0)


def test_reserve_that_is_not_sustained_is_paid_back_with_the_penalty() -> None:
    """A plant that starts almost empty and may not recharge."""
    result = outcome(
        "fcr",
        system__initial_soc=0.02,
        demand__recharge_kw=0.0,
        policy__name="equal",
        run__days=0.5,
        settlement__capacity_penalty=3.0,
    )
    data, kpis = result.dataset, result.kpis
    lacking_kw = (data["capacity_kw"] - data["capacity_able_kw"]).values
    missed_kw = np.abs(data["demand_kw"] - data["delivered_kw"].sum("string")).values
    assert kpis["outside_window_h"] > 1.0
    expected = 3.0 * np.maximum(lacking_kw, missed_kw).sum() / 1000.0 * 0.25 * 65.0 / 4.0
    assert kpis["penalty_eur"] == pytest.approx(expected, rel=1e-6)
    assert kpis["net_eur"] == pytest.approx(
        kpis["capacity_revenue_eur"]
        + kpis["discharge_revenue_eur"]
        - sum(kpis.get(name, 0.0) for name in COSTS)
    )


OUT = [{"string": 1, "start": "2024-01-01T00:00:00Z", "end": "2024-01-03T00:00:00Z"}]


def test_the_energy_of_a_string_out_of_service_sustains_no_reserve() -> None:
    """The other one is empty and may not recharge."""
    result = outcome(
        "fcr",
        event=OUT,
        system__initial_soc=[0.0, 0.5],
        demand__capacity_kw=60.0,
        demand__recharge_kw=0.0,
        policy__name="soc",
        run__days=0.25,
    )
    stored_kwh = result.dataset["soc"].values[:, 0] * 192 * 4 * 94.0 * 3.7 / 1000.0
    able_kw = result.dataset["capacity_able_kw"].values
    assert able_kw[0] == 0.0
    assert np.all(able_kw[1:] <= stored_kwh[:-1] / 0.25)  # SOC is that of the end of a step


@pytest.mark.parametrize("soc", [0.02, 0.5])
def test_nothing_is_recharged_because_no_string_is_in_service(soc: float) -> None:
    """The energy of the strings counts again when they return; until then, empty ones take no power."""
    all_out = [OUT[0] | {"string": string} for string in (0, 1)]
    record = outcome("fcr", event=all_out, system__initial_soc=soc, policy__name="soc", run__days=2.0).dataset
    assert not record["schedule_kw"].values.any()


@pytest.mark.parametrize("name", ["self-consumption", "peak-shaving"])
def test_a_site_asks_for_no_energy_of_a_string_out_of_service(name: str) -> None:
    kpis = outcome(name, event=OUT, policy__name="soc", run__days=2.0).kpis
    assert kpis["undelivered_kwh"] < 0.01 * kpis["delivered_kwh"]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("fcr", {"demand__capacity_kw": 60.0}),
        ("peak-shaving", {"demand__limit_kw": 340.0}),
        ("self-consumption", {}),
    ],
)
def test_a_plant_of_which_a_string_is_out_is_a_plant_without_it(name: str, values: dict[str, float]) -> None:
    alike = {**values, "policy__name": "equal", "run__days": 2.0}
    out, without = (
        outcome(name, **alike, **more).dataset["delivered_kw"].values[:, 0]
        for more in ({"event": OUT}, {"system__n_strings": 1})
    )
    assert np.abs(without).max() > 5.0
    np.testing.assert_allclose(out, without, atol=0.05)  # the first estimate of efficiency has two weights


def test_a_price_of_capacity_every_90_min_is_refused(tmp_path: Path) -> None:
    times = pd.date_range("2024-01-01", periods=32, freq="90min", tz="UTC")
    pd.Series(50.0, times, name="price").rename_axis("time").to_csv(tmp_path / "capacity.csv")
    with pytest.raises(InputError, match="prices of capacity every 90 min; give whole hours"):
        read_capacity_prices(tmp_path / "capacity.csv")


def test_a_table_of_capacity_prices_is_that_of_its_parquet_and_of_its_times_without_a_zone(
    tmp_path: Path,
) -> None:
    times = pd.date_range("2024-01-01", periods=12, freq="4h", tz="UTC", name="time")
    prices = pd.DataFrame({"price": 40.0 + 4.0 * np.arange(12.0)}, times)
    prices.to_csv(tmp_path / "prices.csv")
    prices.to_parquet(tmp_path / "prices.parquet")
    prices.tz_localize(None).to_csv(tmp_path / "naive.csv")
    for name in ("prices.csv", "prices.parquet", "naive.csv"):
        values = {"demand.capacity_prices": str(tmp_path / name), "demand.time_zone": "UTC", "run.days": 1.0}
        earned = prepare(bess.load_study("fcr", values)).series["capacity_price_eur_mw_h"]
        np.testing.assert_array_equal(earned, np.repeat(10.0 + np.arange(6.0), 16))


def test_prices_of_energy_beside_a_reserve_may_have_times_without_a_zone(tmp_path: Path) -> None:
    times = pd.date_range("2024-01-01", periods=48, freq="h", name="time")
    pd.DataFrame({"price": 40.0 + np.arange(48.0)}, times).to_csv(tmp_path / "naive.csv")
    values = {
        "demand.prices": str(tmp_path / "naive.csv"),
        "run.days": 1.0,
        "run.start": "2024-01-01T00:00:00Z",
    }
    with pytest.raises(bess.InputError, match="zone"):
        prepare(bess.load_study("fcr", values))
    price = prepare(bess.load_study("fcr", values | {"demand.time_zone": "UTC"})).price_eur_mwh
    np.testing.assert_array_equal(price, np.repeat(40.0 + np.arange(24.0), 4))


def test_tender_results_without_the_regular_tender_are_refused(tmp_path: Path) -> None:
    (tmp_path / "tender.csv").write_text(
        "DATE_FROM;TENDER_NUMBER;PRODUCTNAME;GERMANY_SETTLEMENTCAPACITY_PRICE_[EUR/MW]\n"
        "01.01.2024;2;NEGPOS_00_04;12,5\n01.01.2024;2;NEGPOS_04_08;13,5\n"
    )
    with pytest.raises(InputError, match=r"line 2: .*repeated tenders only"):
        read_capacity_prices(tmp_path / "tender.csv")
    with pytest.raises(InputError, match="there is no price of '7'; give one of: GERMANY"):
        read_capacity_prices(tmp_path / "tender.csv", 7)  # type: ignore[arg-type]


def test_repairs_of_tender_results_are_noted(tmp_path: Path) -> None:
    blocks = [f"01.01.2024;{n};NEGPOS_{h:02d}_{h + 4:02d};12,5\n" for n in (1, 2) for h in range(0, 24, 4)]
    header = "DATE_FROM;TENDER_NUMBER;PRODUCTNAME;GERMANY_SETTLEMENTCAPACITY_PRICE_[EUR/MW]\n"
    (tmp_path / "tender.csv").write_text(header + "".join(blocks))
    values = {"demand.capacity_prices": str(tmp_path / "tender.csv"), "run.days": 0.5}
    inputs = prepare(bess.load_study("fcr", values | {"run.start": "2024-01-01T00:00:00Z"}))
    assert "repaired: left out rows of repeated tenders (6 rows)" in inputs.notes


# On measured files


@measured
def test_the_tender_results_of_2024_are_read_as_published() -> None:
    hourly = read_capacity_prices(PRICES)
    blocks = hourly.attrs["blocks"]
    assert blocks.size == 2196
    assert (blocks.min(), blocks.max()) == (17.20, 360.00)
    assert math.fsum(blocks) == pytest.approx(142_889.73, abs=0.005)
    assert hourly.sum() == pytest.approx(142_889.73, abs=0.005)
    assert hourly.size == 8784  # the blocks over the changes of the clock have three and five hours


@measured
def test_the_measured_frequency_comes_into_order_when_day_and_month_are_swapped_back() -> None:
    mhz = read_frequency(FREQUENCY, time_zone="UTC")
    assert mhz.size == 267_840
    assert str(mhz.index[0]), str(mhz.index[-1]) == ("2019-05-01 00:00:00+00:00", "2019-05-31 23:59:50+00:00")
    assert (mhz.min(), round(mhz.mean(), 2), mhz.max()) == (-110.5, 0.3, 129.5)
    assert mhz.attrs["repairs"].rows("day-month") == 12 * 8640


@pytest.fixture(scope="module")
def may() -> bess.Result:
    return outcome(
        "fcr",
        demand__frequency=str(FREQUENCY),
        demand__time_zone="UTC",
        demand__repeat=True,
        demand__capacity_prices=str(PRICES),
        demand__capacity_kw=140.0,
        run__start=pd.Timestamp("2023-12-31T23:00Z").to_pydatetime(),
        run__days=31.0,
        policy__name="soc",
    )


@measured
def test_soc_never_leaves_the_window_of_the_15_min_rule(may: bess.Result) -> None:
    data = may.dataset
    assert may.kpis["outside_window_h"] == 0.0
    assert may.kpis["penalty_eur"] == 0.0
    assert (data["soc"] > data["soc_low"]).all()
    assert (data["soc"] < data["soc_high"]).all()
    assert data["soc"].min() < 0.45  # it does move
    assert may.kpis["fulfilment_pct"] == pytest.approx(100.0, abs=1e-6)


@measured
def test_income_of_a_day_is_its_six_blocks_to_the_cent(may: bess.Result) -> None:
    """1 January 2024 in Germany, in EUR/MW: as printed in the tender results, times 0.14 MW."""
    day = bess.ledger(may)["capacity_revenue_eur"].values[:96]
    by_hand = 0.14 * (114.80 + 104.40 + 68.80 + 77.60 + 72.40 + 79.96)
    assert day.sum() == pytest.approx(by_hand, abs=0.005)


@measured
def test_c_rates_resemble_those_of_a_year_of_such_a_store(may: bess.Result) -> None:
    """The trace is of a store of another make and another year, with as many MW as MWh, charge positive."""
    trace = pd.read_parquet(DATA / "bess" / "fcr_crate_from_blast_15min_1y.parquet")
    theirs = np.abs(trace["c_rate_charge_pos_per_h"].dropna().to_numpy())
    ours = np.abs(may.dataset["delivered_kw"].values.sum(axis=1)) / 140.0
    for share in (0.5, 0.9, 0.99):
        assert np.quantile(ours, share) == pytest.approx(np.quantile(theirs, share), rel=0.35)


# Behind a meter: as good as a linear program that knows all that comes


def least_import_kwh(net_kw: np.ndarray, power_kw: float, capacity_kwh: float, stored_kwh: float) -> float:
    """Plain program: charge c, discharge d, import g; e = e0 + sum(c - d) dt within [0, size]."""
    n, dt_h = net_kw.size, 0.25
    below = np.tril(np.ones((n, n))) * dt_h
    zero, unit = np.zeros((n, n)), np.eye(n)
    rows = np.block([[below, -below, zero], [-below, below, zero], [unit, -unit, -unit]])
    most = np.concatenate([np.full(n, capacity_kwh - stored_kwh), np.full(n, stored_kwh), -net_kw])
    cost = np.concatenate([np.zeros(2 * n), np.full(n, dt_h)])
    bounds = [(0.0, power_kw)] * (2 * n) + [(0.0, None)] * n
    return float(linprog(cost, rows, most, bounds=bounds).fun)


def site(result: bess.Result) -> tuple[np.ndarray, np.ndarray, float]:
    data = result.dataset
    net = (data["load_kw"] - data["generation_kw"]).values
    draw = net - data["delivered_kw"].values.sum(axis=1)
    # 2 strings of 192 x 4 cells of 94 Ah at 3.7 V
    return net, draw, 2 * 192 * 4 * 94.0 * 3.7 / 1000.0


def test_self_consumption_draws_as_little_as_perfect_foresight_could() -> None:
    result = outcome("self-consumption", **LOSSLESS)
    net, draw, capacity_kwh = site(result)
    least = least_import_kwh(net, 184.0, capacity_kwh, 0.5 * capacity_kwh)
    assert result.kpis["import_kwh"] == pytest.approx(np.maximum(draw, 0.0).sum() * 0.25, rel=1e-12)
    assert least > 300.0
    assert result.kpis["import_kwh"] == pytest.approx(least, rel=0.01)


def test_peak_shaving_keeps_the_peak_that_perfect_foresight_could() -> None:
    study = bess.load_study("peak-shaving", LOSSLESS)
    document = study.model_dump(exclude_unset=True, exclude_none=True)
    del document["demand"]["limit_kw"]
    result = bess.run(bess.Study.from_document(document, "lossless"), progress=False)
    net, draw, capacity_kwh = site(result)
    n = net.size
    below = np.tril(np.ones((n, n))) * 0.25
    rows = np.block(
        [
            [below, -below, np.zeros((n, 1))],
            [-below, below, np.zeros((n, 1))],
            [np.eye(n), -np.eye(n), -np.ones((n, 1))],
        ]
    )
    most = np.concatenate([np.full(n, 0.5 * capacity_kwh), np.full(n, 0.5 * capacity_kwh), -net])
    bounds = [(0.0, 184.0)] * (2 * n) + [(0.0, None)]
    least = float(linprog(np.r_[np.zeros(2 * n), 1.0], rows, most, bounds=bounds).fun)
    assert least < 0.7 * net.max()
    assert draw.max() == pytest.approx(least, rel=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_the_default_limit_of_a_peak_is_kept_by_a_plant_with_losses(seed: int, tmp_path: Path) -> None:
    """With the given losses alone the plant became empty within the peak, which was up to twice the limit."""
    rng = np.random.default_rng(seed)
    quarter = np.arange(192)
    day = 80.0 + 60.0 * np.clip(np.sin(quarter * 2.0 * np.pi / 96.0 + rng.uniform(0.0, 6.0)), -0.5, 1.0)
    evening = 150.0 * (seed % 2) * (quarter % 96 > 88)
    index = pd.date_range("2024-03-04", periods=quarter.size, freq="15min", tz="UTC", name="time")
    load = pd.DataFrame({"kw": np.abs(day + evening + rng.normal(0.0, 10.0, quarter.size))}, index)
    load.to_csv(tmp_path / "load.csv")
    demand = {"kind": "peak-shaving", "load": str(tmp_path / "load.csv")}
    document = {"name": "peak", "system": {}, "demand": demand, "run": {"days": 2.0}}
    result = bess.run(bess.Study.from_document(document, "peak"), progress=False)
    limit_kw = float(result.dataset.grid_limit_kw[0])
    assert limit_kw < 0.85 * load["kw"].max()
    assert result.kpis["peak_draw_kw"] <= limit_kw * (1.0 + 1e-6)


def test_whatever_round_trip_is_assumed_plans_behind_a_meter_lose_the_same_and_less_than_equal() -> None:
    """With 0.85 they wasted energy to make room for charging that never came: 205 kWh lost, `equal` 195.

    Inverters and batteries lose the same within 0.4 %. What is not delivered depends on the target of peak
    shaving, which depends on the setting: 9.6 kWh at 0.85, less than 1 kWh at the others.
    """
    settings = (0.85, 0.9, 0.94)
    for service, spread in (("peak-shaving", 0.07), ("self-consumption", 0.02)):
        mpc, equal = (
            [outcome(service, policy__name=policy, demand__efficiency=setting).kpis for setting in settings]
            for policy in ("mpc", "equal")
        )
        lost = [kpis["lost_kwh"] for kpis in mpc]
        losses = [kpis["lost_kwh"] - kpis["undelivered_kwh"] for kpis in mpc]
        assert max(losses) < 1.01 * min(losses)
        assert all(kpis["undelivered_kwh"] < 3e-3 * kpis["demand_kwh"] for kpis in mpc)
        assert max(lost) < (1.0 + spread) * min(lost)
        assert max(lost) < 0.85 * min(kpis["lost_kwh"] for kpis in equal)


def test_the_least_peak_by_hand() -> None:
    """40 kWh and 30 kW shave the hour of 100 kW to 70 kW for power, two of them to 80 kW for energy."""
    numbers = {"power_kw": 30.0, "capacity_kwh": 40.0, "stored_kwh": 40.0, "one_way_efficiency": 1.0}
    assert min_peak_kw(np.array([50.0, 100.0, 50.0]), 1.0, **numbers) == pytest.approx(70.0)
    assert min_peak_kw(np.array([50.0, 100.0, 100.0]), 1.0, **numbers) == pytest.approx(80.0)
    assert min_peak_kw(
        np.array([100.0, 100.0]), 1.0, **(numbers | {"one_way_efficiency": 0.5})
    ) == pytest.approx(90.0)


def test_a_store_that_begins_above_its_capacity_holds_the_least_peak_as_well() -> None:
    numbers = {"power_kw": 100.0, "capacity_kwh": 40.0, "one_way_efficiency": 1.0}
    net_kw = np.array([100.0, 0.0, 100.0])
    limit_kw = min_peak_kw(net_kw, 1.0, stored_kwh=80.0, **numbers)  # in the last hour it holds 40 kWh
    rule = GridPowerTarget(target_kw=limit_kw, dt_h=1.0, **numbers)
    assert (net_kw - rule.demand_kw(net_kw, 80.0) <= limit_kw + 1e-6).all()


def test_a_store_asks_for_no_more_than_it_holds_or_has_room_for() -> None:
    target = GridPowerTarget(
        target_kw=0.0, power_kw=50.0, capacity_kwh=100.0, one_way_efficiency=0.5, dt_h=1.0
    )
    np.testing.assert_allclose(target.demand_kw(np.array([60.0, 60.0, 60.0]), 120.0), [50.0, 10.0, 0.0])
    np.testing.assert_allclose(target.demand_kw(np.array([-60.0, -60.0, -9.0]), 70.0), [-50.0, -10.0, 0.0])


def test_the_last_bit_of_a_store_is_left_where_inverters_would_lose_more() -> None:
    target = GridPowerTarget(
        target_kw=0.0, power_kw=50.0, capacity_kwh=100.0, one_way_efficiency=1.0, dt_h=1.0, min_power_kw=4.0
    )
    np.testing.assert_allclose(target.demand_kw(np.array([-60.0, 60.0, 60.0]), 97.0), [0.0, 50.0, 47.0])
    np.testing.assert_allclose(target.demand_kw(np.array([2.0, -3.0]), 50.0), [2.0, -3.0])


def test_the_saving_of_a_site_is_the_difference_of_its_bills() -> None:
    result = outcome("self-consumption", policy__name="equal", run__days=2.0)
    net, draw, _ = site(result)
    bill = [np.where(kw > 0.0, 250.0 * kw, 80.0 * kw).sum() * 0.25 / 1000.0 for kw in (net, draw)]
    ledger = bess.ledger(result)
    saved = ledger["discharge_revenue_eur"].sum() - ledger["charge_cost_eur"].sum()
    assert float(saved) == pytest.approx(bill[0] - bill[1], rel=1e-9)


def test_a_lower_peak_saves_its_share_of_the_demand_charge() -> None:
    result = outcome("peak-shaving", policy__name="equal")
    spared = result.kpis["peak_before_kw"] - result.kpis["peak_draw_kw"]
    assert result.kpis["capacity_revenue_eur"] == pytest.approx(spared * 100.0 * 7.0 / 365.0)


# All kinds


@pytest.mark.parametrize("name", ["fcr", "fcr-arbitrage", "peak-shaving", "self-consumption"])
def test_a_run_that_is_continued_gives_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = bess.load_study(name, {"policy.name": "soc", "run.days": 1.0})
    whole = bess.run(study, progress=False).dataset
    resumed = continued(study, tmp_path / "run", monkeypatch)
    for variable in whole:
        np.testing.assert_array_equal(resumed[variable], whole[variable], err_msg=str(variable))


def test_trade_stays_within_what_the_reserve_leaves() -> None:
    result = outcome("fcr-arbitrage", policy__name="soc", run__days=3.0)
    data = result.dataset
    assert result.kpis["outside_window_h"] == 0.0
    assert float(np.abs(data["schedule_kw"]).max()) <= 184.0 - 92.0 + 1e-9
    assert result.kpis["discharge_revenue_eur"] > result.kpis["charge_cost_eur"]


@pytest.mark.parametrize(
    "reserve",
    [
        {"demand__capacity_kw": 92.0},
        {"demand__capacity_kw": 60.0},
        {
            "demand__choose_capacity": "perfect",
            "demand__capacity_price_eur_mw": 24.0,
            "demand__capacity_kw": 83.7,
            "demand__recharge_kw": 11.3,
        },
    ],
)
def test_reserve_and_trade_fit_into_the_strings_in_service(reserve: dict[str, object]) -> None:
    """In two days with one of two strings, up to 830 kWh were undelivered."""
    kpis = outcome("fcr-arbitrage", event=OUT, policy__name="soc", run__days=3.0, **reserve).kpis
    assert kpis["undelivered_kwh"] == 0.0
    assert kpis["discharge_revenue_eur"] > kpis["charge_cost_eur"]


def test_trade_stays_within_the_energy_band_of_a_capacity_that_has_decreased() -> None:
    """The band was that of the initial capacity."""
    inputs = prepare(bess.load_study("fcr-arbitrage", {"run.days": 1.0}))
    source, state = inputs.demand, inputs.system.initial_state()
    aged = bess.State(state.soc, state.temperature_c, 0.6 * state.soh_capacity)
    source.ahead(0, 96, StepInputs(aged, inputs.limit_kw[0], inputs.ambient_c))
    row = source.planned(0)
    stored_kwh = 0.25 * np.cumsum(np.append(0.0, source._plan))  # without losses, which narrow it further
    usable_kwh = (row["soc_high"] - row["soc_low"]) * 0.6 * inputs.system.nominal_energy_kwh.sum()
    assert 0.0 < np.ptp(stored_kwh) <= usable_kwh


def test_a_service_names_bundled_files_only_if_there_are_such() -> None:
    with pytest.raises(InputError, match=r"demand\.load = 'industrial-weak'.*did you mean 'industrial-week'"):
        outcome("peak-shaving", demand__load="industrial-weak")
    with pytest.raises(InputError, match=r"demand\.frequency = 'synthetik'.*did you mean 'synthetic'"):
        outcome("fcr", demand__frequency="synthetik")


def test_the_bundled_profile_of_48_h_is_no_load() -> None:
    assert bundled_profile("two-cycle-48h").size == 192
    with pytest.raises(InputError, match="no bundled item has this name"):
        outcome("peak-shaving", demand__load="two-cycle-48h")


def test_a_report_shows_what_a_service_asked_and_whether_it_was_kept() -> None:
    site_result = outcome("peak-shaving", policy__name="equal", run__days=1.0)
    panels = operation.service(site_result).panels
    drawn = {entry.label: entry.y for panel in panels for entry in panel.series}
    _, draw, _ = site(site_result)
    np.testing.assert_allclose(drawn["drawn from the grid"][:-1], draw)
    assert set(drawn) == {"load", "drawn from the grid", "limit", "delivered", "mean over the strings"}
    reserve = operation.service(outcome("fcr", policy__name="equal", run__days=1.0)).panels
    assert [panel.y_label for panel in reserve] == ["Frequency (mHz from nominal)", "Plant (kW)", "SOC"]
    with pytest.raises(InputError, match="not of a service"):
        operation.service(outcome("case1", policy__name="equal", run__days=0.5))
