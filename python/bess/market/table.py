"""Text to a table of cells: separator, header, and rows of equal length."""

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from itertools import islice
from typing import Final

from bess.market.files import fail
from bess.market.repairs import Repairs

_SEPARATORS: Final = (";", "\t", ",")
_SAMPLE: Final = 50
_DECIMALS: Final = re.compile(r"[.,](\d*)$")
_TITLE: Final = re.compile(r"\s*(time|timestamp|date|datetime|datum|zeit)\b", re.IGNORECASE)
_DEEPEST_HEADER: Final = 20
_LABEL: Final = re.compile(r"\s*(BZN|CTY|CTA|SCA)\|")
_LETTER: Final = re.compile(r"\W*[^\W\d]")
_MOST_REMARKS: Final = 0.01
_LIKE_DATA: Final = re.compile(r"\W*\d")


class Ending(Enum):
    """How a file ends: its last cell cannot be trusted if the file was cut off in it."""

    CLEAN = "with a line break"
    ALIKE = "without a line break, with as many decimals as the numbers above"
    OPEN = "without a line break, and nothing tells whether in the middle of a number"
    CUT = "in the middle of a number"


@dataclass(frozen=True)
class Table:
    """Cells of a CSV file as text.

    Attributes
    ----------
    path : str
        For messages.
    header : list of str
        Column names, stripped; trailing columns without a name are cut.
    rows : list of list of str
        At least as many cells as the header.
    lines : list of int
        Line of the file in which each row ends (1-based).
    separator : str
    ending : Ending
        Whether the file ends where it should.
    preamble : list of list of str
        Rows above the header.
    typical : bool
        A typical year: its hours belong to no year in particular.
    """

    path: str
    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    separator: str
    ending: Ending
    preamble: list[list[str]] = field(default_factory=list)
    typical: bool = False

    def column(self, index: int) -> list[str]:
        """Return the stripped cells of one column."""
        return [row[index].strip() for row in self.rows]

    def named(self, *names: str) -> int | None:
        """Return the index of the first column with one of `names`, in their order, ignoring case."""
        lowered = [name.casefold() for name in self.header]
        return next((lowered.index(name.casefold()) for name in names if name.casefold() in lowered), None)


def text_table(path: str, text: str, repairs: Repairs) -> Table:
    """Split the text of a CSV file into cells; raise InputError where it is not a table."""
    separator = _separator(text)
    if separator is None:
        text = _unwrapped(text)
        separator = _separator(text)
        if separator is None:
            fail(
                path, 1, "has no columns: neither semicolon, tab nor comma separates it; save the file as CSV"
            )
        repairs.add("quoted-lines", "every line was one quoted cell", text.count("\n"))
    numbered = _cells(path, text, separator)
    if not numbered:
        fail(path, 1, "the file holds no rows; fetch it again")
    start = _header(path, numbered, separator)
    header = [cell.strip() for cell in numbered[start][1]]
    if header[0] and _is_data(header):
        header, start = [f"column {i + 1}" for i in range(len(header))], start - 1
    while header and not header[-1]:
        header.pop()
    body = _without_footer(numbered[start + 1 :], len(header), repairs)
    if not body:
        fail(path, numbered[start][0], "is the last one: there is a header but no data; fetch the file again")
    ending = Ending.CLEAN if text.endswith(("\n", "\r")) else _ending([row[-1].strip() for _, row in body])
    if _LABEL.match(header[-1]) and {len(row) for _, row in body[: len(body) - 1 or 1]} == {len(header) - 1}:
        body = [(line, [*row, ""]) for line, row in body]
    remarks = []
    for line, row in body:
        if len(row) == len(header):
            continue
        beyond = [cell.strip() for cell in row[len(header) :] if cell.strip()]
        if len(row) < len(header) or any(map(_LIKE_DATA.match, beyond)):
            _ragged(path, line, len(row), len(header), last=line == body[-1][0])
        remarks += [line] if beyond else []
    if len(remarks) > max(1, _MOST_REMARKS * len(body)):
        _ragged(path, remarks[0], len(header) + 1, len(header), last=False)
    repairs.add("remark", "left out a remark beside the table", len(remarks), remarks[0] if remarks else None)
    rows = [row for _, row in body]
    preamble = [[cell.strip() for cell in row] for _, row in numbered[: max(start, 0)]]
    return Table(path, header, rows, [line for line, _ in body], separator, ending, preamble)


def _without_footer(
    body: list[tuple[int, list[str]]], columns: int, repairs: Repairs
) -> list[tuple[int, list[str]]]:
    """Cut lines of text below the table, such as a legend: they have other cells, and begin with a letter."""
    end = len(body)
    while end > 1 and len(body[end - 1][1]) != columns and _LETTER.match(body[end - 1][1][0]):
        end -= 1
    repairs.add(
        "footer", "left out lines of text below the table", len(body) - end, body[-1][0] if body else None
    )
    return body[:end]


def _ending(cells: list[str]) -> Ending:
    """Judge the last cell of a file that ends without a line break by the decimals of those above it."""
    *others, last = (len(found[1]) if (found := _DECIMALS.search(cell)) else 0 for cell in cells)
    if not others or max(others) == 0:
        return Ending.OPEN
    if last >= max(others):
        return Ending.ALIKE
    return Ending.CUT if min(others) == max(others) else Ending.OPEN


def _cells(path: str, text: str, separator: str) -> list[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        return [
            (reader.line_num, row)
            for row in reader
            if row and "".join(row).strip() and not row[0].startswith(("#", "sep="))
        ]
    except csv.Error as error:
        fail(path, reader.line_num, f"cannot be split into cells ({error}); fetch the file again")


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
    return (
        "\n".join(line[1:-1].replace('""', '"') if line[:1] == line[-1:] == '"' else line for line in lines)
        + "\n"
    )


def _header(path: str, numbered: list[tuple[int, list[str]]], separator: str) -> int:
    """Return the index of the header: the first row as wide as most rows; a preamble may come before it."""
    width = Counter(len(row) for _, row in numbered[:_SAMPLE]).most_common(1)[0][0]
    start = next(i for i, (_, row) in enumerate(numbered) if len(row) == width)
    if start == 1 and len(numbered[0][1]) == width + 1 and _LABEL.match(numbered[0][1][-1]):
        return 0  # ENTSO-E names the zone in the header, with no cell below
    below = numbered[start + 1 : start + _DEEPEST_HEADER]
    titled = (i for i, (_, row) in enumerate(below, start + 1) if len(row) == width and _TITLE.match(row[0]))
    if (found := next(titled, None)) is not None:
        return found  # what is above has as many cells by chance
    for _, row in numbered[:start]:
        split_otherwise = (separator.join(row).count(other) + 1 for other in _SEPARATORS)
        if _is_data(numbered[start][1]) or width in split_otherwise:
            _ragged(path, numbered[start][0], width, len(row), last=False)
    return start


def _is_data(row: list[str]) -> bool:
    return sum(bool(_LIKE_DATA.match(cell)) for cell in row) * 2 > sum(map(bool, row))


def _ragged(path: str, line: int, cells: int, columns: int, *, last: bool) -> None:
    if last and cells < columns:
        fail(path, line, f"ends after {cells} of {columns} columns: the file is truncated; fetch it again")
    fail(
        path,
        line,
        f"has {cells} cells where the header has {columns} columns: wrong or mixed separator; "
        "separate header and rows alike, by a character that numbers do not use",
    )
