"""Writers of synthetic exports like those of the platforms: from a known series to the text of a file."""

import numpy as np
import pandas as pd

BERLIN = "Europe/Berlin"


def truth(first: str, last: str, minutes: int, clock: str = BERLIN, seed: int = 1) -> pd.Series:
    """Prices in cents, negative and above a thousand too, for whole local days `first` to `last`."""
    end = pd.Timestamp(last, tz=clock) + pd.DateOffset(days=1)
    index = pd.date_range(
        pd.Timestamp(first, tz=clock), end, freq=f"{minutes}min", inclusive="left"
    ).tz_convert("UTC")
    cents = np.random.default_rng(seed).integers(-50_000, 250_000, index.size)
    return pd.Series(cents / 100.0, index=index)


def german(value: float, *, stripped: bool = False) -> str:
    """1234.5 as 1.234,50, or as a spreadsheet keeps it: 1234,5."""
    if np.isnan(value):
        return "-"
    if stripped:
        return f"{value:.2f}".rstrip("0").rstrip(".").replace(".", ",")
    return f"{value:,.2f}".translate(str.maketrans(",.", ".,"))


def english(value: float) -> str:
    """1234.5 as 1,234.5."""
    return "-" if np.isnan(value) else f"{value:,.2f}".rstrip("0").rstrip(".")


def _ends(wall: pd.DatetimeIndex) -> pd.DatetimeIndex:
    """Ends of the intervals; that before the hour skipped in spring is a day early, as in SMARD."""
    step = wall[1] - wall[0]
    ends = [*wall[1:], wall[-1] + step]
    ends = [
        b if b == a + step or b <= a else a + step - pd.Timedelta(days=1)
        for a, b in zip(wall, ends, strict=True)
    ]
    return pd.DatetimeIndex(ends)


def smard_de(series: pd.Series, zones: dict[str, pd.Series] | None = None, *, stripped: bool = False) -> str:
    zones = zones or {
        "Deutschland/Luxemburg": series,
        "∅ Anrainer DE/LU": series + 1,
        "Dänemark 1": series * np.nan,
    }
    wall = series.index.tz_convert(BERLIN).tz_localize(None)
    rows = ["Datum von;Datum bis;" + ";".join(f"{z} [€/MWh] Berechnete Auflösungen" for z in zones)]
    for i, (a, b) in enumerate(zip(wall, _ends(wall), strict=True)):
        prices = ";".join(german(z.iloc[i], stripped=stripped) for z in zones.values())
        rows.append(f"{a:%d.%m.%Y %H:%M};{b:%d.%m.%Y %H:%M};{prices}")
    return "\n".join(rows) + "\n"


def smard_de_day_and_clock(series: pd.Series) -> str:
    wall = series.index.tz_convert(BERLIN).tz_localize(None)
    rows = [
        "Datum;Anfang;Ende;Deutschland/Luxemburg [€/MWh] Originalauflösungen;"
        "Österreich [€/MWh] Originalauflösungen"
    ]
    rows += [f"{a:%d.%m.%Y};{a:%H:%M};{b:%H:%M};{german(v)};{german(v + 1)}"
             for a, b, v in zip(wall, _ends(wall), series, strict=True)]  # fmt: skip
    return "\n".join(rows) + "\n"


def _american(time: pd.Timestamp) -> tuple[str, str]:
    return f"{time:%b} {time.day}, {time.year}", f"{time.hour % 12 or 12}:{time:%M %p}"


def smard_en(series: pd.Series) -> str:
    wall = series.index.tz_convert(BERLIN).tz_localize(None)
    rows = [
        "Start date;End date;Germany/Luxembourg [€/MWh] Original resolutions;"
        "Austria [€/MWh] Original resolutions"
    ]
    rows += [";".join((" ".join(_american(a)), " ".join(_american(b)), english(v), english(v + 1)))
             for a, b, v in zip(wall, _ends(wall), series, strict=True)]  # fmt: skip
    return "\n".join(rows) + "\n"


def smard_en_old(series: pd.Series) -> str:
    wall = series.index.tz_convert(BERLIN).tz_localize(None)
    rows = ["Date;Time of day;Germany/Luxembourg[€/MWh];Denmark 1[€/MWh]"]
    rows += [";".join((*_american(a), english(v), "-")) for a, v in zip(wall, series, strict=True)]
    return "\n".join(rows) + "\n"


