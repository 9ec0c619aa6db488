"""Corrections that a reader applied to a file to obtain a regular series; always reported."""

import logging
from typing import NamedTuple

log = logging.getLogger("bess.market")


class Repair(NamedTuple):
    """One kind of repair: description, number of rows, and first line of the file concerned.

    Attributes
    ----------
    kind : str
        Short machine-readable name, such as ``"autumn-hour"`` or ``"gap-filled"``.
    text : str
        Description of the correction.
    rows : int
        Rows or values concerned.
    line : int or None
        First line of the file concerned (1-based), if there is one.
    """

    kind: str
    text: str
    rows: int = 1
    line: int | None = None

    def __str__(self) -> str:
        place = "" if self.line is None else f" from line {self.line}"
        return f"{self.text} ({self.rows} row{'s' if self.rows != 1 else ''}{place})"


class Repairs(list[Repair]):
    """The repairs of one file in the order they were made; kept in ``series.attrs["repairs"]``."""

    def add(self, kind: str, text: str, rows: int = 1, line: int | None = None) -> None:
        """Add a repair, unless it concerns no rows."""
        if rows:
            self.append(Repair(kind, text, int(rows), None if line is None else int(line)))

    def rows(self, kind: str) -> int:
        """Return the number of rows with repairs of the given kind."""
        return sum(repair.rows for repair in self if repair.kind == kind)

    def report(self, path: str) -> None:
        """Log all repairs as one line, level INFO, on the logger ``bess.market``."""
        if self:
            log.info("%s: %s", path, "; ".join(map(str, self)))
