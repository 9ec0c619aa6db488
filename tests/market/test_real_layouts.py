"""Exports in the layouts of their platforms as they are downloaded; synthetic, from known series."""

import io
import json
import zipfile

import numpy as np
import pandas as pd
import pytest
from sisters import BERLIN, energy_charts_intraday, entsoe_new, entsoe_old, smard_de, truth

import bess
from bess.dispatch import read_profile
from bess.market import over_years

SERIES = truth("2024-03-29", "2024-04-01", 60)
YEAR = pd.date_range("2023-01-01", "2024-01-01", freq="h", inclusive="left")


def write(folder, content, name="file"):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def equal(series, expected):
    pd.testing.assert_series_equal(
        series, expected, check_names=False, check_freq=False, check_index_type=False
    )


# --- ENTSO-E -----------------------------------------------------------------------------------------------


def entsoe_untouched(series, zone):
    """The old export as downloaded: the header has a name more than the rows have cells."""
    head, *rows = entsoe_old(series).splitlines()
    head = f'{head},"Currency","BZN|{zone}"'.replace("MTU (CET)", "MTU (CET/CEST)")
    return "\n".join([head, *(f'{row},"EUR"' for row in rows)]) + "\n"


@pytest.mark.parametrize("zone", ["DE-LU", "FI", "NO2", "IT-North"])
def test_the_old_export_of_entsoe_is_read_as_it_was_downloaded(zone, tmp_path):
    path = write(tmp_path, entsoe_untouched(SERIES, zone))
    equal(bess.read_prices(path, zone=zone), SERIES)
    with pytest.raises(bess.InputError, match=f"'PT' is not in this file.*the file has: {zone}"):
        bess.read_prices(path, zone="PT")


def test_the_old_export_in_pounds_is_refused_and_a_gap_of_two_hours_explained(tmp_path):
    text = entsoe_untouched(SERIES, "GB")
    with pytest.raises(bess.InputError, match=r"line 2: prices are in GBP by column 'Currency'"):
        bess.read_prices(write(tmp_path, text.replace('"EUR"', '"GBP"')), zone="GB")
    lines = entsoe_untouched(SERIES, "FI").splitlines()
    lines[20] = lines[20].replace(lines[20].split('"')[3], "n/e")
    lines[21] = lines[21].replace(lines[21].split('"')[3], "")
    with pytest.raises(bess.InputError, match=r"line 23: follows a gap of 2 h from 2024-03-29 18:00 UTC"):
        bess.read_prices(write(tmp_path, "\n".join(lines) + "\n"), zone="FI")
    truncated = "\n".join(lines[:40])[:-14]
    with pytest.raises(bess.InputError, match=r"line 40: .*truncated"):
        bess.read_prices(write(tmp_path, truncated), zone="FI")


@pytest.mark.parametrize(
    "name", ["Day-ahead (EUR/MWh)", "Day-ahead Price (EUR/MWh)", "Day-ahead Price [EUR/MWh]"]
)
def test_the_new_export_of_entsoe_has_several_names_for_the_price(name, tmp_path):
    text = entsoe_new({"BZN|HU": SERIES}).replace("Day-ahead Price (EUR/MWh)", name)
    equal(bess.read_prices(write(tmp_path, text), zone="HU"), SERIES)


@pytest.mark.parametrize("header", [",0", ",price", "time,0"])
def test_a_series_of_entsoe_py_saved_by_pandas_is_read(header, tmp_path):
    out = io.StringIO()
    SERIES.tz_convert(BERLIN).to_csv(out, header=False)
    equal(bess.read_prices(write(tmp_path, f"{header}\n{out.getvalue()}")), SERIES)
    SERIES.tz_convert(BERLIN).rename(None).to_csv(tmp_path / "plain.csv")
    equal(bess.read_prices(tmp_path / "plain.csv"), SERIES)


# --- other platforms ---------------------------------------------------------------------------------------


