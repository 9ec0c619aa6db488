"""Files of the families that are not at hand: other years, steps, languages, layouts and zones; synthetic."""

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sisters import (
    BERLIN,
    energy_charts,
    energy_charts_intraday,
    entsoe_new,
    entsoe_old,
    smard_de,
    smard_de_day_and_clock,
    smard_en,
    smard_en_old,
    truth,
)

import bess

WRITERS = {
    "smard-de": smard_de,
    "smard-de-stripped": lambda s: smard_de(s, stripped=True),
    "smard-de-day-and-clock": smard_de_day_and_clock,
    "smard-en": smard_en,
    "smard-en-old": smard_en_old,
    "energy-charts-en": lambda s: energy_charts(s, wrong=(30, 31, 70)),
    "energy-charts-de": lambda s: energy_charts(s, german_ui=True, zone=" (DE-LU)", wrong=(40, 41, 50)),
    "entsoe-old": entsoe_old,
    "entsoe-new": lambda s: entsoe_new({"BZN|FR": s + 1, "BZN|DE-LU": s}),
    "entsoe-new-utc": lambda s: entsoe_new({"BZN|DE-LU": s}, clock="UTC"),
}
PERIODS = {"spring": ("2026-03-26", "2026-04-02"), "autumn": ("2023-10-27", "2023-10-31")}


def save(folder: Path, text: str, name: str = "prices.csv", encoding: str = "utf-8-sig") -> Path:
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return path


def equal(series: pd.Series, expected: pd.Series) -> None:
    pd.testing.assert_series_equal(
        series, expected, check_names=False, check_freq=False, check_index_type=False
    )
    assert series.attrs["units"] == "EUR/MWh"
    assert str(series.index.tz) == "UTC"


@pytest.mark.parametrize("minutes", [60, 15])
@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("form", WRITERS)
def test_every_format_gives_back_the_series_over_a_change_of_the_clock(form, period, minutes, tmp_path):
    expected = truth(*PERIODS[period], minutes)
    equal(bess.read_prices(save(tmp_path, WRITERS[form](expected))), expected)


def test_a_leap_year_of_quarter_hours_has_35136_steps_and_days_of_23_and_25_hours(tmp_path):
    expected = truth("2028-01-01", "2028-12-31", 15)
    series = bess.read_prices(save(tmp_path, smard_de(expected)))
    equal(series, expected)
    assert len(series) == 35_136
    lengths = series.groupby(series.index.tz_convert(BERLIN).date).size().value_counts()
    assert lengths.to_dict() == {96: 364, 92: 1, 100: 1}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("line_break", ["\n", "\r\n"])
def test_copies_saved_again_in_other_encodings_are_the_same(encoding, line_break, tmp_path):
    expected = truth("2024-06-01", "2024-06-02", 60)
    text = smard_de(expected, {"Deutschland/Luxemburg": expected, "Österreich": expected + 2}).replace(
        "\n", line_break
    )
    equal(bess.read_prices(save(tmp_path, text, encoding=encoding)), expected)
    equal(bess.read_prices(save(tmp_path, text, encoding=encoding), zone="AT"), expected + 2)


def test_an_archive_is_unpacked_whatever_its_name(tmp_path):
    expected = truth("2024-06-01", "2024-06-02", 60)
    text = entsoe_new({"BZN|DE-LU": expected}).encode()
    (tmp_path / "a.bin").write_bytes(gzip.compress(text))
    with zipfile.ZipFile(tmp_path / "b.dat", "w") as archive:
        archive.writestr("prices.csv", text)
    for name in ("a.bin", "b.dat"):
        equal(bess.read_prices(tmp_path / name), expected)


@pytest.mark.parametrize(
    "zone", ["DE-LU", "DE/LU", "de_lu", "Germany/Luxembourg", "Deutschland/Luxemburg", "BZN|DE-LU"]
)
def test_a_zone_has_many_names(zone, tmp_path):
    expected = truth("2024-06-01", "2024-06-02", 60)
    equal(bess.read_prices(save(tmp_path, smard_de(expected)), zone=zone), expected)
    equal(bess.read_prices(save(tmp_path, entsoe_new({"BZN|DE-LU": expected})), zone=zone), expected)


@pytest.mark.parametrize("first", ["2018-09-29", "2017-05-01"])
def test_the_zone_with_austria_continues_the_german_series_before_october_2018(first, tmp_path):
    expected = truth(first, f"{first[:4]}-10-02" if first > "2018" else "2017-05-02", 60)
    split = pd.Timestamp("2018-10-01", tz=BERLIN)
    new, old = expected.where(expected.index >= split), expected.where(expected.index < split)
    zones = {"Deutschland/Luxemburg": new, "DE/AT/LU": old}
    series = bess.read_prices(save(tmp_path, smard_de(expected, zones)))
    equal(series, expected)
    assert series.attrs["repairs"].rows("zone-join") == (expected.index < split).sum()
    areas = {"BZN|DE-AT-LU": old.dropna(), "BZN|DE-LU": new.dropna()}
    if new.notna().any():
        equal(bess.read_prices(save(tmp_path, entsoe_new(areas))), expected)


def test_every_repair_is_reported_once(tmp_path, caplog):
    expected = truth("2026-03-01", "2026-10-31", 60)
    with caplog.at_level("INFO", logger="bess.market"):
        repairs = bess.read_prices(save(tmp_path, entsoe_old(expected))).attrs["repairs"]
    assert [r.kind for r in repairs] == ["spring-hour", "autumn-hour", "stray-rows"]
    assert [r.rows for r in repairs] == [1, 1, 1]
    assert len(caplog.records) == 1
    series = bess.read_prices(save(tmp_path, energy_charts(expected, wrong=(100, 101, 600))))
    assert series.attrs["repairs"].rows("offset-label") == 3
    assert series.attrs["repairs"][0].line == 103


