"""Files that were once read into plausible wrong numbers: refused now, or read as they are meant."""

import io
import zipfile

import numpy as np
import pandas as pd
import pytest

import bess
from bess.dispatch import read_profile
from bess.market.units import foreign_unit

HOURS = pd.date_range("2024-01-30", periods=72, freq="h", tz="UTC")
DEGREES = np.round(np.sin(np.arange(72.0)) * 10.0, 1)


def write(folder, text, name="table.csv"):
    path = folder / name
    path.write_text(text)
    return path


def table(values, column="price", times=HOURS, form="%Y-%m-%dT%H:%MZ", end="\n"):
    rows = [f"{time.strftime(form)},{value}" for time, value in zip(times, values, strict=False)]
    return "\n".join([f"time,{column}", *rows]) + end


# --- the German weather service ----------------------------------------------------------------------------


def station_hourly() -> str:
    """An hourly product of a station: blanks around cells, -999, and the end of each row marked."""
    rows = [
        f"{1078:11d};{t:%Y%m%d%H};{3:5d};{d:7.1f};{80.0:7.1f};eor"
        for t, d in zip(HOURS, DEGREES, strict=True)
    ]
    rows[5] = f"{1078:11d};{HOURS[5]:%Y%m%d%H};{3:5d};{-999:7d};{-999:7d};eor"
    return "\n".join(["STATIONS_ID;MESS_DATUM;QN_9;TT_TU;RF_TU;eor", *rows]) + "\n"


def test_hours_of_a_station_are_hours_and_not_minutes(tmp_path):
    series = bess.read_weather(write(tmp_path, station_hourly(), "produkt_tu_stunde_20240130_01078.txt"))
    assert (series.index == HOURS).all()
    known = np.arange(72) != 5
    np.testing.assert_allclose(series[known], DEGREES[known])
    assert series.attrs["repairs"].rows("gap-filled") == 1


def test_the_archive_of_a_station_is_read_as_it_was_downloaded(tmp_path):
    path = tmp_path / "stundenwerte_TU_01078_akt.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("Metadaten_Geographie_01078.txt", "Stations_id;Stationshoehe\n1078;37\n")
        archive.writestr("Metadaten_Parameter_tu_stunde_01078.html", "<html></html>")
        archive.writestr("produkt_tu_stunde_20240130_20240201_01078.txt", station_hourly())
    assert (bess.read_weather(path).index == HOURS).all()


@pytest.mark.parametrize(
    ("form", "freq"), [("%Y%m%d%H", "h"), ("%Y%m%d%H%M", "10min"), ("%Y%m%d%H%M%S", "15min")]
)
def test_times_of_digits_only_are_read_by_their_number(form, freq, tmp_path):
    times = pd.date_range("2024-11-11 11:00", periods=50, freq=freq, tz="UTC")
    text = table(np.arange(50) / 10, "temperature", times, form)
    assert (bess.read_weather(write(tmp_path, text)).index == times).all()


@pytest.mark.parametrize("milli", ["", "000"])
def test_times_counted_since_1970_are_read_in_utc(milli, tmp_path):
    rows = [f"{int(t.timestamp())}{milli},{d},0" for t, d in zip(HOURS, DEGREES, strict=True)]
    text = "\n".join(["time,temperature_2m (°C),rain (mm)", *rows]) + "\n"
    series = bess.read_weather(write(tmp_path, text))
    assert (series.index == HOURS).all() and series.tolist() == DEGREES.tolist()


def test_most_of_a_series_is_never_invented(tmp_path):
    times = pd.DatetimeIndex(["2024-01-01", "2024-01-01 01:00", "2024-01-01 02:00", "2024-07-01"], tz="UTC")
    for fill in (None, "interpolate", "previous", "previous_day"):
        with pytest.raises(bess.InputError, match=r"line 5: follows a gap of 4365 h.*only 4 of 4369 steps"):
            bess.read_weather(write(tmp_path, table([1, 2, 3, 4], "temperature", times)), fill=fill)


def test_two_centuries_of_seconds_are_refused_before_they_are_laid_out(tmp_path):
    times = [*pd.date_range("1980-01-01", periods=9, freq="s"), pd.Timestamp("2199-12-31")]
    with pytest.raises(bess.InputError, match=r"line 11: follows a gap of .*only 10 of 69\d+ steps"):
        bess.read_weather(write(tmp_path, table(range(10), "temperature", times, "%Y-%m-%dT%H:%M:%SZ")))


# --- day or month first ------------------------------------------------------------------------------------


def test_american_dates_within_the_first_twelve_days_are_not_months(tmp_path):
    times = pd.date_range("2024-03-01", "2024-03-09", freq="h", inclusive="left", tz="UTC")
    text = table(np.arange(times.size), times=times, form="%m/%d/%Y %H:%M")
    assert (bess.read_prices(write(tmp_path, text), time_zone="UTC").index == times).all()