def energinet(series, separator=";", descending=True):
    """Energi Data Service: the times twice, all areas below each other, newest first, two currencies."""
    rows = []
    for time, value in series.items():
        local = time.tz_convert("Europe/Copenhagen")
        for area, shift in (("DK1", 1.0), ("DE", 0.0), ("SE4", 2.0)):
            numbers = (f"{(value + shift) * 7.45:.6f}", f"{value + shift:.6f}")
            if separator == ";":
                numbers = [number.replace(".", ",") for number in numbers]
            rows.append(separator.join([f"{time:%Y-%m-%d %H:%M}", f"{local:%Y-%m-%d %H:%M}", area, *numbers]))
    head = separator.join(["HourUTC", "HourDK", "PriceArea", "SpotPriceDKK", "SpotPriceEUR"])
    return "\n".join([head, *(rows[::-1] if descending else rows)]) + "\n"


@pytest.mark.parametrize("separator", [";", ","])
@pytest.mark.parametrize("descending", [True, False])
def test_energinet_has_all_areas_and_two_currencies(separator, descending, tmp_path):
    path = write(tmp_path, energinet(SERIES, separator, descending))
    equal(bess.read_prices(path), SERIES)
    equal(bess.read_prices(path, zone="DK1"), SERIES + 1.0)
    with pytest.raises(bess.InputError, match=r"'FR' is not in this file.*DE, DK1, SE4"):
        bess.read_prices(path, zone="FR")
    only_crowns = "\n".join(line.rpartition(separator)[0] for line in path.read_text().splitlines()) + "\n"
    with pytest.raises(bess.InputError, match="which column is the price in EUR/MWh is not clear"):
        bess.read_prices(write(tmp_path, only_crowns), zone="DK1")


def test_nord_pool_has_a_column_for_each_area_in_its_own_clock(tmp_path):
    local = SERIES.index.tz_convert("Europe/Stockholm")
    rows = [
        f"{a:%d.%m.%Y %H:%M:%S};{a + pd.Timedelta(hours=1):%d.%m.%Y %H:%M:%S};{v:.2f};{v + 1:.2f}".replace(
            ".", ","
        )
        for a, v in zip(local, SERIES, strict=True)
    ]
    rows = [row.replace(",", ".", 2).replace(",", ".", 2) for row in rows]
    text = "\n".join(["Delivery Start (CET);Delivery End (CET);SE3 (EUR);SE4 (EUR)", *rows]) + "\n"
    path = write(tmp_path, text)
    equal(bess.read_prices(path, zone="SE3"), SERIES)
    equal(bess.read_prices(path, zone="Sweden 4"), SERIES + 1)
    swedish = write(tmp_path, text.replace("(EUR)", "(SEK)"))
    with pytest.raises(bess.InputError, match=r"'SE3 \(SEK\)' is in another unit \(SEK\)"):
        bess.read_prices(swedish, zone="SE3")


@pytest.mark.parametrize("minutes", [60, 15])
def test_periods_of_omie_are_counted_through_days_of_23_and_25_hours(minutes, tmp_path):
    expected = pd.concat(
        [
            truth(day, day, minutes, "Europe/Madrid", seed)
            for seed, day in enumerate(("2024-03-30", "2024-03-31", "2024-04-01"))
        ]
    )
    local = expected.index.tz_convert("Europe/Madrid")
    number = expected.groupby(local.date).cumcount() + 1
    rows = [f"{t:%Y;%m;%d};{n};{v + 5:.2f};{v:.2f};" for t, n, v in zip(local, number, expected, strict=True)]
    path = write(tmp_path, "\n".join(["MARGINALPDBC;", *rows, "*"]) + "\n", "marginalpdbc_20240330.1")
    equal(bess.read_prices(path, zone="ES"), expected)
    equal(bess.read_prices(path, zone="PT").round(2), (expected + 5).round(2))


def test_a_remark_beside_energy_charts_is_left_out(tmp_path):
    expected = truth("2021-12-01", "2021-12-03", 15, clock="Etc/GMT-1")
    lines = energy_charts_intraday(expected, "").splitlines()
    lines[40] += "checked by hand"
    series = bess.read_prices(write(tmp_path, "\n".join(lines) + "\n"))
    equal(series, expected)
    assert series.attrs["repairs"].rows("remark") == 1
    lines[40] = lines[40].removesuffix("checked by hand") + "45"
    with pytest.raises(bess.InputError, match=r"line 41: .*wrong or mixed separator"):
        bess.read_prices(write(tmp_path, "\n".join(lines) + "\n"))


