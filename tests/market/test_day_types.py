"""Claim: a standard load profile as a table of days, without dates, is not read as a series."""

from __future__ import annotations

import io
from datetime import datetime
from pathlib import Path

import pytest

import bess
from bess.dispatch import read_profile

CLOCKS = [f"{m // 60 % 24:02d}:{m % 60:02d}" for m in range(15, 1441, 15)]
MONTHS = [
    "Januar",
    "Februar",
    "März",
    "April",
    "Mai",
    "Juni",
    "Juli",
    "August",
    "September",
    "Oktober",
    "November",
    "Dezember",
]


def row(clock: str, columns: int, separator: str = ";") -> str:
    return separator.join([clock, *(f"{70 + i}.5" for i in range(columns))])


def classic() -> str:
    head = [
        ";Winter;;;Sommer;;;Übergangszeit;;",
        "[W];" + ";".join(["Samstag", "Sonntag", "Werktag"] * 3),
    ]
    return "\n".join([*head, *(row(clock, 9) for clock in CLOCKS)]) + "\n"


def titled() -> str:
    return f"Repräsentatives Lastprofil G0, gültig ab 01.01.2000{';' * 9}\n" + classic()


def one_header() -> str:
    names = [
        f"{s}_{d}" for s in ("winter", "summer", "transition") for d in ("weekday", "saturday", "sunday")
    ]
    return "\n".join([",".join(["time", *names]), *(row(clock, 9, ",") for clock in CLOCKS)]) + "\n"


def below_each_other() -> str:
    rows = [
        f"{season},{day},{clock},80.5"
        for season in ("winter", "summer", "transition")
        for day in ("saturday", "sunday", "workday")
        for clock in CLOCKS
    ]
    return "\n".join(["period,weekday,time,h0", *rows]) + "\n"


def months() -> str:
    starts = [CLOCKS[-1], *CLOCKS[:-1]]
    head = [";" + ";".join(f"{m};;" for m in MONTHS), "[kWh];" + ";".join(["SA", "FT", "WT"] * 12)]
    spans = [f"{a}-{b}" for a, b in zip(starts, CLOCKS, strict=True)]
    return "\n".join([*head, *(row(span, 36) for span in spans)]) + "\n"


TABLES = {
    "classic": classic,
    "titled": titled,
    "one header": one_header,
    "below each other": below_each_other,
    "months": months,
}


@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_days_says_what_it_is_and_what_to_do(table: str, tmp_path: Path) -> None:
    path = tmp_path / "slp.csv"
    path.write_text(TABLES[table](), encoding="utf-8")
    for column in (None, "h0", "Werktag"):
        with pytest.raises(bess.InputError) as caught:
            read_profile(path, column=column, time_zone="Europe/Berlin")
        said = str(caught.value)
        assert "has times of day without dates" in said and "standard load profile" in said
        assert "public holidays as Sundays" in said and "a column of times and one of power" in said


def test_a_workbook_of_days_is_refused_as_well(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for line in classic().splitlines():
        book.active.append(line.split(";"))
    book.active.append([datetime(1900, 1, 1), *[70.5] * 9])
    content = io.BytesIO()
    book.save(content)
    (tmp_path / "slp.xlsx").write_bytes(content.getvalue())
    with pytest.raises(bess.InputError, match=r"times of day without dates, as .* a standard load profile"):
        read_profile(tmp_path / "slp.xlsx", time_zone="Europe/Berlin")


def test_a_series_with_seasons_and_kinds_of_day_is_read(tmp_path: Path) -> None:
    rows = [
        f"2024-01-{1 + h // 24:02d} {h % 24:02d}:00;{10 + h % 7};{season};{day}"
        for h in range(72)
        for season, day in [(("winter", "summer")[h % 2], ("saturday", "sunday", "weekday")[h // 24])]
    ]
    path = tmp_path / "series.csv"
    path.write_text("\n".join(["time;power_kw;season;day", *rows]) + "\n")
    assert read_profile(path, column="power_kw", time_zone="UTC").size == 288
