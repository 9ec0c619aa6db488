"""Representation of objects: one line at a prompt, a small table in a notebook.

A class lists its main properties in ``_facts``, the most important first, and uses ``one_line`` as
``__repr__`` and ``as_table`` as ``_repr_html_``.
"""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import Protocol

_MAX_NUMBERS = 6


class HasFacts(Protocol):
    """Object with a list of main properties."""

    def _facts(self) -> dict[str, str]: ...


def one_line(self: HasFacts) -> str:
    """Return the class and its properties."""
    facts = ", ".join(f"{name}: {value}" if name else value for name, value in self._facts().items())
    return f"<{type(self).__name__} {facts}>"


def as_table(self: HasFacts) -> str:
    """Return the class and its properties as HTML."""
    left = 'style="text-align:left"'
    rows = "".join(
        f"<tr><th {left}>{escape(name)}</th><td {left}>{escape(value)}</td></tr>"
        for name, value in self._facts().items()
    )
    return f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"


def rounded(value: float, digits: int = 2) -> str:
    """Return a number with a few digits, and no exponent below a million: 240, not 2.4e+02."""
    return f"{float(f'{value:.{digits}g}'):g}"


def amount(value: float) -> str:
    """Return an amount of kWh or EUR, with a decimal below a hundred: 3.8, 240, 1,752."""
    text = f"{value:,.1f}" if abs(value) < 99.95 else f"{value:,.0f}"
    return "0" if text in ("0.0", "-0.0") else text


def few(values: Iterable[float], unit: str = "") -> str:
    """Return all of a few numbers, or the first and last of many."""
    texts = [rounded(value, 3) for value in values]
    if len(texts) > _MAX_NUMBERS:
        texts = [*texts[:3], "…", *texts[-2:]]
    return f"{', '.join(texts)} {unit}".rstrip()