@pytest.mark.parametrize("writer", [smard_de, entsoe_old, lambda s: entsoe_new({"BZN|DE-LU": s})])
def test_a_table_saved_as_a_workbook_is_the_same_table(writer, tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl (extra market) is not installed")
    text = writer(SERIES)
    book = openpyxl.Workbook()
    book.active.title = "notes"
    book.active.append(["made by hand"])
    sheet = book.create_sheet("data")
    for row in pd.read_csv(
        io.StringIO(text), sep=";" if ";" in text[:200] else ",", header=None
    ).values.tolist():
        sheet.append([None if cell != cell else cell for cell in row])
    book.save(tmp_path / "prices.xlsx")
    equal(bess.read_prices(tmp_path / "prices.xlsx"), SERIES)


def test_a_workbook_with_real_times_and_numbers_is_read(tmp_path):
    openpyxl = pytest.importorskip("openpyxl", reason="openpyxl (extra market) is not installed")
    book = openpyxl.Workbook()
    book.active.append(["Zeit", "Preis [EUR/MWh]"])
    for time, value in SERIES.items():
        book.active.append([time.tz_localize(None).to_pydatetime() + pd.Timedelta(microseconds=3), value])
    book.save(tmp_path / "prices.xlsx")
    equal(bess.read_prices(tmp_path / "prices.xlsx", time_zone="UTC"), SERIES)
    (tmp_path / "cut.xlsx").write_bytes((tmp_path / "prices.xlsx").read_bytes()[:3000])
    with pytest.raises(bess.InputError, match="damaged or truncated"):
        bess.read_prices(tmp_path / "cut.xlsx")


# --- JSON --------------------------------------------------------------------------------------------------


def test_json_of_web_services_is_read(tmp_path):
    seconds = [int(t.timestamp()) for t in SERIES.index]
    charts = {"license_info": "CC BY", "unix_seconds": seconds, "price": SERIES.tolist(), "unit": "EUR / MWh"}
    equal(bess.read_prices(write(tmp_path, json.dumps(charts))), SERIES)
    crowns = json.dumps(charts | {"unit": "SEK / MWh"})
    with pytest.raises(bess.InputError, match="another unit"):
        bess.read_prices(write(tmp_path, crowns))
    smard = {
        "meta_data": {"version": 1},
        "series": [[1000 * s, v] for s, v in zip(seconds, SERIES, strict=True)],
    }
    equal(bess.read_prices(write(tmp_path, json.dumps(smard))), SERIES)
    records = [
        {"HourUTC": f"{t:%Y-%m-%dT%H:%M:%S}", "PriceArea": "DE", "SpotPriceDKK": v * 7.45, "SpotPriceEUR": v}
        for t, v in SERIES.items()
    ]
    equal(bess.read_prices(write(tmp_path, json.dumps({"total": 5, "records": records[::-1]}))), SERIES)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"error": "no data"}', "is JSON without a list of times and values"),
        ('{"a": [1, 2', "begins like JSON but is damaged or truncated"),
        ("[" * 10_000, "damaged or truncated"),
        ("<!DOCTYPE html><html><body>log in</body></html>", "is a web page, not a table"),
        ('<?xml version="1.0"?><Publication_MarketDocument/>', "is XML, not a table"),
    ],
)
def test_documents_without_a_table_are_called_what_they_are(text, said, tmp_path):
    for read in (bess.read_prices, bess.read_weather, read_profile):
        with pytest.raises(bess.InputError, match=said):
            read(write(tmp_path, text))


