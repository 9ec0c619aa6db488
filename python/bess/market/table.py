"""Text files to tables: detects the separator and the header, and checks for rows of equal length."""

import csv
import gc
import io
import re
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from itertools import islice
from typing import Final, NoReturn

import pandas as pd

from bess.market.files import Repairs, decode, fail
from bess.market.json_tables import is_json, json_rows
from bess.market.layouts import rewritten
from bess.market.times import is_time
from bess.market.workbook import is_workbook, workbook_rows

_SEPARATORS: Final = (";", "\t", ",")
_SAMPLE: Final = 50
_DECIMALS: Final = re.compile(r"[.,](\d*)$")
_TITLE: Final = re.compile(r"\s*(time|timestamp|date|datetime|datum|zeit)\b", re.IGNORECASE)
_MAX_HEADER_ROW: Final = 20
_LABEL: Final = re.compile(r"\s*(BZN|CTY|CTA|SCA)\|")
_LETTER: Final = re.compile(r"\W*[^\W\d]")
_MAX_REMARK_SHARE: Final = 0.01
_LIKE_DATA: Final = re.compile(r"\W*\d")
_CLOCK: Final = re.compile(r"\d{1,2}:\d\d(:\d\d)?( ?- ?\d{1,2}:\d\d)?")
_MARKUP: Final = re.compile(r"\s*<[!?a-zA-Z]")

Numbered = list[tuple[int, list[str]]]
"""Cells of each row, with the line of the file in which the row ends (from 1)."""


class Ending(Enum):
    """End of a file: whether the last cell may be truncated."""

    CLEAN = "with a line break"
    ALIKE = "without a line break, with as many decimals as the numbers above"
    OPEN = "without a line break, and nothing tells whether in the middle of a number"
    CUT = "in the middle of a number"

    @staticmethod
    def of(text: str, cells: list[str]) -> "Ending":
        """Assess the last cell of a file without a final line break by the decimals of the cells above it."""
        if text.endswith(("\n", "\r")):
            return Ending.CLEAN
        *others, last = (len(found[1]) if (found := _DECIMALS.search(cell)) else 0 for cell in cells)
        if not others or max(others) == 0:
            return Ending.OPEN
        if last >= max(others):
            return Ending.ALIKE
        return Ending.CUT if min(others) == max(others) else Ending.OPEN


@dataclass(frozen=True)
class Table:
    """Cells as text: stripped column names, and rows with at least as many cells.

    `lines` are the line numbers of the row ends, `preamble` the rows above the header; `typical` marks a
    typical year.
    """

    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    separator: str = ","
    ending: Ending = Ending.CLEAN
    preamble: list[list[str]] = field(default_factory=list)
    typical: bool = False

    def column(self, index: int) -> pd.Series:
        """Return the stripped cells of one column by line."""
        cells = [row[index].strip() for row in self.rows]
        return pd.Series(cells, index=self.lines, name=self.header[index], dtype=object)

    def named(self, *names: str) -> int | None:
        """Return the index of the first column with one of `names`, in their order, ignoring case."""
        lowered = [name.casefold() for name in self.header]
        return next((lowered.index(name.casefold()) for name in names if name.casefold() in lowered), None)


def read_table(raw: bytes, repairs: Repairs) -> Table:
    """Return the table in a text, a JSON document or a workbook; raise InputError without one."""
    if is_workbook(raw):
        return _table(workbook_rows(raw), ",", "\n", repairs)
    text = decode(raw, repairs)
    if is_json(text):
        return _table(json_rows(text), ",", "\n", repairs)
    if _MARKUP.match(text):
        kind = "a web page" if "html" in text[:200].casefold() else "XML"
        fail(1, f"is {kind}, not a table; export the data as CSV")
    cells = rewritten(text)
    if cells is None:
        return _text_table(text, repairs)
    ending = Ending.CLEAN if text.endswith(("\n", "\r")) else Ending.OPEN
    header, rows, lines = cells.columns.tolist(), cells.to_numpy().tolist(), cells.index.tolist()
    return Table(header, rows, lines, ";", ending, typical="typical" in cells.attrs)


def _text_table(text: str, repairs: Repairs) -> Table:
    separator = _separator(text)
    if separator is None:
        text = _unwrapped(text)
        separator = _separator(text)
        if separator is None:
            fail(1, "has no columns: neither semicolon, tab nor comma separates it; save the file as CSV")
        repairs.add("quoted-lines", "every line was one quoted cell", text.count("\n"))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    collects = gc.isenabled()
    gc.disable()  # the collector would scan millions of rows repeatedly, without result
    try:
        numbered = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        fail(reader.line_num, f"cannot be split into cells ({error}); fetch the file again")
    finally:
        if collects:
            gc.enable()
    return _table(numbered, separator, text, repairs)


