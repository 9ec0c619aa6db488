"""The real exports beside the repository: counts, extremes and means as their sources state them."""

from pathlib import Path

import pandas as pd
import pytest

import bess
import bess.dispatch

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = [
    pytest.mark.golden,
    pytest.mark.skipif(not DATA.is_dir(), reason="real data are not beside the repository (../shared/data)"),
]

PRICES = [
    # file, zone, product, rows, min, mean, max, negative
    (
        "smard_de_viertelstunde_2024_berechnet_resaved.csv",
        "DE-LU",
        None,
        35_136,
        -135.45,
        78.51,
        936.28,
        1_828,
    ),
    ("smard_de_viertelstunde_2024Q3_berechnet.csv", "DE-LU", None, 8_832, -73.96, 75.99, 656.37, None),
    ("smard_en_hour_2018_oldlayout.csv", "DE-LU", None, 8_760, -76.01, 44.47, 128.26, None),
    ("energy-charts_de_hour_2023.csv", "DE-LU", None, 8_760, -500.0, 95.18, 524.27, 301),
    ("energy-charts_de_intraday15_2021.csv", "DE-LU", None, 35_040, -122.92, 97.15, 942.35, 1_053),
    ("energy-charts_de_intraday15_2021.csv", "DE-LU", "id1", 35_040, -122.92, 97.15, 942.35, 1_053),
    ("entsoe_old_day-ahead_DE-LU_2019.csv", "DE-LU", None, 8_760, -90.01, 37.67, 121.46, None),
    ("entsoe_gui_PT_2024_60min.csv.gz", "PT", None, 8_784, -2.0, 63.45, 193.0, None),
]


@pytest.mark.parametrize(("file", "zone", "product", "rows", "least", "mean", "most", "negative"), PRICES)
def test_real_prices_have_the_published_count_and_extremes(
    file, zone, product, rows, least, mean, most, negative
):
    series = bess.read_prices(DATA / "prices" / file, zone=zone, product=product)
    assert len(series) == rows
    assert series.notna().all()
    assert (round(series.min(), 2), round(series.mean(), 2), round(series.max(), 2)) == (least, mean, most)
    assert negative is None or (series < 0.0).sum() == negative
    step = series.index[1] - series.index[0]
    assert (series.index[1:] - series.index[:-1] == step).all()


@pytest.mark.parametrize(
    ("file", "zone", "day", "steps"),
    [
        ("smard_de_viertelstunde_2024_berechnet_resaved.csv", "DE-LU", "2024-03-31", 92),
        ("smard_de_viertelstunde_2024_berechnet_resaved.csv", "DE-LU", "2024-10-27", 100),
        ("smard_en_hour_2018_oldlayout.csv", "DE-LU", "2018-03-25", 23),
        ("energy-charts_de_hour_2023.csv", "DE-LU", "2023-10-29", 25),
        ("entsoe_old_day-ahead_DE-LU_2019.csv", "DE-LU", "2019-03-31", 23),
        ("entsoe_old_day-ahead_DE-LU_2019.csv", "DE-LU", "2019-10-27", 25),
        ("entsoe_gui_PT_2024_60min.csv.gz", "PT", "2024-10-27", 25),
    ],
)
def test_real_days_of_change_have_an_hour_less_or_more(file, zone, day, steps):
    series = bess.read_prices(DATA / "prices" / file, zone=zone)
    assert (series.index.tz_convert("Europe/Berlin").strftime("%Y-%m-%d") == day).sum() == steps


def test_the_repeated_hour_of_2024_keeps_both_of_its_prices():
    series = bess.read_prices(DATA / "prices" / "smard_de_viertelstunde_2024_berechnet_resaved.csv")
    assert series["2024-10-27 00:00":"2024-10-27 00:45"].tolist() == [82.23] * 4
    assert series["2024-10-27 01:00":"2024-10-27 01:45"].tolist() == [80.43] * 4


def test_two_platforms_agree_where_they_overlap():
    year = bess.read_prices(DATA / "prices" / "smard_de_viertelstunde_2024_berechnet_resaved.csv")
    quarter = bess.read_prices(DATA / "prices" / "smard_de_viertelstunde_2024Q3_berechnet.csv")
    pd.testing.assert_series_equal(year[quarter.index], quarter, check_freq=False)


@pytest.mark.parametrize(
    "file", ["dwd_15min_2024_Duesseldorf_6.7686_51.2960.csv", "weather_dwd_duesseldorf_15min_2024.parquet"]
)
def test_real_weather_has_the_published_count_and_extremes(file):
    series = bess.read_weather(DATA / "weather" / file)
    assert len(series) == 35_136
    assert (series.min(), round(series.mean(), 2), series.max()) == (-6.6, 12.26, 33.9)
    assert series.index[0] == pd.Timestamp("2024-01-01", tz="UTC")
    assert series.attrs["units"] == "degC"


def test_the_untouched_export_of_finland_is_read():
    series = bess.read_prices(DATA / "prices" / "entsoe_old_day-ahead_FI_2024_untouched.csv.gz", zone="FI")
    assert len(series) == 6_647
    assert (round(series.min(), 2), round(series.mean(), 2), round(series.max(), 2)) == (
        -20.01,
        48.16,
        1896.0,
    )


def test_the_export_of_hungary_with_another_name_of_its_column_is_read():
    series = bess.read_prices(DATA / "prices" / "entsoe_gui_HU_eur-mwh-column.csv.gz", zone="HU")
    assert len(series) == 25_488
    assert series.attrs["repairs"].rows("sorted") >= 1
    assert series["2024-11-15 23:00":"2024-11-16 02:00"].tolist() == [137.9, 130.64, 119.54, 123.71]


@pytest.mark.parametrize("column", ["metal1", "warehouse"])
def test_real_industrial_loads_are_read(column):
    path = DATA / "load" / "load_industrial_pycity_15min_2010.parquet"
    assert len(bess.dispatch.read_profile(path, column=column, time_zone="UTC+1", scale=1e-3)) == 35_040


def test_real_simbench_loads_are_read():
    path = DATA / "load" / "simbench_load_15min_2016.parquet"
    series = bess.dispatch.read_profile(path, column="G0-A_pload", time_zone="Europe/Berlin", scale=100.0)
    assert len(series) == 35_136 and series.min() >= 0.0 and series.max() <= 100.0
