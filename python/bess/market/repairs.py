"""What a reader changed in a file to make a regular series of it: reported once, never silently."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field

log = logging.getLogger("bess.market")


@dataclass(frozen=True)
class Repair:
    """One kind of repair: what was done, how often, and the first line of the file it concerns.

    Attributes
    ----------
    kind : str
        Short machine-readable name, such as ``"autumn-hour"`` or ``"gap-filled"``.
    text : str
        One sentence for people.
    count : int
        Rows or values concerned.
    line : int or None
        First line of the file concerned (1-based), if there is one.
    """

    kind: str
    text: str
    count: int = 1
    line: int | None = None

    def __str__(self) -> str:
        place = "" if self.line is None else f", from line {self.line}"
        return f"{self.text} ({self.count}{place})"


@dataclass
class Repairs:
    """The repairs of one file, in the order they were made; kept in ``series.attrs["repairs"]``."""

    path: str
    items: list[Repair] = field(default_factory=list)

    def add(self, kind: str, text: str, count: int = 1, line: int | None = None) -> None:
        """Note a repair; one of no rows is none."""
        if count:
            self.items.append(Repair(kind, text, count, line))

    def report(self) -> None:
        """Log all repairs as one line, at level INFO, on the logger ``bess.market``."""
        if self.items:
            log.info("%s: %s", self.path, "; ".join(map(str, self.items)))

    def count(self, kind: str) -> int:
        """Return the number of rows repaired in the way `kind`."""
        return sum(item.count for item in self.items if item.kind == kind)

    def __iter__(self) -> Iterator[Repair]:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)

    def __deepcopy__(self, memo: object) -> "Repairs":
        """A finished report is shared: pandas copies ``attrs`` deeply with every operation."""
        return self