def _table(numbered: Numbered, separator: str, text: str, repairs: Repairs) -> Table:
    """Find the header, the rows below it, and the lines above it."""
    numbered = [
        (line, row) for line, row in numbered if "".join(row).strip() and not row[0].startswith(("#", "sep="))
    ]
    if not numbered:
        fail(1, "the file holds no rows; fetch it again")
    _check_dates([cell.strip() for _, row in numbered[-3:] for cell in row])
    start = _header(numbered, separator)
    header = [cell.strip() for cell in numbered[start][1]]
    if header[0] and _is_data(header):
        header, start = [f"column {i + 1}" for i in range(len(header))], start - 1
    while header and not header[-1]:
        header.pop()
    body = _without_footer(numbered[start + 1 :], len(header), repairs)
    if not body:
        fail(numbered[start][0], "is the last one: there is a header but no data; fetch the file again")
    ending = Ending.of(text, [row[-1].strip() for _, row in body])
    if _LABEL.match(header[-1]) and {len(row) for _, row in body[: len(body) - 1 or 1]} == {len(header) - 1}:
        body = [(line, [*row, ""]) for line, row in body]
    _check_widths(body, len(header), repairs)
    rows, lines = [row for _, row in body], [line for line, _ in body]
    preamble = [[cell.strip() for cell in row] for _, row in numbered[: max(start, 0)]]
    return Table(header, rows, lines, separator, ending, preamble)


def _check_widths(body: Numbered, columns: int, repairs: Repairs) -> None:
    """Refuse rows of another width, except for a few with a remark beside the table."""
    remarks = []
    for line, row in body:
        if len(row) == columns:
            continue
        if len(row) < columns and line == body[-1][0]:
            text = f"ends after {len(row)} of {columns} columns: the file is truncated; fetch it again"
            fail(line, text)
        beyond = [cell.strip() for cell in row[columns:] if cell.strip()]
        if len(row) < columns or any(map(_LIKE_DATA.match, beyond)):
            _ragged(line, len(row), columns)
        remarks += [line] if beyond else []
    if len(remarks) > max(1, _MAX_REMARK_SHARE * len(body)):
        _ragged(remarks[0], columns + 1, columns)
    repairs.add("remark", "left out a remark beside the table", len(remarks), remarks[0] if remarks else None)


def _check_dates(cells: list[str]) -> None:
    """Raise InputError for tables by season and day type, such as standard load profiles."""
    if any(map(_CLOCK.fullmatch, cells)) and not any(map(is_time, cells)):
        fail(
            None,
            "has times of day without dates, as has a standard load profile by season or month and kind of "
            "day; make a series of it for the days of the run: for every date take the column of its season "
            "or month and kind of day, with public holidays as Sundays, and write a column of times and one "
            "of power",
        )


def _without_footer(body: Numbered, columns: int, repairs: Repairs) -> Numbered:
    """Remove text lines below the table, such as a legend: other width, initial letter."""
    end = len(body)
    while end > 1 and len(body[end - 1][1]) != columns and _LETTER.match(body[end - 1][1][0]):
        end -= 1
    last = body[-1][0] if body else None
    repairs.add("footer", "left out lines of text below the table", len(body) - end, last)
    return body[:end]


def _separator(text: str) -> str | None:
    """Return the separator with which most of the first lines have the same number (> 1) of cells."""

    def share(separator: str) -> float:
        sample = io.StringIO(text, newline="")
        counts = Counter(map(len, islice(csv.reader(sample, delimiter=separator), _SAMPLE)))
        cells, lines = max(counts.items(), key=lambda item: item[1])
        return lines / counts.total() if cells > 1 else 0.0

    try:
        best = max(_SEPARATORS, key=share)
        return best if share(best) > 0.0 else None
    except csv.Error:
        return None


def _unwrapped(text: str) -> str:
    """Undo a spreadsheet that has quoted each line as one cell."""
    lines = text.splitlines()
    plain = (line[1:-1].replace('""', '"') if line[:1] == line[-1:] == '"' else line for line in lines)
    return "\n".join(plain) + "\n"


def _header(numbered: Numbered, separator: str) -> int:
    """Return the index of the header: the first row as wide as most rows; a preamble may come before it."""
    width = Counter(len(row) for _, row in numbered[:_SAMPLE]).most_common(1)[0][0]
    start = next(i for i, (_, row) in enumerate(numbered) if len(row) == width)
    if start == 1 and len(numbered[0][1]) == width + 1 and _LABEL.match(numbered[0][1][-1]):
        return 0  # ENTSO-E names the zone in the header, with no cell below
    below = numbered[start + 1 : start + _MAX_HEADER_ROW]
    titled = (i for i, (_, row) in enumerate(below, start + 1) if len(row) == width and _TITLE.match(row[0]))
    if (found := next(titled, None)) is not None:
        return found  # the rows above it have the same width by chance
    for _, row in numbered[:start]:
        split_otherwise = (separator.join(row).count(other) + 1 for other in _SEPARATORS)
        if _is_data(numbered[start][1]) or width in split_otherwise:
            _ragged(numbered[start][0], width, len(row))
    return start


def _is_data(row: list[str]) -> bool:
    return sum(bool(_LIKE_DATA.match(cell)) for cell in row) * 2 > sum(map(bool, row))


def _ragged(line: int, cells: int, columns: int) -> NoReturn:
    fail(
        line,
        f"has {cells} cells where the header has {columns} columns: wrong or mixed separator; "
        "separate header and rows alike, by a character that numbers do not use",
    )
