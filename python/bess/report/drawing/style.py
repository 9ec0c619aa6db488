"""Figure style (sizes, fonts, colours for colour-blind readers), and saving as SVG, PNG and PDF."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Final

from matplotlib import colormaps, rcParams
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from bess.simulation.record.files import REPEAT, clear_errors

SINGLE_COLUMN_IN: Final = 3.5
_NOTEBOOK_DPI: Final = 110
DOUBLE_COLUMN_IN: Final = 7.2

# Okabe and Ito's palette; its yellow is too pale for lines on white and shades events.
PALETTE: Final = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
CHARGE: Final = "#56B4E9"
DISCHARGE: Final = "#0072B2"
AVAILABILITY: Final = "#D55E00"
DERATING: Final = "#E69F00"
INVERTER: Final = "#CC79A7"
BATTERY: Final = "#009E73"
HYSTERESIS: Final = "#B8B000"
AUXILIARY: Final = "#56B4E9"
BACKGROUND: Final = "#9A9A9A"
LOSSES: Final = {
    "unmet": BACKGROUND,
    "derating_loss": DERATING,
    "availability_loss": AVAILABILITY,
    "inverter_loss": INVERTER,
    "battery_loss": BATTERY,
    "hysteresis_loss": HYSTERESIS,
    "auxiliary": AUXILIARY,
}
"""Colours of undelivered energy and losses, by names without unit, in the order of a stack."""
BACKGROUND_ALPHA: Final = 0.28
EVENT: Final = "#F0E442"
EVENT_ALPHA: Final = 0.35
INK: Final = "#222222"
SOFT_INK: Final = "#6A6A6A"
GRID: Final = "#E3E3E3"

_RC: Final[Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelsize": 8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 8,
    "date.converter": "concise",
    "figure.constrained_layout.h_pad": 0.03,
    "figure.dpi": 100,
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "path.simplify_threshold": 0.2,
    # Text stays text: files are a third smaller and can be searched. PDF files embed their fonts.
    "svg.fonttype": "none",
    # Element ids come from this salt, so the same figure gives the same file.
    "svg.hashsalt": "bess",
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the style of this module, as context or decorator, for any settings of the caller.

    Only these parameters are restored; others change when a notebook draws its first figure."""
    before = {name: rcParams[name] for name in _RC}
    rcParams.update(_RC)
    try:
        yield
    finally:
        rcParams.update(before)


def colours(count: int) -> list[str]:
    """Return ``count`` colours: from the palette, or an even map without its pale end for more colours."""
    if count <= len(PALETTE):
        return list(PALETTE[:count])
    return [to_hex(colormaps["viridis"](0.92 * index / (count - 1))) for index in range(count)]


class NotebookFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        with styled():
            self.savefig(picture, format="png", dpi=_NOTEBOOK_DPI)
        return picture.getvalue()


_FIGURE: ContextVar[Callable[..., Figure]] = ContextVar("figure", default=NotebookFigure)


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure; within :func:`through_pyplot`, a figure of pyplot."""
    return _FIGURE.get()(figsize=(width_in, height_in), layout="constrained")


@contextmanager
def through_pyplot() -> Iterator[None]:
    """Create figures with pyplot, as notebooks and ``plt.show()`` require."""
    import matplotlib.pyplot as plt

    token = _FIGURE.set(plt.figure)
    try:
        yield
    finally:
        _FIGURE.reset(token)


def save_figure(figure: Figure, path: str | Path, *, dpi: int = 200) -> tuple[Path, Path, Path]:
    """Save a figure as SVG, PNG and PDF; the same figure gives the same bytes.

    Parameters
    ----------
    figure
        Figure of a function of :mod:`bess.report.figures`.
    path
        File name; ``.svg``, ``.png`` and ``.pdf`` are put in place of its ending, if it is one of them.
    dpi
        Resolution of the PNG [dots per inch].

    Returns
    -------
    tuple of Path
        The SVG, the PNG and the PDF file.
    """
    path = Path(path)
    stem = path.stem if path.suffix in (".svg", ".png", ".pdf") else path.name
    svg, png, pdf = (path.with_name(f"{stem}.{ending}") for ending in ("svg", "png", "pdf"))
    save_svg(figure, svg, dpi=dpi)
    with styled():
        # The other files reuse this layout, which takes most of the time.
        engine = figure.get_layout_engine()
        figure.set_layout_engine("none")
        with clear_errors(png, REPEAT):
            figure.savefig(png, dpi=dpi, metadata={"Software": None})
        with clear_errors(pdf, REPEAT):
            figure.savefig(pdf, dpi=dpi, metadata={"CreationDate": None, "Creator": None, "Producer": None})
        figure.set_layout_engine(engine)
    return svg, png, pdf


def save_svg(figure: Figure, path: Path, *, dpi: int = 200) -> str:
    """Save a figure as SVG only, in a third of the time of :func:`save_figure`; return the drawing."""
    with styled(), io.StringIO() as text:
        canvas, screen_dpi = figure.canvas, figure.dpi
        # Rasterised parts are for screens. `savefig` would draw twice, the first time for the layout alone.
        figure.set_dpi(dpi // 2)
        svg_canvas: Any = FigureCanvasSVG(figure)  # print_svg has no types
        svg_canvas.print_svg(text, metadata={"Date": None, "Creator": None})
        figure.set_dpi(screen_dpi)
        figure.set_canvas(canvas)
        svg = shortened(text.getvalue())
    with clear_errors(path, REPEAT):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(svg, encoding="utf-8")
    return svg


_COORDINATES: Final = re.compile(r'\b(?:x|y|points)="[^"]*"')
_PATH: Final = re.compile(r'\bd="([^"]*)"')
_MORE_DIGITS: Final = re.compile(r"(\.\d)\d+")
_STEP: Final = re.compile(r"([MLz])(?:\s+([-\d.]+)\s+([-\d.]+))?")


def shortened(svg: str) -> str:
    """Return a drawing of matplotlib with coordinates to a tenth of a point, finer than a screen or printer.

    Horizontal and vertical lines, of which step lines consist, are written as such.
    """
    svg = _COORDINATES.sub(lambda found: _rounded(found[0]), svg)
    return _PATH.sub(lambda found: f'd="{_short_path(found[1])}"', svg)


def _rounded(text: str) -> str:
    return _MORE_DIGITS.sub(r"\1", text)


def _short_path(path: str) -> str:
    if not set(path) <= set("MLz0123456789.- \n"):
        return path  # curves are few, and small
    shown: list[str] = []
    last = ("", "")
    for command, x, y in _STEP.findall(_rounded(path)):
        if command == "z":
            shown.append("z")
            continue
        if command == "M" or (x != last[0] and y != last[1]):
            shown.append(f"{command}{x} {y}")
        elif x != last[0]:
            shown.append(f"H{x}")
        elif y != last[1]:
            shown.append(f"V{y}")
        last = (x, y)
    return "".join(shown)
