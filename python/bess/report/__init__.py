"""Figures and the self-contained HTML page of a run, a set of scenarios, or a sweep.

The drawing libraries are an extra. Only modules that draw import them, so this package needs no extra.
"""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from bess.files import path_of
from bess.optional_dependencies import extra

if TYPE_CHECKING:
    from bess.report.drawing.style import save_figure

__all__ = ["save_figure", "write_report"]


def drawing_extra() -> AbstractContextManager[None]:
    """Return the context for importing modules that draw; its error names the missing extra."""
    return extra("report", "a report or figure")


def write_report(
    directory: str | Path, *, hindsight: bool = False, rules: bool | None = None, print_files: bool = False
) -> Path:
    """Write ``report.html`` and ``figures/`` for a run, a set of scenarios, or a sweep.

    The page needs no network and no other file. A set of a few scenarios gets a page that compares them, and
    one for each scenario in its own folder; a sweep of many gets the comparison only. Unfinished runs are
    shown up to their last saved step, and marked.

    Parameters
    ----------
    directory
        ``out`` of ``bess run`` or ``bess sweep``.
    hindsight
        Also compute the hindsight benchmark and bound of every run (:func:`bess.hindsight`): seconds for a
        week.
    rules
        Simulate the rules on the demand of every run that has a page, and report the gain over the best rule.
        This takes a second for a week; the gain is saved in ``kpis.json``, as ``gain_kwh`` and ``gain_rule``.
        Default: for runs of up to five weeks.

    print_files
        Save every figure as PNG and PDF in addition to SVG; this takes three times as long.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        There is no run to show.
    """
    with drawing_extra():
        from bess.report.page import Options, write_pages
    return write_pages(path_of(directory, "folder"), Options(hindsight, rules, print_files))


def __getattr__(name: str) -> object:
    if name != "save_figure":
        raise AttributeError(f"module 'bess.report' has no attribute {name!r}")
    with drawing_extra():
        from bess.report.drawing.style import save_figure
    return save_figure