def energy_charts(
    series: pd.Series, *, german_ui: bool = False, wrong: tuple[int, ...] = (), zone: str = ""
) -> str:
    """Day-ahead with offsets; the rows `wrong` have an offset of one hour too much."""
    local = series.index.tz_convert(BERLIN)
    name = ("Day Ahead Auktion" if german_ui else "Day Ahead Auction") + zone
    date, power = ("Datum (GMT+1)", "Leistung (MW)") if german_ui else ("Date (GMT+1)", "Power (MW)")
    price = '"Preis (EUR/MWh, EUR/tCO2)"' if german_ui else '"Price (EUR/MWh, EUR/tCO2)"'
    rows = [f"{date},{'Kernenergie' if german_ui else 'Nuclear'},{name}", f",{power},{price}"]
    for i, (time, value) in enumerate(zip(local, series, strict=True)):
        offset = int(time.utcoffset().total_seconds() // 3600) + (i in wrong)
        rows.append(
            f"{time:%Y-%m-%dT%H:%M}{offset:+03d}:00,{2000 + i % 7},{'' if np.isnan(value) else value}"
        )
    return "\n".join(rows)


def energy_charts_intraday(series: pd.Series, stray: str = "01/01/2022 00:00,,,69.66,,\n") -> str:
    wall = (series.index + pd.Timedelta(hours=1)).tz_localize(None)
    head = "Intraday {} 15 minute"
    rows = [f"Date,Load,{head.format('Auction')} call,{head.format('Continuous')}s ID3-Price,"
            f"{head.format('Continuous')}s ID1-Price,"]  # fmt: skip
    rows += [
        f"{t:%d/%m/%Y %H:%M},,{v - 1:.2f},{v - 2:.2f},{v:.2f}," for t, v in zip(wall, series, strict=True)
    ]
    return "\n".join(rows) + "\n" + stray


def entsoe_old(series: pd.Series) -> str:
    """With an empty row for the hour that summer time skips, and one row too many at the end."""
    wall = series.index.tz_convert(BERLIN).tz_localize(None)
    step = series.index[1] - series.index[0]
    rows = ['"MTU (CET)","Day-ahead Price [EUR/MWh]"']

    def row(begin: pd.Timestamp, value: str) -> str:
        return f'"{begin:%d.%m.%Y %H:%M} - {begin + step:%d.%m.%Y %H:%M}","{value}"'

    for i, begin in enumerate(wall):
        if i and begin - wall[i - 1] > step:
            rows += [
                row(t, "") for t in pd.date_range(wall[i - 1] + step, begin, freq=step, inclusive="left")
            ]
        rows.append(row(begin, f"{series.iloc[i]:.2f}"))
    rows.append(row(wall[-1] + step, f"{series.iloc[-1]:.2f}"))
    return "\n".join(rows) + "\n"


def entsoe_new(areas: dict[str, pd.Series], clock: str = BERLIN, sequence: str = "Without Sequence") -> str:
    """With (CET) and (CEST) where the offset changes in or beside an interval; one area below the other."""
    label = "UTC" if clock == "UTC" else "CET/CEST"
    rows = [f'"MTU ({label})","Area","Sequence","Day-ahead Price (EUR/MWh)","Intraday Period ({label})",'
            '"Intraday Price (EUR/MWh)"']  # fmt: skip
    for area, series in areas.items():
        local = series.index.tz_convert(clock)
        step = np.diff(series.index, append=[series.index[-1] + (series.index[-1] - series.index[-2])])
        for i, begin in enumerate(local):
            end = begin + step[i] if i < len(step) - 1 else begin + (local[-1] - local[-2])
            texts = []
            for time in (begin, end):
                near = any((time + pd.Timedelta(hours=h)).utcoffset() != time.utcoffset() for h in (-1, 0.25))
                mark = f" ({'CEST' if time.dst() else 'CET'})" if near and clock != "UTC" else ""
                texts.append(f"{time:%d/%m/%Y %H:%M:%S}{mark}")
            value = "" if np.isnan(series.iloc[i]) else f"{series.iloc[i]:.2f}"
            rows.append(f'"{" - ".join(texts)}","{area}","{sequence}","{value}","",""')
    return "\n".join(rows) + "\n"
