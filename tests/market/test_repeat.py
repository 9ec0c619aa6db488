"""Claims about series that go on after the end of their file."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pandas as pd
import pytest

import bess
from bess.market import extended, over_years

END = datetime(2024, 1, 9, tzinfo=UTC)


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


@pytest.mark.parametrize(
    ("change", "end", "message"),
    [
        (lambda series: series.tz_localize(None), END, "needs a pandas series with a time-zone aware index"),
        (lambda series: series.to_numpy(), END, "needs a pandas series with a time-zone aware index"),
        (lambda series: series[::-1], END, "times are -1 to -1 h apart"),
        (lambda series: series.iloc[[0, 1, 5]], END, "times are 1 to 4 h apart"),
        (lambda series: series[:1], END, "1 values are too few"),
        (lambda series: series, END.replace(tzinfo=None), "must be a time with a zone"),
        (lambda series: series, "2024-01-09", "must be a time with a zone"),
    ],
)
def test_what_cannot_be_repeated_is_refused(change: Callable[[Any], Any], end: Any, message: str) -> None:
    """A series in descending order was returned as it is; others were errors of pandas."""
    series = change(stamped("2024-01-01", "2024-01-04"))
    for repeat in (extended, lambda given, last: over_years(given, END, last)):
        with pytest.raises(bess.InputError, match=message):
            repeat(series, end)


def test_the_end_may_be_in_another_time_zone() -> None:
    series, berlin = stamped("2024-01-01", "2024-01-04"), ZoneInfo("Europe/Berlin")
    pd.testing.assert_series_equal(extended(series, END.astimezone(berlin)), extended(series, END))


def test_a_period_that_ends_before_it_begins_is_refused() -> None:
    with pytest.raises(bess.InputError, match=r"the period ends at .*, before it begins at"):
        over_years(stamped("2024-01-01", "2025-01-01"), END, END.replace(year=2023))
