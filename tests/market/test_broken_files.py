"""A broken file gives one sentence that names file, line and remedy; never a plausible wrong answer."""

import gzip

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sisters import energy_charts, entsoe_new, entsoe_old, smard_de, smard_en, truth

import bess
from bess.market import read_capacity_prices

SERIES = truth("2024-06-01", "2024-06-05", 60)
TEXTS = {
    "smard-de": smard_de(SERIES),
    "smard-en": smard_en(SERIES),
    "energy-charts": energy_charts(SERIES),
    "entsoe-old": entsoe_old(SERIES),
    "entsoe-new": entsoe_new({"BZN|DE-LU": SERIES}),
}


def refused(tmp_path, content: str | bytes, match: str, **arguments) -> str:
    path = tmp_path / "prices.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(bess.InputError, match=match) as caught:
        bess.read_prices(path, **arguments)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert ". " not in message.removeprefix(str(path))
    return message


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(bess.InputError, match=r"absent\.csv: no such file"):
        bess.read_prices(tmp_path / "absent.csv")
    with pytest.raises(bess.InputError, match="cannot be read"):
        bess.read_prices(tmp_path)


@pytest.mark.parametrize("form", TEXTS)
@pytest.mark.parametrize("cut", [5, 12, 29])
def test_a_truncated_export_is_refused(form, cut, tmp_path):
    lines = TEXTS[form].splitlines(keepends=True)[:80]
    text = "".join(lines)[:-cut]
    refused(tmp_path, text, r"line \d+: .*(truncated|is not a)")


def test_a_number_cut_within_its_digits_is_refused(tmp_path):
    lines = smard_de(SERIES, {"Deutschland/Luxemburg": SERIES}).splitlines()[:80]
    refused(tmp_path, "\n".join(lines)[:-1], r"line 80: .*truncated; fetch it again")


def test_a_truncated_archive_is_refused(tmp_path):
    packed = gzip.compress(TEXTS["smard-de"].encode())
    refused(tmp_path, packed[: len(packed) // 2], "damaged or truncated")
    refused(tmp_path, b"PK\x03\x04" + packed[:50], "damaged or truncated")


@pytest.mark.parametrize("form", ["smard-de", "energy-charts", "entsoe-new"])
def test_rows_with_another_separator_than_the_header_are_refused(form, tmp_path):
    head, _, body = TEXTS[form].partition("\n")
    other = body.replace(";", ",") if ";" in body else body.replace('","', '";"').replace(",", ";")
    refused(tmp_path, f"{head}\n{other}", r"line \d+: .*separator")


def test_a_decimal_comma_in_a_table_of_commas_is_refused(tmp_path):
    refused(tmp_path, TEXTS["smard-de"].replace(";", ","), r"line 2: .*separator")


def test_a_file_without_any_separator_is_refused(tmp_path):
    refused(tmp_path, TEXTS["smard-de"].replace(";", "|").replace(",", "."), r"line \d+: .*separat")


def test_mixed_encodings_are_refused(tmp_path):
    lines = smard_de(SERIES, {"Deutschland/Luxemburg": SERIES}).splitlines()
    raw = (
        "\n".join(lines[:5]).encode()
        + "\n31.02.2024 Übel".encode("cp1252")
        + b"\n"
        + "\n".join(lines[5:]).encode()
    )
    refused(tmp_path, raw, r"line 6: is not UTF-8 while line 1 is: mixed encodings; save")


@pytest.mark.parametrize("form", ["smard-de", "smard-en"])
def test_swapped_columns_are_refused(form, tmp_path):
    head, *rows = TEXTS[form].splitlines()
    ends_first = [";".join([b, a, *rest]) for a, b, *rest in (row.split(";") for row in rows)]
    refused(tmp_path, "\n".join([head, *ends_first]) + "\n", r"line 2: .*swapped")
    price_first = [";".join([p, a, b, *rest]) for a, b, p, *rest in (row.split(";") for row in rows)]
    refused(tmp_path, "\n".join([head, *price_first]) + "\n", r"line 2: .*swapped")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (["5"], "line 2: is the only row; a series needs two values: give a longer file"),
        ([""], "line 2: is the only row, and its value is missing; a series needs two values"),
        (["", ""], "line 2: of 2 rows from here to line 3, none has a value; a series needs two values"),
        (["", "5"], "line 2: of 2 rows from here to line 3, 1 has a value; .* choose another column"),
    ],
)
def test_too_few_values_are_counted(values, words, tmp_path):
    rows = [f"2024-01-01T0{hour}:00Z,{value}" for hour, value in enumerate(values)]
    (tmp_path / "prices.csv").write_text("\n".join(["time,price_eur_mwh", *rows]) + "\n")
    with pytest.raises(bess.InputError, match=words):
        bess.read_prices(tmp_path / "prices.csv")


