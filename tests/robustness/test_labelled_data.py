"""Claim: times of labelled data (pandas, xarray) count wherever one value for each step is given."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bess

SYSTEM = bess.System.reference(2)
STATE = SYSTEM.initial_state()
QUARTERS = pd.date_range("2024-01-01", periods=2, freq="15min")
HOURS = pd.date_range("2024-01-01", periods=2, freq="h")


def _first(rows: Any) -> Any:
    return rows.iloc[0] if isinstance(rows, pd.DataFrame) else rows[0]


CALLS: dict[str, Callable[[Any], Any]] = {
    "demand_kw of a split": lambda rows: bess.split_power(SYSTEM, STATE, _first(rows)),
    "demand_kw of a plan": lambda rows: bess.plan_power(SYSTEM, STATE, _first(rows)),
    "ambient_c of a split": lambda rows: bess.split_power(
        SYSTEM, STATE, [50.0, 50.0], ambient_c=_first(rows)
    ),
    "ambient_c of a roll-out": lambda rows: bess.rollout(
        SYSTEM, STATE, np.ones((2, 2)), ambient_c=_first(rows)
    ),
    "ambient_c of a dispatch": lambda rows: bess.plan_dispatch(
        SYSTEM, [20.0, 80.0], STATE, hours=0.5, ambient_c=_first(rows)
    ),
    "limit_kw": lambda rows: bess.split_power(SYSTEM, STATE, [50.0, 50.0], limit_kw=rows),
    "request_kw of a roll-out": lambda rows: bess.rollout(SYSTEM, STATE, rows),
    "request_kw of a plant": lambda rows: bess.Plant(SYSTEM, STATE).run(rows.T),
    "ambient_c of a plant": lambda rows: bess.Plant(SYSTEM, STATE).run(
        np.ones((2, 2)), ambient_c=_first(rows)
    ),
    "reactive_kvar": lambda rows: bess.Plant(SYSTEM, STATE).run(np.ones((2, 2)), reactive_kvar=rows.T),
}


def _table(times: Any) -> pd.DataFrame:
    return pd.DataFrame(np.full((2, 2), 20.0), columns=times)


def _array(times: pd.DatetimeIndex) -> xr.DataArray:
    return xr.DataArray(np.full((2, 2), 20.0), {"time": times}, ("string", "time"))


@pytest.mark.parametrize("name", CALLS)
def test_hours_are_not_taken_for_quarter_hours(name):
    """Hourly data was taken for quarter hours, but for a pandas series of demand."""
    call, plain = CALLS[name], CALLS[name](np.full((2, 2), 20.0))
    assert call(_table(QUARTERS)) == call(_array(QUARTERS)) == call(_table([0, 1])) == plain
    for hours in (_table(HOURS), _array(HOURS), _table(HOURS.to_period()), _table(HOURS - HOURS[0])):
        with pytest.raises(bess.InputError, match=r"times are 1 h apart, but a step \(.*\) lasts 0.25 h"):
            call(hours)
    with pytest.raises(bess.InputError, match="labels such as '2024-01-01 00:00' are no times; see pandas"):
        call(_table(HOURS.strftime("%Y-%m-%d %H:%M")))


def test_times_along_the_axis_of_strings_are_refused():
    """Records are (time, string), roll-outs (string, time): as many steps as strings fit either way."""
    for rows in (_table(QUARTERS), _array(QUARTERS)):
        with pytest.raises(bess.InputError, match="request_kw: times are along the wrong axis; transpose"):
            bess.rollout(SYSTEM, STATE, rows.T)
        with pytest.raises(bess.InputError, match="request_kw: times are along the wrong axis; transpose"):
            bess.Plant(SYSTEM, STATE).run(rows)


def test_hourly_prices_are_hourly_in_any_labelled_form():
    """An array of xarray, periods and texts were taken for quarter hours: a quarter of the income."""
    prices, times = np.tile([20.0, 90.0], 12), pd.date_range("2024-01-01", periods=24, freq="h")
    series = pd.Series(prices, times)
    hourly = bess.store_value(prices, dt_h=1.0)
    for given in (series, series.to_xarray(), series.to_period(), series.set_axis(times - times[0])):
        assert bess.store_value(given) == hourly
    with pytest.raises(bess.InputError, match="prices: labels such as '2024-01-01 00:00:00' are no times"):
        bess.store_value(series.set_axis(times.astype(str)))


def test_the_length_of_a_step_is_any_number():
    """A split refused what a roll-out took."""
    for function in (bess.split_power, bess.plan_power):
        assert function(SYSTEM, STATE, [50.0], dt_h=np.array(0.25)) == function(SYSTEM, STATE, [50.0])
    for dt_h in (0.0, -0.25, 24.5):
        for call in (
            lambda: bess.split_power(SYSTEM, STATE, [50.0], dt_h=dt_h),  # noqa: B023
            lambda: bess.rollout(SYSTEM, STATE, [[50.0], [0.0]], dt_h=dt_h),  # noqa: B023
        ):
            with pytest.raises(bess.InputError, match=rf"dt_h {dt_h:g} h must be a number in \(0, 24\] h"):
                call()
