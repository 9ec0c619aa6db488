"""How things show themselves: one line at a prompt, a small table in a notebook.

A class says what it is in ``_facts``, from the most to the least important, and takes ``one_line`` as its
``__repr__`` and ``as_table`` as its ``_repr_html_``.
"""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import Protocol

_MOST_NUMBERS = 6


class HasFacts(Protocol):
    """Something that says what it is."""

    def _facts(self) -> dict[str, str]: ...


def one_line(self: HasFacts) -> str:
    """Return the class and its facts."""
    facts = ", ".join(f"{name}: {value}" if name else value for name, value in self._facts().items())
    return f"<{type(self).__name__} {facts}>"


def as_table(self: HasFacts) -> str:
    """Return the class and its facts as HTML."""
    left = 'style="text-align:left"'
    rows = "".join(
        f"<tr><th {left}>{escape(name)}</th><td {left}>{escape(value)}</td></tr>"
        for name, value in self._facts().items()
    )
    return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"


def few(values: Iterable[float], digits: str = ".3g", unit: str = "") -> str:
    """Return a few numbers, or of many the first and the last ones."""
    texts = [format(value, digits) for value in values]
    if len(texts) > _MOST_NUMBERS:
        texts = [*texts[:3], "…", *texts[-2:]]
    return f"{', '.join(texts)} {unit}".rstrip()