def test_swapped_columns_of_a_plain_table_are_refused(tmp_path):
    rows = [f"{v},{t.isoformat()}" for t, v in SERIES.items()]
    refused(tmp_path, "\n".join(["price,time", *rows]), r"line 2: columns 'price' and 'time' are swapped")


@pytest.mark.parametrize(
    "writer", [smard_de, energy_charts, entsoe_old, lambda s: entsoe_new({"BZN|DE-LU": s})]
)
def test_a_year_without_values_is_refused(writer, tmp_path):
    year = truth("2024-01-01", "2024-12-31", 60) * np.nan
    text = writer(year).replace('"nan"', '""')
    refused(
        tmp_path,
        text,
        r"line [23]: (of 87\d\d rows )?from here to line \d+.*(no value|none has a value).*choose",
    )


@pytest.mark.parametrize("form", TEXTS)
def test_a_gap_above_an_hour_needs_a_choice(form, tmp_path):
    lines = TEXTS[form].splitlines()
    start = 30 + lines[1].startswith(",")
    text = "\n".join(lines[:start] + lines[start + 3 :]) + "\n"
    refused(
        tmp_path, text, rf"line {start + 1}: follows a gap of 3 h from 2024-06-02 03:00 UTC.*fill='previous'"
    )
    path = tmp_path / "prices.csv"
    gap = slice("2024-06-02 03:00", "2024-06-02 05:00")
    before, after = SERIES["2024-06-02 02:00"], SERIES["2024-06-02 06:00"]
    for fill, expected in {
        "previous": [before] * 3,
        "interpolate": np.linspace(before, after, 5)[1:4],
        "previous_day": SERIES["2024-06-01 03:00":"2024-06-01 05:00"],
    }.items():
        series = bess.read_prices(path, fill=fill)
        np.testing.assert_allclose(series[gap], expected)
        assert series.attrs["repairs"].rows(f"gap-{fill}") == 3
        assert series.drop(series[gap].index).equals(SERIES.drop(SERIES[gap].index))
    with pytest.raises(bess.InputError, match="fill 'zero' is unknown; allowed are previous"):
        bess.read_prices(path, fill="zero")


def test_a_gap_of_an_hour_is_bridged_and_reported(tmp_path):
    quarters = truth("2024-06-01", "2024-06-02", 15)
    lines = smard_de(quarters).splitlines()
    path = tmp_path / "prices.csv"
    path.write_text("\n".join(lines[:50] + lines[54:]) + "\n")
    series = bess.read_prices(path)
    np.testing.assert_allclose(series.iloc[49:53], np.linspace(quarters.iloc[48], quarters.iloc[53], 6)[1:5])
    assert series.attrs["repairs"].rows("gap-filled") == 4


@pytest.mark.parametrize("form", TEXTS)
def test_a_repeated_row_and_one_that_goes_back_are_refused(form, tmp_path):
    lines = TEXTS[form].splitlines()
    refused(
        tmp_path,
        "\n".join([*lines[:30], lines[29], *lines[30:]]) + "\n",
        r"line 31: repeats .* of line 30; remove",
    )
    text = "\n".join([*lines[:30], lines[31], lines[30], *lines[32:]]) + "\n"
    if form == "entsoe-new":  # exports of that platform do have rows out of place
        (tmp_path / "prices.csv").write_text(text)
        series = bess.read_prices(tmp_path / "prices.csv")
        assert series.equals(SERIES) and series.attrs["repairs"].rows("sorted") == 1
    else:
        refused(tmp_path, text, r"line 32: goes back.*sort")


def test_naive_and_mixed_times_of_plain_tables_are_refused(tmp_path):
    naive = [f"{t:%Y-%m-%d %H:%M},{v}" for t, v in SERIES.items()]
    aware = [f"{t:%Y-%m-%dT%H:%M}+00:00,{v}" for t, v in SERIES.items()]
    head = "time,price"
    refused(tmp_path, "\n".join([head, *naive]), r"line 2: .*has no time zone; give time_zone")
    refused(
        tmp_path,
        "\n".join([head, *aware[:9], *naive[9:]]),
        r"line 11: .*no UTC offset while line 2 has one: mixed",
    )
    refused(
        tmp_path,
        "\n".join([head, *naive[:9], *aware[9:]]),
        r"line 11: .*a UTC offset while line 2 has none: mixed",
    )
    far = [row.replace("+00:00", "+05:00") for row in aware]
    refused(
        tmp_path,
        "\n".join([head, *aware[:9], *far[9:]]),
        r"line 11: .*\+5 h from UTC while line 2.*mixed time zones",
    )
    with pytest.raises(bess.InputError, match="time_zone 'Mars/Base' is unknown"):
        (tmp_path / "p.csv").write_text("\n".join([head, *naive]))
        bess.read_prices(tmp_path / "p.csv", time_zone="Mars/Base")


