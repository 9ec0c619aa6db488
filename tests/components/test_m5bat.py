"""Claims about the measured plant M5BAT: the loss line, and what policies make of a day."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import bess
from m5bat_day import m5bat, replayed
from once import Once

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"
pytestmark = [
    pytest.mark.golden,
    pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured day is not at {DATA}"),
]


def test_the_bundled_loss_line_meets_the_measured_medians_without_reactive_power() -> None:
    samples = pd.read_parquet(DATA / "inverter/m5bat_inverter_steady_samples.parquet")
    table = m5bat.steady_table(samples).loc["no Q"]
    error = (table.line_kw - table.measured_kw).abs()
    assert len(table) >= 9
    assert error[table.power_kw.abs() < 150.0].max() < 0.35
    assert error.max() < 1.5, "the data hold medians to 1.5 kW"


def test_the_plant_loses_what_was_measured_with_reactive_power_alone() -> None:
    samples = pd.read_parquet(DATA / "inverter/m5bat_inverter_steady_samples.parquet")
    alone = samples[(samples.q_kvar.abs() > 200.0) & (samples.pac_kW.abs() < 20.0)]
    system = bess.load_system("m5bat")
    reactive_kvar = np.full(system.n_strings, alone.q_kvar.median())
    flows = bess.Plant(system, system.initial_state()).step(
        np.zeros(system.n_strings), reactive_kvar=reactive_kvar
    )
    np.testing.assert_allclose(flows.inverter_loss_kw, alone.loss_kW.median(), atol=0.3)


def test_a_line_over_apparent_power_reads_the_losses_that_one_over_active_power_misses() -> None:
    samples = pd.read_parquet(DATA / "inverter/m5bat_inverter_steady_samples.parquet")
    second = pd.read_parquet(DATA / "bess/m5bat_bess_battery_together_sample.parquet")
    table = m5bat.loss_readings(samples, second)
    active, apparent = table.loc["line over active power"], table.loc["line over apparent power"]
    for kind in ("without Q", "with Q"):
        assert abs(apparent[f"mean error {kind}, kW"]) < 0.1 < 1.0 < abs(active[f"mean error {kind}, kW"])
        assert apparent[f"mean absolute error {kind}, kW"] < 0.4 * active[f"mean absolute error {kind}, kW"]
    for unit in ("batt1, kWh", "batt10, kWh"):
        measured = table.loc["measured", unit]
        assert abs(apparent[unit] - measured) < 0.6 * abs(active[unit] - measured)


def test_losses_of_both_measured_units_over_the_day_agree_with_the_line() -> None:
    second = pd.read_parquet(DATA / "bess/m5bat_bess_battery_together_sample.parquet")
    for unit in ("batt1", "batt10"):
        day = m5bat.unit_day(second, unit)
        assert day["line_loss_kwh"] == pytest.approx(day["measured_loss_kwh"], rel=0.02)


def test_the_bundled_table_is_the_fit_and_holds_where_it_was_not_fitted() -> None:
    second = pd.read_parquet(DATA / "bess/m5bat_bess_battery_together_sample.parquet")
    samples = pd.read_parquet(DATA / "inverter/m5bat_inverter_steady_samples.parquet")
    fit = m5bat.loss_fit(second, samples)
    inverter = bess.load_system("m5bat").strings[9].inverter
    table_kw = inverter.nominal_kw * np.array(inverter.loss_discharge)
    np.testing.assert_allclose(table_kw, [fit[name] for name in list(fit)[:3]], atol=0.01)
    errors = {name: value for name, value in fit.items() if name.endswith("%")}
    assert len(errors) == 5
    assert max(map(abs, errors.values())) < 4.0, errors


def test_the_day_is_delivered_by_an_equal_split_and_fewer_units_lose_less_in_inverters(once: Once) -> None:
    demand_kw = pd.read_parquet(DATA / "bess/m5bat_2023-04-07_15min.parquet").M5BAT_P.to_numpy(np.float64)
    equal, priority = (replayed(once, name, demand_kw) for name in ("equal", "priority"))
    np.testing.assert_allclose(equal.delivered_kw.sum(axis=1), demand_kw, atol=1e-6)
    assert priority.units_on.mean() < 2.0 < equal.units_on.mean()
    assert priority.inverter_loss_kw.sum() < 0.3 * equal.inverter_loss_kw.sum()
    missing_kw = np.abs(priority.request_kw) - np.abs(priority.delivered_kw)
    np.testing.assert_allclose(priority.derating_loss_kw, missing_kw, atol=1e-6)
    assert missing_kw[:, 1:].max() < 1e-6 < missing_kw[:, 0].max(), "unit 1 alone is too hot"


def test_the_optimiser_delivers_the_day_at_a_third_of_the_loss_of_an_equal_split(once: Once) -> None:
    demand_kw = pd.read_parquet(DATA / "bess/m5bat_2023-04-07_15min.parquet").M5BAT_P.to_numpy(np.float64)
    equal, mpc = (replayed(once, name, demand_kw) for name in ("equal", "mpc"))
    np.testing.assert_allclose(mpc.delivered_kw.sum(axis=1), demand_kw, atol=1e-6)
    assert mpc.fallbacks == 0
    assert 3 <= mpc.units_on.max() <= 4, "losses rise steeply above 252 kVA"
    losses = [(r.inverter_loss_kw + r.battery_loss_kw).sum() for r in (mpc, equal)]
    assert losses[0] < losses[1] / 3.0
