"""Files that are no tables of a header and rows as they stand: rewritten into one, with the lines kept.

- EPW (EnergyPlus weather): no names of columns, hours 1 to 24 of a standard time given in the first line.
- Test reference years of the German weather service: columns of blanks below a block that ends with ``***``,
  hours 1 to 24, UTC+1.
- ``marginalpdbc`` of OMIE: year, month, day, period of the local day, prices of Portugal and Spain.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable
from datetime import datetime, timedelta
from typing import Final

import pandas as pd

from bess.market.files import fail
from bess.market.table import Ending, Table

_NOMINAL_YEAR: Final = 2001
"""Year of a typical year that names none, or several: not a leap year."""
_EPW_TEMPERATURE: Final = 6
_EPW_TIME_ZONE: Final = 8
_OMIE: Final = "MARGINALPDBC"
_OMIE_CLOCK: Final = "Europe/Madrid"
_MOST_HOURS: Final = 25
_TRY_HEADER: Final = re.compile(r"^\s*(?:RW\s+HW|RG\s+IS)\s+MM\s+DD\s+HH\s", re.MULTILINE)

Line = tuple[int, list[str]]


def rewritten(path: str, text: str) -> Table | None:
    """Return the table of a file of one of these layouts, None for any other file."""
    for matches, read in _LAYOUTS:
        if matches(text):
            return read(path, text)
    return None


def _epw(path: str, text: str) -> Table:
    head = text.split("\n", 1)[0].split(",")
    try:
        offset_h = float(head[_EPW_TIME_ZONE])
    except (IndexError, ValueError):
        fail(path, 1, "the line LOCATION has no time zone in its ninth cell; fetch the file again")
    rows = [
        (line, cells)
        for line, cells in _split(text, ",")
        if re.fullmatch(r"\d{4}", cells[0]) and len(cells) > 9
    ]
    dates = [(line, cells[:4], cells[_EPW_TEMPERATURE]) for line, cells in rows]
    return _hours_of_a_year(path, text, dates, offset_h)


def _reference_year(path: str, text: str) -> Table:
    header = _TRY_HEADER.search(text)
    assert header is not None
    names = text[header.start() :].lstrip().split("\n", 1)[0].split()
    month, day, hour, temperature = (names.index(name) for name in ("MM", "DD", "HH", "t"))
    below = text.count("\n", 0, header.start())
    dates = [
        (line, [str(_NOMINAL_YEAR), cells[month], cells[day], cells[hour]], cells[temperature])
        for line, cells in _split(text, None)
        if line > below + 1 and len(cells) == len(names) and cells[0].isdigit()
    ]
    return _hours_of_a_year(path, text, dates, 1.0)


def _hours_of_a_year(path: str, text: str, dates: list[tuple[int, list[str], str]], offset_h: float) -> Table:
    """Return times at the start of each hour, the hours being numbered by their ends."""
    if not dates:
        fail(path, 1, "there is a header but no rows of hours; fetch the file again")
    years = {cells[0] for _, cells, _ in dates}
    nominal = int(years.pop()) if len(years) == 1 else _NOMINAL_YEAR
    minutes = round(60 * offset_h)
    label = f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"
    rows = []
    for line, (_, month, day, hour), value in dates:
        try:
            start = datetime(nominal, int(month), int(day)) + timedelta(hours=int(hour) - 1)
        except (ValueError, OverflowError):
            fail(
                path, line, f"month {month}, day {day}, hour {hour} is no hour of {nominal}; correct the row"
            )
        rows.append([f"{start:%Y-%m-%d %H:%M}{label}", value])
    return _table(path, text, ["time", "temperature_c"], [line for line, _, _ in dates], rows, typical=True)


def _omie(path: str, text: str) -> Table:
    lines = [(line, cells) for line, cells in _split(text, ";") if len(cells) >= 6 and cells[0].isdigit()]
    if not lines:
        fail(path, 1, f"there is nothing below {_OMIE}; fetch the file again")
    periods = Counter(tuple(cells[:3]) for _, cells in lines)
    rows = []
    for line, (year, month, day, number, portugal, spain, *_) in lines:
        step_min = 60 if periods[year, month, day] <= _MOST_HOURS else 15
        try:
            local = pd.Timestamp(int(year), int(month), int(day), tz=_OMIE_CLOCK)
            start = local.tz_convert("UTC") + pd.Timedelta(minutes=step_min * (int(number) - 1))
        except (ValueError, OverflowError):
            fail(path, line, f"{year};{month};{day};{number} is no period of a day; fetch the file again")
        rows.append([f"{start:%Y-%m-%dT%H:%M}Z", portugal, spain])
    header = ["time", "PT [EUR/MWh]", "ES [EUR/MWh]"]
    return _table(path, text, header, [line for line, _ in lines], rows)


def _split(text: str, separator: str | None) -> Iterable[Line]:
    """Cells of every line that is not empty."""
    for line, row in enumerate(text.splitlines(), 1):
        if row.strip():
            yield line, [cell.strip() for cell in row.split(separator)]


def _table(
    path: str, text: str, header: list[str], lines: list[int], rows: list[list[str]], *, typical: bool = False
) -> Table:
    ending = Ending.CLEAN if text.endswith(("\n", "\r")) else Ending.OPEN
    return Table(path, header, rows, lines, ";", ending, typical=typical)


_LAYOUTS: Final[tuple[tuple[Callable[[str], bool], Callable[[str, str], Table]], ...]] = (
    (lambda text: text.startswith("LOCATION,"), _epw),
    (lambda text: _TRY_HEADER.search(text[:20_000]) is not None, _reference_year),
    (lambda text: text.startswith(_OMIE), _omie),
)
