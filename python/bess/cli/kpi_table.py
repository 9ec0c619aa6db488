"""Key figures as a table of plain text."""

from __future__ import annotations

import math
from collections.abc import Mapping

from bess.analysis.catalogue import in_order, kpi


def kpi_table(kpis: Mapping[str, Mapping[str, float]]) -> str:
    """Return one column for each run; figures that no run has, and mere details, are left out."""
    rows = [["", "", *kpis]]
    for name in in_order(key for values in kpis.values() for key in values):
        entry = kpi(name)
        if not entry.detail:
            numbers = (entry.number(values.get(name, math.nan)) for values in kpis.values())
            rows.append([entry.label, entry.unit, *numbers])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        left = [cell.ljust(width) for cell, width in zip(row[:2], widths[:2], strict=True)]
        right = [cell.rjust(width) for cell, width in zip(row[2:], widths[2:], strict=True)]
        lines.append("  ".join(left + right).rstrip())
    return "\n".join(lines)
