"""KPIs as a plain-text table."""

from __future__ import annotations

import io
import math

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bess.simulation.analysis.catalogue import KpisByRun, grouped, kpi

_WIDEST = 100_000


def kpi_table(kpis: KpisByRun) -> str:
    """Return a table with one column per run and grouped rows, without missing KPIs and details."""
    table = Table(box=None, pad_edge=False)
    for heading in ("", ""):
        table.add_column(heading)
    for run in kpis:
        table.add_column(Text(run), justify="right", header_style="")
    shown = (name for values in kpis.values() for name in values if not kpi(name).detail)
    for heading, names in grouped(shown).items():
        table.add_row(Text(heading))
        for name in names:
            entry = kpi(name)
            numbers = (entry.number(values.get(name, math.nan)) for values in kpis.values())
            table.add_row(*(Text(cell) for cell in (f"  {entry.label}", entry.unit, *numbers)))
    # Full width: a terminal may wrap the lines, a file keeps them.
    console = Console(file=io.StringIO(), width=_WIDEST, color_system=None)
    with console.capture() as capture:
        console.print(table)
    return "\n".join(line.rstrip() for line in capture.get().splitlines())
