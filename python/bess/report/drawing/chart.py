"""A chart as data: panels of series over one shared axis, drawn as a figure or for the page.

Long series are reduced before they get here, once for both, so that a year stays light (``long_runs``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from numpy.typing import NDArray

Values = NDArray[Any]


@dataclass(frozen=True)
class Series:
    """One line, step line, set of dots, or band.

    Attributes
    ----------
    x, y : ndarray, shape (n,)
        For ``step`` and ``band``, ``y[i]`` holds on ``[x[i], x[i + 1])``.
    base : ndarray, shape (n,), optional
        Lower edge of a ``band``; ``y`` is the upper one.
    colour : str
        Hexadecimal.
    label : str
        In the legend; series of one chart with equal labels share one entry. Empty: no entry.
    kind : str
        How it is drawn.
    dashed : bool
        Whether a line is broken.
    names : tuple of str
        Names of the points, shown where one points at them.
    """

    x: Values
    y: Values
    colour: str
    label: str = ""
    kind: Literal["line", "step", "dots", "star", "band"] = "line"
    base: Values | None = None
    dashed: bool = False
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    y_label: str
    series: tuple[Series, ...]
    background: Series | None = None
    background_label: str = ""
    log: bool = False
    y_limits: tuple[float, float] | None = None
    title: str = ""
    annotations: tuple[tuple[float, float, str], ...] = ()


@dataclass(frozen=True)
class Span:
    """A stretch of the horizontal axis that is marked: an event."""

    start: Any
    end: Any
    label: str


@dataclass(frozen=True)
class Chart:
    """Panels one above the other (or in ``columns``) over one horizontal axis."""

    x_label: str
    panels: tuple[Panel, ...]
    columns: int = 1
    panel_height_in: float = 1.55
    width_in: float = 7.2
    spans: tuple[Span, ...] = ()


def spans_label(chart: Chart) -> str:
    """What the marked stretches are, in one line."""
    return "event: " + "; ".join(dict.fromkeys(span.label for span in chart.spans))