def test_open_meteo_says_its_own_offset(tmp_path):
    times = pd.date_range("2024-06-01", periods=48, freq="h")
    degrees = np.round(15.0 + np.sin(np.arange(48.0)), 1)
    rows = [f"{t:%Y-%m-%dT%H:%M},{d}" for t, d in zip(times, degrees, strict=True)]
    text = (
        "latitude,longitude,elevation,utc_offset_seconds,timezone,timezone_abbreviation\n"
        "52.52,13.4,38.0,7200,Europe/Berlin,CEST\n\ntime,temperature_2m (°C)\n"
    )
    expected = pd.Series(degrees, index=times.tz_localize("UTC") - pd.Timedelta(hours=2))
    series = bess.read_weather(write(tmp_path, text + "\n".join(rows) + "\n"))
    equal(series, expected)
    assert not series.attrs["repairs"]
    document = {
        "latitude": 52.52, "utc_offset_seconds": 7200, "timezone": "Europe/Berlin",
        "hourly_units": {"time": "iso8601", "temperature_2m": "°C"},
        "hourly": {"time": [f"{t:%Y-%m-%dT%H:%M}" for t in times], "temperature_2m": degrees.tolist()},
    }  # fmt: skip
    equal(bess.read_weather(write(tmp_path, json.dumps(document))), expected)
    document["hourly_units"]["temperature_2m"] = "°F"
    with pytest.raises(bess.InputError, match="Fahrenheit"):
        bess.read_weather(write(tmp_path, json.dumps(document)))


# --- typical years -----------------------------------------------------------------------------------------

DEGREES = np.round(10.0 - 12.0 * np.cos(np.arange(8760) / 8760 * 2 * np.pi), 1)
MONTH_YEARS = dict(enumerate([2007, 2012, 2016, 2009, 2020, 2008, 2015, 2013, 2011, 2018, 2010, 2014], 1))


def pvgis_csv():
    head = [
        "Latitude (decimal degrees): 48.100",
        "Longitude (decimal degrees): 11.500",
        "Elevation (m): 525.0",
        "",
    ]
    months = ["month,year", *(f"{month},{year}" for month, year in MONTH_YEARS.items())]
    rows = [f"{MONTH_YEARS[t.month]}{t:%m%d:%H%M},{d},80.0,0.0" for t, d in zip(YEAR, DEGREES, strict=True)]
    legend = [
        "",
        "T2m: 2-m air temperature (degree Celsius)",
        "RH: relative humidity (%)",
        "PVGIS (c) European Union",
    ]
    return "\n".join([*head, *months, "time(UTC),T2m,RH,G(h)", *rows, *legend]) + "\n"


def pvgis_json():
    hours = [
        {"time(UTC)": f"{MONTH_YEARS[t.month]}{t:%m%d:%H%M}", "T2m": float(d), "RH": 80.0}
        for t, d in zip(YEAR, DEGREES, strict=True)
    ]
    months = [{"month": month, "year": year} for month, year in MONTH_YEARS.items()]
    return json.dumps({"inputs": {}, "outputs": {"months_selected": months, "tmy_hourly": hours}, "meta": {}})


def epw(offset_h=1.0):
    head = [f"LOCATION,Munich,BY,DEU,TMY,108660,48.13,11.70,{offset_h},529.0", "DESIGN CONDITIONS,0"]
    head += ["TYPICAL/EXTREME PERIODS,0", "GROUND TEMPERATURES,0", "HOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0"]
    head += ["COMMENTS 1,none", "COMMENTS 2,none", "DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31"]
    rows = [
        f"{MONTH_YEARS[t.month]},{t.month},{t.day},{t.hour + 1},60,?9?9,{d},3.1,80,95000,0,0"
        for t, d in zip(YEAR, DEGREES, strict=True)
    ]
    return "\n".join([*head, *rows]) + "\n"


def reference_year():
    head = ["Testreferenzjahr", "Rechtswert : 4321500 Meter", "Lufttemperatur 2 m [GradC]", ""]
    head += ["  RW      HW  MM DD HH     t    p  WR   WG N    x  RF    B    D   A    E IL", "***"]
    rows = [
        f"4321500 2716500 {t.month:2d} {t.day:2d} {t.hour + 1:2d} {d:5.1f} 950 240  3.2 8  4.1  90 0 0 9 -3 1"
        for t, d in zip(YEAR, DEGREES, strict=True)
    ]
    return "\n".join([*head, *rows]) + "\n"


