"""Claims about series that go on after the end of their file."""

from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest

from bess.market import extended, over_years


def stamped(first: str, last: str) -> pd.Series:
    """Hours whose value is their own date and hour."""
    index = pd.date_range(first, last, freq="h", inclusive="left", tz="UTC")
    return pd.Series(index.strftime("%m%d%H").astype(float).to_numpy(), index=index)


@pytest.mark.parametrize("first", ["2023-01-01", "2024-01-01", "2023-07-01", "2024-03-01", "2022-11-15"])
def test_a_year_follows_on_the_same_days_of_the_calendar(first: str) -> None:
    start = pd.Timestamp(first)
    series = stamped(first, str(start + pd.DateOffset(years=1)))
    longer = extended(series, datetime(2031, 5, 17, tzinfo=UTC))
    assert longer.index.equals(pd.date_range(first, "2031-05-17", freq="h", inclusive="left", tz="UTC"))
    own = stamped(first, "2031-05-17")
    leap_day = (own.index.month == 2) & (own.index.day == 29) & (own.index.year > series.index[-1].year)
    np.testing.assert_array_equal(longer[~leap_day], own[~leap_day])
    had_one = bool(((series.index.month == 2) & (series.index.day == 29)).any())
    wanted = own[leap_day] - (0.0 if had_one else 100.0)
    np.testing.assert_array_equal(longer[leap_day], wanted)


def test_of_several_years_the_last_one_follows() -> None:
    series = pd.Series(np.arange(2 * 8760.0), pd.date_range("2022-01-01", periods=17520, freq="h", tz="UTC"))
    longer = extended(series, datetime(2026, 1, 1, tzinfo=UTC))
    np.testing.assert_array_equal(longer.to_numpy()[-8760:], np.arange(8760.0, 17520.0))


def test_less_than_a_year_follows_in_whole_days() -> None:
    series = stamped("2024-01-01", "2024-01-04 06:00")
    longer = extended(series, datetime(2024, 1, 9, tzinfo=UTC))
    assert longer.index[-1] == pd.Timestamp("2024-01-08 23:00", tz="UTC")
    later = longer["2024-01-04 06:00":"2024-01-05 23:00"]  # type: ignore[misc]
    assert (later.to_numpy() % 100 == later.index.hour.to_numpy()).all()
    assert longer["2024-01-05 00:00"] == 10200


def test_a_series_that_is_long_enough_stays_as_it_is() -> None:
    series = stamped("2024-01-01", "2024-02-01")
    assert extended(series, datetime(2024, 1, 20, tzinfo=UTC)) is series


def test_a_typical_year_with_a_29_february_keeps_it() -> None:
    series = stamped("2024-01-01", "2025-01-01")
    laid = over_years(series, datetime(2023, 1, 1, tzinfo=UTC), datetime(2029, 1, 1, tzinfo=UTC))
    np.testing.assert_array_equal(laid, stamped("2023-01-01", "2029-01-01 02:00"))
