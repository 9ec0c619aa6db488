"""Figures and the self-contained HTML page of a run, a set of scenarios, or a sweep.

The libraries that draw are an extra; they are imported by what draws, so that this package is there without.
"""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from bess.optional_dependencies import extra

if TYPE_CHECKING:
    from bess.report.drawing.style import save_figure

__all__ = ["save_figure", "write_report"]


def drawing_extra() -> AbstractContextManager[None]:
    """Return the context in which modules that draw are imported: it names the extra that is missing."""
    return extra("report", "a report or figure")


def write_report(
    directory: str | Path, *, hindsight: bool = False, rules: bool | None = None, print_files: bool = False
) -> Path:
    """Write ``report.html`` and ``figures/`` for a run, a set of scenarios, or a sweep.

    The page needs no network and no other file. A set of a few scenarios gets a page that compares them, and
    one for each scenario in its own folder; of many, such as a sweep, only the comparison is written.
    Unfinished runs are shown as far as they got, and said to be.

    Parameters
    ----------
    directory
        ``out`` of ``bess run`` or ``bess sweep``.
    hindsight
        Also compute the hindsight benchmark and bound of every run (:func:`bess.hindsight`): seconds a week.
    rules
        Run the rules beside every run that has a page, on the same demand, and say what was gained over the
        best of them. They take a second for a week and are kept in ``kpis.json``, as ``gain_kwh`` and
        ``gain_rule``. If omitted: for runs of up to five weeks.

    print_files
        Save every figure as PNG and PDF as well, not as SVG alone; three times the work.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If there is no run to show.
    """
    with drawing_extra():
        from bess.report.page import Options, write_pages
    return write_pages(Path(directory), Options(hindsight, rules, print_files))


def __getattr__(name: str) -> object:
    if name != "save_figure":
        raise AttributeError(f"module 'bess.report' has no attribute {name!r}")
    with drawing_extra():
        from bess.report.drawing.style import save_figure
    return save_figure
