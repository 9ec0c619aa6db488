"""Key figures as a table of plain text."""

from __future__ import annotations

import io
import math

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bess.analysis.catalogue import KpisByRun, in_order, kpi

_WIDEST = 100_000


def kpi_table(kpis: KpisByRun) -> str:
    """Return one column for each run; figures that no run has, and mere details, are left out."""
    table = Table(box=None, pad_edge=False)
    for heading in ("", ""):
        table.add_column(heading)
    for run in kpis:
        table.add_column(Text(run), justify="right", header_style="")
    for name in in_order(key for values in kpis.values() for key in values):
        entry = kpi(name)
        if not entry.detail:
            numbers = (entry.number(values.get(name, math.nan)) for values in kpis.values())
            table.add_row(*(Text(cell) for cell in (entry.label, entry.unit, *numbers)))
    # As wide as it is: a terminal may fold the lines, a file keeps them.
    console = Console(file=io.StringIO(), width=_WIDEST, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())