def nsrdb():
    names = ["Source", "Location ID", "Latitude", "Longitude", "Time Zone", "Elevation", "Local Time Zone"]
    values = ["NSRDB", "1", "39.7", "-105.1", "-7", "1800", "-7"]
    rows = [
        f"{MONTH_YEARS[t.month]},{t.month},{t.day},{t.hour},0,{d},0,0"
        for t, d in zip(YEAR, DEGREES, strict=True)
    ]
    head = [",".join(names), ",".join(values), "Year,Month,Day,Hour,Minute,Temperature,DHI,DNI"]
    return "\n".join([*head, *rows]) + "\n"


TYPICAL = {
    "pvgis csv": (pvgis_csv, 0), "pvgis json": (pvgis_json, 0), "epw": (epw, 1),
    "reference year": (reference_year, 1), "nsrdb": (nsrdb, -7),
}  # fmt: skip


@pytest.mark.parametrize("form", TYPICAL)
def test_a_typical_year_is_read_with_its_clock_and_laid_onto_any_year(form, tmp_path):
    writer, offset_h = TYPICAL[form]
    series = bess.read_weather(write(tmp_path, writer()))
    assert series.attrs["typical_year"]
    np.testing.assert_allclose(series, DEGREES)
    year = series.index[4380].year
    assert series.index[0] == pd.Timestamp(year, 1, 1, tz="UTC") - pd.Timedelta(hours=offset_h)
    first, last = pd.Timestamp("2024-02-27", tz="UTC"), pd.Timestamp("2025-03-02", tz="UTC")
    laid = over_years(series, first, last)
    for time in (
        "2024-02-28 12:00",
        "2024-03-01 00:00",
        "2024-12-31 23:00",
        "2025-01-01 01:00",
        "2025-03-01 05:00",
    ):
        there = pd.Timestamp(time, tz="UTC")
        twin = there.tz_localize(None).replace(year=2023) + pd.Timedelta(hours=offset_h)
        assert laid[there] == DEGREES[int((twin - YEAR[0]) / pd.Timedelta(hours=1)) % 8760], time
    assert laid["2024-02-29 07:00+00:00"] == laid["2024-02-28 07:00+00:00"]


def test_the_8760_hours_of_a_leap_year_are_a_typical_year(tmp_path):
    text = "".join(
        line.replace(line[:5], "2016,", 1) if line[:2] == "20" else line for line in epw().splitlines(True)
    )
    series = bess.read_weather(write(tmp_path, text))
    np.testing.assert_allclose(series, DEGREES)
    assert series.attrs["typical_year"] and not series.attrs["repairs"]


def test_a_study_runs_in_any_year_on_a_typical_one(tmp_path):
    path = write(tmp_path, epw(), "munich.epw")
    values = {
        "policy.name": "equal",
        "run.days": 1,
        "run.start": "2028-02-29T00:00:00Z",
        "weather.file": str(path),
    }
    ambient = bess.run(bess.load_study("case1", values), progress=False).dataset["ambient_c"].values
    assert ambient[0] == DEGREES[31 * 24 + 27 * 24 + 1]


# --- load --------------------------------------------------------------------------------------------------


def test_load_of_entsoe_is_read_as_a_profile(tmp_path):
    index = truth("2024-03-30", "2024-04-01", 15).index
    local = index.tz_convert("Europe/Brussels").tz_localize(None)
    load = 45_000 + np.arange(index.size)
    rows = [
        f'"{t:%d.%m.%Y %H:%M} - {t + pd.Timedelta(minutes=15):%d.%m.%Y %H:%M}","{v + 100}","{v}"'
        for t, v in zip(local, load, strict=True)
    ]
    head = '"Time (CET/CEST)","Day-ahead Total Load Forecast [MW] - BZN|DE-LU",'
    head += '"Actual Total Load [MW] - BZN|DE-LU"'
    path = write(tmp_path, "\n".join([head, *rows]) + "\n")
    column = "Actual Total Load [MW] - BZN|DE-LU"
    series = read_profile(path, column=column, unit="MW", positive="charge", scale=1e-3)
    np.testing.assert_allclose(series, -load)
    assert (series.index == index).all()


