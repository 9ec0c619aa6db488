"""Figures and the self-contained HTML page of a run, a set of scenarios, or a sweep."""

from bess.extras import extra

with extra("report", "a report or figure"):
    from bess.report.drawing.style import save_figure
    from bess.report.page import write_report

__all__ = ["save_figure", "write_report"]
