"""Standard load profiles as tables of days: a column for each season or month and kind of day, no dates."""

import re
from typing import Final

from bess.market.files import fail

_SEARCHED: Final = 400_000
"""Characters: such a table has 96 rows, or a few thousand if seasons stand below each other."""
_LAST_LINES: Final = 20


def _word(*words: str) -> re.Pattern[str]:
    return re.compile(rf"(?<![^\W\d_])(?:{'|'.join(words)})(?![^\W\d_])", re.IGNORECASE)


_DAYS: Final = (
    _word("samstage?", "saturdays?", "sat?"),
    _word("sonntage?", "sundays?", "sun?", "so", "ft", "feiertage?", "holidays?"),
    _word("werktage?", "wochentage?", "week_?days?", "work_?days?", "working days?", "wt"),
)
_SEASONS: Final = (_word("winter"), _word("sommer", "summer"))
_MONTHS: Final = (_word("januar", "january", "jan"), _word("juli", "july", "jul"))
_CLOCK: Final = re.compile(r"(?<![\d:])\d{1,2}:\d\d(?![\d])")
_DATE: Final = re.compile(r"(?:19[89]|2\d\d)\d-\d{1,2}-\d|\d{1,2}[./]\d{1,2}[./]\d\d|\d{4}/\d")
"""A date; a workbook keeps midnight as one of 1899 or 1900."""


def refuse_day_types(path: str, text: str) -> None:
    """Raise InputError for a table of days by season or month and kind of day: it has no dates."""
    searched = text[:_SEARCHED]
    last = "\n".join(searched.splitlines()[-_LAST_LINES:])
    if _DATE.search(last) or not _CLOCK.search(last):
        return
    named = [all(word.search(searched) for word in words) for words in (_DAYS, _SEASONS, _MONTHS)]
    if named[0] and any(named[1:]):
        periods = (
            "season (winter 1 November to 20 March, summer 15 May to 14 September, transition between)"
            if named[1]
            else "month"
        )
        fail(
            path,
            None,
            f"is a standard load profile as a table: one day for each {periods} and kind of day (weekday, "
            "Saturday, Sunday), without dates; make a series of it for the days of the run: for every date "
            "take the column of its period and kind of day, with public holidays as Sundays, scale it to the "
            "energy of a year, multiply household profiles by their factor of the day of the year "
            "(dynamisation), and write a column of times and one of power",
        )
