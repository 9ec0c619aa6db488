"""Plain tables of prices and weather: any separator, decimal sign and clock; CSV or Parquet."""

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sisters import BERLIN, entsoe_old, truth

import bess
from bess.errors import InputError
from bess.market.numbers import parse_numbers
from bess.market.zones import zone_code

SERIES = truth("2024-10-26", "2024-10-28", 60)


def equal(series: pd.Series, expected: pd.Series) -> None:
    pd.testing.assert_series_equal(
        series, expected, check_names=False, check_freq=False, check_index_type=False
    )


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]
)
@pytest.mark.parametrize(
    ("clock", "form"),
    [
        *(
            (clock, form)
            for clock in ("aware", "UTC", BERLIN, "UTC+1")
            for form in ("%Y-%m-%d %H:%M", "%d.%m.%Y %H:%M:%S")
        ),
        ("UTC", "%m/%d/%Y %I:%M %p"),
    ],
)
@pytest.mark.parametrize("header", [True, False])
def test_a_table_of_two_columns_is_read_with_its_clock(separator, decimal, clock, form, header, tmp_path):
    zone = "Etc/GMT-1" if clock == "UTC+1" else BERLIN if clock == "aware" else clock
    rows = ["time" + separator + "price"] if header else []
    for time, value in SERIES.tz_convert(zone).items():
        offset = time.strftime("%z") if clock == "aware" else ""
        rows.append(f"{time.strftime(form)}{offset}{separator}{str(value).replace('.', decimal)}")
    path = tmp_path / "table"
    path.write_text("\n".join(rows))
    equal(bess.read_prices(path, time_zone=None if clock == "aware" else clock), SERIES)


def test_a_column_of_several_is_chosen_by_zone_or_name(tmp_path):
    path = tmp_path / "table.csv"
    frame = pd.DataFrame({"Germany/Luxembourg [EUR/MWh]": SERIES, "FR": SERIES + 1, "scenario": SERIES + 2})
    frame.columns = ["Germany/Luxembourg", "FR", "scenario"]
    frame.to_csv(path, index_label="time")
    for zone, shift in (("DE-LU", 0), ("France", 1), ("scenario", 2)):
        equal(bess.read_prices(path, zone=zone), SERIES + shift)
    with pytest.raises(InputError, match=r"zone 'PT' is not in this file.*Germany/Luxembourg, FR, scenario"):
        bess.read_prices(path, zone="PT")


def test_a_single_column_of_another_zone_is_not_taken_for_the_one_wanted(tmp_path):
    path = tmp_path / "table.csv"
    SERIES.to_frame("FR").to_csv(path, index_label="time")
    with pytest.raises(InputError, match="'DE-LU' is not in this file"):
        bess.read_prices(path)


@pytest.mark.parametrize("zone", ["XX", "p10"])
def test_an_unknown_zone_is_refused_by_a_file_that_names_none(zone, tmp_path):
    """The band p10 of a file of one forecast was that forecast."""
    plain, entsoe = tmp_path / "plain.csv", tmp_path / "entsoe.csv"
    SERIES.to_frame("price").to_csv(plain, index_label="time")
    entsoe.write_text(entsoe_old(SERIES))
    for path, match in ((plain, "give as zone one of its columns: price"), (entsoe, "leave zone out")):
        for known in ("DE-LU", "Norway 2"):
            equal(bess.read_prices(path, zone=known), SERIES)
        with pytest.raises(InputError, match=f"zone '{zone}' is .*{match}"):
            bess.read_prices(path, zone=zone)


@pytest.mark.parametrize("index", [True, False])
def test_parquet_is_read_from_an_index_or_a_column_of_times(index, tmp_path):
    path = tmp_path / "table"
    frame = SERIES.to_frame("price") if index else SERIES.rename_axis("when").reset_index(name="price")
    frame.to_parquet(path)
    equal(bess.read_prices(path), SERIES)
    if index:
        frame.tz_convert(BERLIN).tz_localize(None).to_parquet(path)
        equal(bess.read_prices(path, time_zone=BERLIN), SERIES)
        with pytest.raises(InputError, match="has no time zone"):
            bess.read_prices(path)
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(InputError, match="damaged or truncated"):
            bess.read_prices(path)


