from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bess.dispatch import PROFILES, bundled_profile, read_profile
from bess.errors import InputError

DATA = Path(__file__).parents[3] / "shared" / "data"
TIMES = pd.date_range("2024-03-31", periods=16, freq="15min", tz="UTC")
POWER = pd.DataFrame({"power": np.arange(16.0) - 8.0, "other": 1.0}, index=TIMES)


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "demand.csv"
    POWER.to_csv(path, index_label="time")
    return path


def test_the_bundled_profile_is_two_days_of_two_cycles():
    power = bundled_profile("two-cycle-48h")
    assert power.shape == (192,)
    assert np.array_equal(power[:96], power[96:])
    assert set(power) == {-78.0, -30.0, 0.0, 30.0, 78.0}
    assert power[:14].tolist() == [-78.0] * 10 + [-30.0] * 2 + [0.0] * 2
    assert power[:96].clip(min=0).sum() * 0.25 == pytest.approx(2 * (4.75 * 78 + 0.75 * 30))
    assert -power[:96].clip(max=0).sum() * 0.25 == pytest.approx(9.5 * 78 + 1.25 * 30)


@pytest.mark.parametrize("name", PROFILES)
def test_bundled_profiles_are_whole_watts_as_processors_disagree_in_the_last_bit(name):
    power_kw = bundled_profile(name)
    assert np.array_equal(power_kw, np.round(power_kw, 3))


def test_the_bundled_profile_scales_and_refines():
    fine = bundled_profile("two-cycle-48h", hi_kw=100.0, lo_kw=10.0, dt_h=1 / 12)
    assert fine.size == 576
    assert set(fine) == {-100.0, -10.0, 0.0, 10.0, 100.0}
    assert np.array_equal(fine[::3], bundled_profile("two-cycle-48h", hi_kw=100.0, lo_kw=10.0))


def test_a_profile_is_read_with_unit_sign_and_scale(table):
    series = read_profile(table, column="power", unit="MW", positive="charge", scale=0.5)
    assert series.name == "demand_kw"
    assert series.attrs["units"] == "kW"
    assert str(series.index.tz) == "UTC"
    np.testing.assert_allclose(series, -500.0 * POWER["power"])


def test_finer_values_are_averaged_and_coarser_ones_held(table):
    hourly = read_profile(table, column="power", dt_h=1.0)
    np.testing.assert_allclose(hourly, POWER["power"].to_numpy().reshape(4, 4).mean(axis=1))
    assert hourly.index[1] == TIMES[4]
    fine = read_profile(table, column="power", dt_h=1 / 12)
    np.testing.assert_allclose(fine, POWER["power"].to_numpy().repeat(3))
    assert fine.index[4] == TIMES[1] + pd.Timedelta(minutes=5)


@pytest.mark.parametrize(("file_min", "control_min"), [(10, 15), (15, 10)])
def test_steps_that_do_not_fit_are_named_in_minutes(file_min, control_min, tmp_path):
    times = pd.date_range("2024-01-01", periods=16, freq=f"{file_min}min", tz="UTC")
    pd.DataFrame({"power": 1.0}, times).to_csv(tmp_path / "demand.csv", index_label="time")
    words = rf"its step of {file_min} min is neither a fraction nor a multiple of .* of {control_min} min"
    with pytest.raises(InputError, match=words):
        read_profile(tmp_path / "demand.csv", dt_h=control_min / 60)


def test_energy_is_kept_by_resampling(table):
    for dt_h in (1 / 12, 0.25, 0.5, 1.0, 2.0):
        assert read_profile(table, column="power", dt_h=dt_h).sum() * dt_h == pytest.approx(
            POWER["power"].sum() / 4
        )


def test_parquet_with_a_clock_is_read(tmp_path):
    path = tmp_path / "demand.parquet"
    POWER.tz_localize(None).to_parquet(path)
    series = read_profile(path, column="power", time_zone="UTC+1")
    assert series.index[0] == TIMES[0] - pd.Timedelta(hours=1)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({}, "power is not clear; give one of: power, other"),
        ({"column": "P"}, "no column 'P'; give one of: power, other"),
        ({"column": "power", "unit": "GW"}, "unit 'GW' is unknown; allowed are W, kW, MW"),
        ({"column": "power", "positive": "up"}, "positive 'up' is unknown; allowed are discharge, charge"),
        ({"column": "power", "scale": 0.0}, "scale 0.0 must be finite and above 0"),
        ({"column": "power", "dt_h": 0.4}, "neither a fraction nor a multiple of"),
        ({"column": "power", "dt_h": 8.0}, "4 h is less than one step of 8 h"),
    ],
)
def test_bad_input_is_refused(table, arguments, match):
    with pytest.raises(InputError, match=match):
        read_profile(table, **arguments)


def test_an_unknown_bundled_profile_and_a_negative_level_are_refused():
    with pytest.raises(InputError, match="'week' is not bundled; there are frequency-week, "):
        bundled_profile("week")
    with pytest.raises(InputError, match=r"hi_kw -1\.0 kW must be finite and >= 0 kW"):
        bundled_profile("two-cycle-48h", hi_kw=-1.0)


@pytest.mark.skipif(not DATA.is_dir(), reason="real data are not beside the repository (../shared/data)")
def test_the_measured_day_of_a_plant_is_read_as_demand():
    series = read_profile(DATA / "bess" / "m5bat_2023-04-07_15min.parquet", column="M5BAT_P", time_zone="UTC")
    assert len(series) == 96
    assert (round(series.min()), round(series.max())) == (-785, 885)


SYNTHETIC = ("frequency-week", "peak-shaving-week", "market-week")


@pytest.mark.parametrize("name", SYNTHETIC)
def test_a_synthetic_week_stays_within_the_pair_of_strings_it_is_made_for(name):
    power = bundled_profile(name)
    assert power.size == 7 * 96
    assert np.abs(power).max() <= 184.0
    assert power.min() < 0.0 < power.max()
    charged, discharged = -power.clip(max=0.0).sum(), power.clip(min=0.0).sum()
    assert 1.04 < charged / discharged < 1.2  # what is charged makes up for losses, and little more
    assert np.array_equal(bundled_profile(name, dt_h=1 / 12)[::3], power)


def test_synthetic_weeks_are_repeatable_and_have_a_seed():
    for name in SYNTHETIC:
        assert np.array_equal(bundled_profile(name), bundled_profile(name))
        assert not np.array_equal(bundled_profile(name), bundled_profile(name, seed=9))


def test_peak_shaving_rests_at_weekends_and_frequency_control_never_for_long():
    assert not bundled_profile("peak-shaving-week")[-96 - 64 :].any()
    idle = bundled_profile("frequency-week") == 0.0
    assert 0.02 < idle.mean() < 0.3
    assert set(PROFILES) == {"two-cycle-48h", "two-cycle-fitted-48h", *SYNTHETIC}