@pytest.mark.parametrize("stray", ["01/01/2022 00:00,,,69.66,,\n", "01/01/2022 00:00,,,,,\n", ""])
def test_stray_rows_of_the_next_year_are_dropped(stray, tmp_path):
    expected = truth("2021-12-01", "2021-12-31", 15, clock="Etc/GMT-1")
    series = bess.read_prices(save(tmp_path, energy_charts_intraday(expected, stray)))
    equal(series, expected)
    assert series.attrs["repairs"].rows("stray-rows") == bool(stray)


def test_an_intraday_year_of_fixed_clock_has_no_change_of_the_clock(tmp_path):
    expected = truth("2020-01-01", "2020-12-31", 15, clock="Etc/GMT-1")
    path = save(tmp_path, energy_charts_intraday(expected))
    series = bess.read_prices(path)
    equal(series, expected)
    assert series.attrs["product"] == "id1"
    assert len(series) == 35_136
    equal(bess.read_prices(path, product="ID3"), (expected - 2).round(2))
    equal(bess.read_prices(path, product="auction"), (expected - 1).round(2))
    with pytest.raises(bess.InputError, match=r"product='ida1' is none.*ID3-Price \[id3\]"):
        bess.read_prices(path, product="ida1")


def test_a_year_that_changes_from_hours_to_quarter_hours_is_read_in_quarter_hours(tmp_path):
    hours, quarters = truth("2025-09-29", "2025-09-30", 60), truth("2025-10-01", "2025-10-02", 15)
    both = pd.concat([hours, quarters])
    series = bess.read_prices(save(tmp_path, entsoe_new({"BZN|DE-LU": both})))
    equal(series, both.resample("15min").ffill())
    assert series.attrs["repairs"].rows("step-change") == hours.size


def test_an_hourly_product_among_quarter_hours_is_held_until_it_changes(tmp_path):
    hours, quarters = truth("2025-09-29", "2025-09-30", 60), truth("2025-10-01", "2025-10-02", 15)
    sparse = hours.reindex(truth("2025-09-29", "2025-10-02", 15).index)
    sparse[quarters.index] = quarters
    series = bess.read_prices(save(tmp_path, energy_charts(sparse)))
    equal(series, sparse.ffill())
    hourly = bess.read_prices(save(tmp_path, energy_charts(sparse[: quarters.index[0]].iloc[:-1])))
    equal(hourly, hours)


def test_of_several_sequences_the_first_is_taken(tmp_path):
    expected = truth("2024-06-01", "2024-06-02", 60)
    first = entsoe_new({"BZN|DE-LU": expected}, sequence="Sequence Sequence 1")
    second = entsoe_new(
        {"BZN|DE-LU": truth("2024-06-01", "2024-06-02", 15, seed=2)}, sequence="Sequence Sequence 2"
    )
    equal(bess.read_prices(save(tmp_path, second + first.split("\n", 1)[1])), expected)


def test_a_product_that_ends_within_the_year_is_cut_there_and_reported(tmp_path):
    expected = truth("2025-09-29", "2025-10-02", 60)
    known = expected.where(expected.index < pd.Timestamp("2025-10-01", tz=BERLIN))
    series = bess.read_prices(save(tmp_path, energy_charts(known)))
    equal(series, known.dropna())
    assert series.attrs["repairs"].rows("ends-cut") == 48


def test_a_table_sorted_by_the_clock_in_autumn_is_put_in_order(tmp_path):
    expected = truth("2024-10-27", "2024-10-27", 15)
    head, *rows = smard_de(expected).splitlines()
    text = "\n".join([head, *sorted(rows, key=lambda row: row[:16])]) + "\n"
    equal(bess.read_prices(save(tmp_path, text)), expected)


def test_a_line_quoted_as_one_cell_is_unwrapped(tmp_path):
    expected = truth("2025-01-01", "2025-01-02", 60)
    lines = entsoe_new({"BZN|DE-LU": expected}).splitlines()
    text = "\n".join('"' + line.replace('"', '""') + '"' for line in lines)
    equal(bess.read_prices(save(tmp_path, text)), expected)


def test_zones_that_are_empty_or_absent_are_named_with_those_that_are_there(tmp_path):
    path = save(tmp_path, smard_de(truth("2024-06-01", "2024-06-02", 60)))
    with pytest.raises(bess.InputError, match=r"line 2: .*'DK1' has no value.*Deutschland/Luxemburg"):
        bess.read_prices(path, zone="DK1")
    with pytest.raises(bess.InputError, match=r"'FR' is not in this file.*Deutschland/Luxemburg"):
        bess.read_prices(path, zone="FR")
    path = save(tmp_path, entsoe_new({"BZN|PT": truth("2024-06-01", "2024-06-02", 60)}))
    with pytest.raises(bess.InputError, match=r"'DE-LU' is not in this file.*PT"):
        bess.read_prices(path)


def test_negative_and_large_prices_survive(tmp_path):
    index = pd.date_range("2024-05-31 22:00", periods=24, freq="h", tz="UTC")
    expected = pd.Series(np.r_[-500.0, 4000.0, 1234.0, 0.1, np.linspace(-1, 1, 20).round(2)], index=index)
    for writer in (smard_de, smard_en, lambda s: smard_de(s, stripped=True)):
        equal(bess.read_prices(save(tmp_path, writer(expected))), expected)