def test_simbench_profiles_are_read(tmp_path):
    times = pd.date_range("2016-01-01", periods=96, freq="15min")
    rows = [f"{t:%d.%m.%Y %H:%M};{i / 100};{i / 200}" for i, t in enumerate(times)]
    path = write(tmp_path, "\n".join(["time;G0-A_pload;H0-A_pload", *rows]) + "\n")
    series = read_profile(path, column="H0-A_pload", scale=200.0, time_zone="UTC+1")
    np.testing.assert_allclose(series, np.arange(96.0))


def test_profiles_labelled_at_the_end_of_the_quarter_hour_are_moved_to_its_start(tmp_path):
    """Standard load profiles of German grid operators: day and clock apart, the last one 24:00."""
    ends = pd.date_range("2024-01-01 00:15", periods=192, freq="15min")
    rows = []
    for i, end in enumerate(ends):
        midnight = end.hour == end.minute == 0
        day = end - pd.Timedelta(days=1) if midnight else end
        rows.append(f"{day:%d.%m.%Y};{'24:00' if midnight else end.strftime('%H:%M')};{i},5")
    path = write(tmp_path, "\n".join(["Datum;Zeit;H0", *rows]) + "\n")
    series = read_profile(path, time_zone="UTC+1")
    np.testing.assert_allclose(series, np.arange(192) + 0.5)
    assert series.index[0] == pd.Timestamp("2023-12-31 23:00", tz="UTC")
    assert series.attrs["repairs"].rows("end-labels") == 192


@pytest.mark.parametrize("days", [("2024-03-30", "2024-04-02"), ("2024-10-26", "2024-10-29")])
@pytest.mark.parametrize("by_clock", [True, False])
def test_labels_at_the_end_are_read_across_both_changes_of_the_clock(tmp_path, days, by_clock):
    """The end as the clock shows it then (03:00 after 01:45 in spring), or the start and 15 min (02:00)."""
    first, last = days
    starts = pd.date_range(first, last, freq="15min", tz="Europe/Berlin", inclusive="left")
    quarter = pd.Timedelta(minutes=15)
    ends = starts + quarter if by_clock else starts.tz_localize(None) + quarter
    rows = [f"{end:%d.%m.%Y %H:%M},{i}" for i, end in enumerate(ends)]
    series = read_profile(write(tmp_path, "\n".join(["time,power", *rows]) + "\n"), time_zone="Europe/Berlin")
    assert (series.index == starts.tz_convert("UTC")).all()
    np.testing.assert_array_equal(series, np.arange(starts.size))


# --- messages ----------------------------------------------------------------------------------------------


def test_a_market_without_euros_and_a_wide_table_are_refused_in_a_short_sentence(tmp_path):
    rows = [f"NSW1,{t:%Y/%m/%d %H:%M:%S},8000.1,{v},TRADE" for t, v in SERIES.items()]
    path = write(tmp_path, "\n".join(["REGION,SETTLEMENTDATE,TOTALDEMAND,RRP,PERIODTYPE", *rows]) + "\n")
    with pytest.raises(bess.InputError) as caught:
        bess.read_prices(path)
    assert "swapped" not in str(caught.value) and "AUD/MWh" in str(caught.value)
    wide = pd.DataFrame({f"a column with a rather long name {i}": SERIES for i in range(1500)})
    wide.head(10).to_csv(tmp_path / "wide.csv", index_label="time")
    with pytest.raises(bess.InputError, match="and 1480 more") as caught:
        bess.read_prices(tmp_path / "wide.csv")
    assert len(str(caught.value)) < 2500


def test_a_header_of_other_width_than_its_rows_is_said_to_be_so(tmp_path):
    rows = [f"{t:%Y-%m-%dT%H:%MZ},{v}" for t, v in SERIES.items()]
    path = write(tmp_path, "\n".join(["time,price,remark", *rows]) + "\n")
    with pytest.raises(bess.InputError, match="line 2: has 2 cells where the header has 3 columns"):
        bess.read_prices(path)


def test_the_archive_of_several_tables_lists_them(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for i in range(40):
            archive.writestr(f"{i}.csv", "x")
    with pytest.raises(bess.InputError, match=r"holds 40 files \(0\.csv, .* and 20 more\); unpack"):
        bess.read_prices(tmp_path / "a.zip")