def test_one_day_that_could_be_two_is_refused(tmp_path):
    times = pd.date_range("2024-03-04", periods=24, freq="h", tz="UTC")
    text = table(np.arange(24.0), times=times, form="%d/%m/%Y %H:%M")
    with pytest.raises(
        bess.InputError, match=r"line 2: '04/03/2024 00:00' could be either day or month first"
    ):
        bess.read_prices(write(tmp_path, text), time_zone="UTC")
    american = table(np.arange(24.0), times=times, form="%m/%d/%Y %I:%M %p")
    assert (bess.read_prices(write(tmp_path, american), time_zone="UTC").index == times).all()


# --- currencies and units ----------------------------------------------------------------------------------

FOREIGN = [
    "price_usd_per_mwh",
    "price_gbp_mwh",
    "SpotPriceDKK",
    "AUD/MWh",
    "TRY/MWh",
    "price_pln",
    "Preis_ct",
    "ct/kWh",
    "EUR/kWh",
    "eur_per_kwh",
    "price [£/MWh]",
    "$/MWh",
    "kr/MWh",
    "öre/kWh",
    "p/kWh",
    "zł/MWh",
    "Preis (CHF/MWh)",
    "PriceSEK",
    "DKKperMWh",
    "USDMWh",
    "Cent/kWh",
    "€/GWh",
    "price_all_per_mwh",
    "priceInNok",
    "JPY/kWh",
    "price (MWh)",
    "RON/MWh",
    "Kč/MWh",
    "Ft/MWh",
    "INR",
    "лв/MWh",
]
EUROS = [
    "EUR/MWh",
    "price_eur_mwh",
    "SpotPriceEUR",
    "Preis in €/MWh",
    "Day-ahead (EUR/MWh)",
    "DE-LU [EUR/MWh]",
    "EURMWh",
    "Euro je MWh",
]
SILENT = ["price", "Preis", "top price", "all zones", "spot", "value", "Prezzo", "Marginal price", "centre"]


@pytest.mark.parametrize("column", FOREIGN)
def test_prices_in_another_unit_are_refused(column, tmp_path):
    with pytest.raises(bess.InputError, match=r"line 1: column .* is in another unit \(.*convert it first"):
        bess.read_prices(write(tmp_path, table(DEGREES, column)))


@pytest.mark.parametrize("column", EUROS + SILENT)
def test_prices_in_euros_are_read_and_a_unit_that_was_assumed_is_reported(column, tmp_path):
    assert foreign_unit(column) is None
    series = bess.read_prices(write(tmp_path, table(DEGREES, column)), zone=column)
    assert series.attrs["repairs"].rows("assumed-unit") == (72 if column in SILENT else 0)


def test_a_column_of_currencies_is_believed(tmp_path):
    rows = [f"{t:%Y-%m-%dT%H:%MZ},{v},GBP" for t, v in zip(HOURS, DEGREES, strict=True)]
    path = write(tmp_path, "\n".join(["time,price,Currency", *rows]) + "\n")
    with pytest.raises(bess.InputError, match=r"line 2: prices are in GBP by column 'Currency'"):
        bess.read_prices(path, zone="price")


@pytest.mark.parametrize(
    ("column", "said"), [("P [MW]", "MW"), ("power_mw", "MW"), ("P_W", "W"), ("Last (kWh)", "kWh")]
)
def test_a_profile_in_another_unit_than_said_is_refused(column, said, tmp_path):
    path = write(tmp_path, table(DEGREES, column))
    with pytest.raises(bess.InputError, match=rf"column .* is in {said}, not in kW; give"):
        read_profile(path)
    if said != "kWh":
        assert len(read_profile(path, unit=said)) == 288


@pytest.mark.parametrize("column", ["price_eur_mwh", "Preis [EUR/MWh]", "SpotPriceDKK", "price_eur"])
def test_a_column_of_prices_is_no_profile(column, tmp_path):
    with pytest.raises(bess.InputError, match=r"line 1: column .* holds prices, not power in kW; give a"):
        read_profile(write(tmp_path, table(DEGREES, column)))


@pytest.mark.parametrize("column", ["temperature_f", "Temp (°F)", "Dry Bulb Temperature {F}"])
def test_weather_in_fahrenheit_is_refused(column, tmp_path):
    with pytest.raises(bess.InputError, match="is in degrees Fahrenheit"):
        bess.read_weather(write(tmp_path, table(DEGREES, column)), column=column)


# --- cut, infinite, missing --------------------------------------------------------------------------------

PRICES = [f"{45.12 + i / 100:.2f}" for i in range(40)]