def test_weather_of_the_german_service_has_gaps_of_minus_999(tmp_path):
    path = tmp_path / "produkt_zehn_min_tu.txt"
    rows = ["STATIONS_ID;MESS_DATUM;  QN;PP_10;TT_10;TM5_10;eor"]
    times = pd.date_range("2024-01-01", periods=30, freq="10min")
    rows += [f"1078;{t:%Y%m%d%H%M};3;{'-999' if i == 7 else 1010.1};{-999 if i == 9 else i / 10};1;eor"
             for i, t in enumerate(times)]  # fmt: skip
    path.write_text("\n".join(rows) + "\n")
    series = bess.read_weather(path)
    assert series.index[0] == pd.Timestamp("2024-01-01", tz="UTC")
    assert series.tolist() == pytest.approx([i / 10 for i in range(30)])
    assert series.attrs["repairs"].rows("gap-filled") == 1


def test_weather_with_a_block_above_its_header_is_read(tmp_path):
    path = tmp_path / "weather.csv"
    times = pd.date_range("2023-06-01", periods=48, freq="h")
    rows = [
        "location,longitude,latitude",
        "Aachen,6.1,50.8",
        "year,month,day,hour,minute,temperature,pressure",
    ]
    rows += [f"{t.year},{t.month},{t.day},{t.hour},{t.minute},{20 + t.hour / 10},996.4" for t in times]
    path.write_bytes("\r\n".join(rows).encode())
    series = bess.read_weather(path)
    assert len(series) == 48
    assert series.loc["2023-06-01 12:00+00:00"] == 21.2
    assert series.name == "temperature_c"


def test_weather_of_two_columns_is_read_with_its_clock(tmp_path):
    path = tmp_path / "weather.csv"
    rows = [
        f"{t:%d.%m.%Y %H:%M};{str(5 + t.hour / 4).replace('.', ',')}"
        for t in pd.date_range("2023-01-01", periods=48, freq="h")
    ]
    path.write_text("\n".join(["Zeit;Lufttemperatur [°C]", *rows]))
    series = bess.read_weather(path, time_zone="UTC+1")
    assert series.index[0] == pd.Timestamp("2022-12-31 23:00", tz="UTC")
    assert series.iloc[1] == 5.25


@pytest.mark.parametrize("value", [293.15, -120.0])
def test_weather_in_kelvin_is_refused_with_its_line(value, tmp_path):
    path = tmp_path / "weather.csv"
    path.write_text(f"time,temperature\n2024-01-01T00:00Z,10\n2024-01-01T01:00Z,{value}\n")
    with pytest.raises(InputError, match=r"line 3: temperature .* outside \[-90, 60\] degC"):
        bess.read_weather(path)


def test_weather_without_a_clear_column_asks_for_it(tmp_path):
    path = tmp_path / "weather.csv"
    path.write_text("time,a,b\n2024-01-01T00:00Z,10,1\n2024-01-01T01:00Z,11,2\n")
    with pytest.raises(InputError, match="temperature is not clear; give one of: a, b"):
        bess.read_weather(path)
    with pytest.raises(InputError, match="no column 'c'"):
        bess.read_weather(path, column="c")
    assert bess.read_weather(path, column="b").tolist() == [1.0, 2.0]


@given(st.lists(st.decimals(-5000, 5000, places=2, allow_nan=False), min_size=2))
def test_german_and_english_numbers_are_the_same_numbers(values):
    expected = [float(v) for v in values]
    english = [f"{v:,.2f}" for v in values]
    german = [text.translate(str.maketrans(",.", ".,")) for text in english]
    assert parse_numbers(pd.Series(german), ",").tolist() == expected
    assert parse_numbers(pd.Series(english), ".").tolist() == expected
    assert parse_numbers(pd.Series(german), ".").tolist() == expected


def test_zone_codes_are_their_own_names_and_neighbours_are_not_germany():
    for code in ("DE-LU", "DE-AT-LU", "AT", "FR", "DK1", "SE4", "PT", "IT-North"):
        assert zone_code(code) == code
    for name in ("∅ Anrainer DE/LU", "∅ DE/LU neighbours"):
        assert zone_code(name) != "DE-LU"
    assert zone_code("10Y1001A1001A82H") == "DE-LU"
