import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bess.dispatch import Forecast, PerfectForecast, PersistenceForecast
from bess.errors import InputError

SERIES = np.arange(400.0)


def test_a_perfect_forecast_is_the_series():
    assert PerfectForecast(SERIES).ahead(10, 5).tolist() == [10, 11, 12, 13, 14]
    assert PerfectForecast(SERIES).ahead(398, 5).tolist() == [398, 399]


def test_persistence_is_yesterday_at_the_same_time_but_now_is_known():
    ahead = PersistenceForecast(SERIES, dt_h=0.25).ahead(200, 100)
    assert ahead[0] == 200.0
    assert np.array_equal(ahead[1:97], SERIES[105:201])
    assert np.array_equal(ahead[97:], SERIES[105:108])


def test_persistence_holds_the_present_value_before_there_is_a_yesterday():
    """At step 3 of hours, steps 4 to 23 have no yesterday; 24 to 27 have, and are those of steps 0 to 3."""
    ahead = PersistenceForecast(SERIES, dt_h=1.0).ahead(3, 30)
    assert ahead[:21].tolist() == [3.0] * 21
    assert ahead[21:25].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert ahead[25:].tolist() == [3.0] * 5


@given(st.integers(0, 399), st.integers(1, 300), st.sampled_from([0.25, 0.5, 1.0]))
def test_persistence_never_looks_ahead(step, horizon, dt_h):
    changed = SERIES.copy()
    changed[step + 1 :] = -1.0
    expected = PersistenceForecast(SERIES, dt_h).ahead(step, horizon)
    assert np.array_equal(PersistenceForecast(changed, dt_h).ahead(step, horizon), expected)
    assert expected.size == min(horizon, SERIES.size - step)


def test_any_object_with_the_forecast_protocol_is_accepted():
    class Flat:
        def ahead(self, step: int, horizon: int) -> np.ndarray:
            return np.zeros(horizon)

    assert all(
        isinstance(f, Forecast) for f in (Flat(), PerfectForecast(SERIES), PersistenceForecast(SERIES))
    )


def test_a_forecast_cannot_be_changed_from_outside():
    values = np.ones(3)
    forecast = PerfectForecast(values)
    values[0] = 5.0
    forecast.ahead(0, 3)[0] = 7.0
    assert forecast.ahead(0, 3).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: PerfectForecast([]), "at least one value"),
        (lambda: PerfectForecast([1.0, np.nan]), "at index 1 is nan"),
        (lambda: PerfectForecast([1.0]).ahead(1, 1), r"step 1 is outside the series of 1 steps \[0, 0\]"),
        (lambda: PerfectForecast([1.0]).ahead(0, 0), "horizon 0 steps must be at least 1"),
        (lambda: PerfectForecast([1.0]).ahead(0, -4), "horizon -4 steps"),
        (lambda: PersistenceForecast([1.0], dt_h=0.7), "must be a whole number of steps of"),
    ],
)
def test_bad_input_is_refused(make, match):
    with pytest.raises(InputError, match=match):
        make()