@pytest.mark.parametrize("cut", [1, 2, 3, 4])
@pytest.mark.parametrize("rows", [3, 24, 40])
def test_a_plain_table_cut_in_the_middle_of_a_number_is_refused(rows, cut, tmp_path):
    text = table(PRICES[:rows], "price", end="")
    bess.read_prices(write(tmp_path, text))  # whole, if without a line break
    with pytest.raises(bess.InputError, match=rf"line {rows + 1}: .*in the middle of a number.*line break"):
        bess.read_prices(write(tmp_path, text[:-cut]))
    with pytest.raises(bess.InputError, match="in the middle of a number"):
        read_profile(write(tmp_path, text[:-cut].replace("price", "power")))


def test_integers_without_a_last_line_break_may_have_been_cut_within_a_day(tmp_path):
    with pytest.raises(bess.InputError, match="nothing tells whether in the middle of a number"):
        bess.read_prices(write(tmp_path, table([45, 46, 4], end="")))
    assert len(bess.read_prices(write(tmp_path, table([45, 46, 47], end="\n")))) == 3
    assert len(bess.read_prices(write(tmp_path, table(range(24), end="")))) == 24


@pytest.mark.parametrize("number", ["1e400", "-1e999", "1e13", "inf", "Infinity", "9" * 400])
def test_infinite_numbers_are_refused_where_they_stand(number, tmp_path):
    values = [str(v) for v in DEGREES]
    values[7] = number
    for read, column in (
        (bess.read_prices, "price"),
        (bess.read_weather, "temperature"),
        (read_profile, "power"),
    ):
        with pytest.raises(bess.InputError, match=r"line 9: .*(beyond 1e\+12|is not a number)"):
            read(write(tmp_path, table(values, column)))


@pytest.mark.parametrize("number", [np.inf, -np.inf, 1e300])
def test_infinite_numbers_of_parquet_are_refused_where_they_stand(number, tmp_path):
    frame = pd.DataFrame({"price": DEGREES}, index=HOURS)
    frame.iloc[7, 0] = number
    frame.to_parquet(tmp_path / "p.parquet")
    with pytest.raises(bess.InputError, match=r"line 8: .*beyond 1e\+12"):
        bess.read_prices(tmp_path / "p.parquet")


@pytest.mark.parametrize("minutes", [15, 30])
def test_a_missing_value_among_three_does_not_change_the_step(minutes, tmp_path):
    times = pd.date_range("2024-06-01", periods=3, freq=f"{minutes}min", tz="UTC")
    path = write(tmp_path, table(["10", "nan", "20"], "power", times))
    with pytest.raises(bess.InputError, match=rf"line 4: follows a gap of {minutes / 60:g} h"):
        read_profile(path)
    filled = read_profile(path, fill="interpolate", dt_h=minutes / 60)
    assert filled.tolist() == [10.0, 15.0, 20.0]
    series = bess.read_prices(path, zone="power")
    assert (series.index == times).all()
    assert series.attrs["repairs"].rows("gap-filled") == 1


def test_every_second_value_missing_is_not_a_coarser_profile(tmp_path):
    times = pd.date_range("2024-06-01", periods=41, freq="15min", tz="UTC")
    values = ["nan" if i % 2 else "10" for i in range(41)]
    with pytest.raises(bess.InputError, match=r"line 4: follows a gap of 0\.25 h"):
        read_profile(write(tmp_path, table(values, "power", times)))


def test_hours_among_quarter_hours_are_held_in_prices(tmp_path):
    times = pd.date_range("2024-06-01", periods=96, freq="15min", tz="UTC")
    values = ["" if i % 4 else str(i) for i in range(96)]
    series = bess.read_prices(write(tmp_path, table(values, times=times)))
    assert series.tolist() == [4.0 * i for i in range(24)]
    assert pd.read_csv(io.StringIO(table(values, times=times))).shape == (96, 2)


@pytest.mark.parametrize("broken", ["2024-01-30T12\x0100Z", "2024-01-30T1\u0662:00Z"])
def test_a_time_with_a_broken_character_is_an_error_and_not_a_warning(broken, tmp_path):
    text = table(DEGREES, "temperature_c").replace("2024-01-30T12:00Z", broken)
    with pytest.raises(bess.InputError, match="line 14"):
        bess.read_weather(write(tmp_path, text))


# --- an export up to now, fetched in the first days of a year -----------------------------------------------


def test_hours_of_new_year_up_to_now_are_a_part_of_the_day_and_no_strays(tmp_path):
    times = pd.date_range("2023-12-29", "2024-01-01 14:00", freq="h", tz="Europe/Berlin")
    rows = [f"{time:%d.%m.%Y %H:%M};{k},5" for k, time in enumerate(times)]
    text = "\n".join(["Datum von;Deutschland/Luxemburg [€/MWh]", *rows]) + "\n"
    series = bess.read_prices(write(tmp_path, text))
    assert (series.index == times).all()
    assert [repair.kind for repair in series.attrs["repairs"]] == ["part-of-a-day"]