def test_the_hour_skipped_in_spring_betrays_a_clock_without_summer_time(tmp_path):
    rows = [f"{t:%Y-%m-%d %H:%M},1.5" for t in pd.date_range("2024-03-30", "2024-04-02", freq="h")]
    text = "\n".join(["time,price", *rows])
    refused(tmp_path, text, r"line 28: 2024-03-31 02:00 does not exist.*UTC\+1", time_zone="Europe/Berlin")
    path = tmp_path / "prices.csv"
    assert bess.read_prices(path, time_zone="UTC+1").index[0] == pd.Timestamp("2024-03-29 23:00", tz="UTC")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "line 1: the file is empty"),
        ("time,price\n", "line 1: .*no data"),
        ("time,price\n2024-01-01T00:00Z,1\n2024-01-01T01:00Z,abc\n", "line 3: 'abc'.*not a number"),
        ("time;price\n2024-01-01T00:00Z;1,5\n2024-01-01T01:00Z;1.5\n", "line 3: .*decimal comma in line 2"),
        ("time,price\n2024-01-01T00:00Z,1\nyesterday,2\n", "line 3: 'yesterday'.*not a time"),
        ("time,price\n2024-01-01T00:00Z,1\n2024-01-01T01:00Z,2\n2024-01-01T01:20Z,2\n", "min after line"),
        ("time,price\n2024-01-01T00:00Z,1\n2024-01-02T00:00Z,2\n2024-01-03T00:00Z,2\n", "step of 24 h"),
        ("time,a,b\n2024-01-01T00:00Z,1,2\n2024-01-01T01:00Z,2,3\n", "line 1: zone 'DE-LU' is not.*a, b"),
        ("time,price [ct/kWh]\n2024-01-01T00:00Z,1\n2024-01-01T01:00Z,2\n", "unit"),
        ("time,price\n2024-01-01T00:00Z,1\n2024-01-01T01:00Z,inf\n", "line 3: 'inf'"),
        ("time,price\n2024-01-01T00:00Z,1\x00\n2024-01-01T01:00Z,2\n", "line 2: .*zero byte"),
    ],
)
def test_small_faults_are_named_with_their_line(text, match, tmp_path):
    refused(tmp_path, text, match)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(form=st.sampled_from(sorted(TEXTS)), data=st.data())
@example(form="smard-de", data=None)
def test_a_damaged_export_is_refused_or_read_without_inventing_prices(form, data, tmp_path):
    """Any bytes overwritten or cut: one sentence, or a gap-free series no longer than it was."""
    raw = bytearray(TEXTS[form].encode())
    if data is not None:
        start = data.draw(st.integers(0, len(raw) - 1))
        raw[start : start + data.draw(st.integers(0, 200))] = data.draw(st.binary(max_size=20))
    path = tmp_path / "damaged.csv"
    path.write_bytes(raw)
    try:
        series = bess.read_prices(path)
    except bess.InputError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)
    else:
        assert series.notna().all()
        assert 2 <= len(series) <= len(SERIES) + 1


@pytest.mark.parametrize("product", ["NEGPOS_08_04", "NEGPOS_04_04", "POS_04_08"])
def test_a_tender_block_without_a_duration_is_refused(product, tmp_path):
    head = "DATE_FROM;TENDER_NUMBER;PRODUCTNAME;GERMANY_SETTLEMENTCAPACITY_PRICE_[EUR/MW]"
    (tmp_path / "fcr.csv").write_text(f"{head}\n01.01.2024;1;{product};50,5\n")
    with pytest.raises(bess.InputError, match=rf"line 2: the product '{product}' is none of NEGPOS_00_04"):
        read_capacity_prices(tmp_path / "fcr.csv")


def test_a_line_break_within_a_quoted_number_is_refused_with_its_line(tmp_path):
    cells = enumerate(["1.5", '"2\n3,5"', "2.5", "3"])
    rows = "".join(f"2024-01-01 {hour:02d}:00Z,{cell}\n" for hour, cell in cells)
    (tmp_path / "p.csv").write_text(f"time,price\n{rows}")
    with pytest.raises(bess.InputError, match=r"line 4"):
        bess.read_prices(tmp_path / "p.csv")
