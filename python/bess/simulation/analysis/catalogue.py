"""Catalogue of KPIs: label, unit, preferred direction, digits and meaning (``bess/data/kpis.toml``).

The terminal, the HTML page, figures, sweeps and the manual use it. A test fails if :func:`bess.kpis` returns
a KPI that is not listed here. Every table uses the order of the catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from bess.errors import InputError
from bess.files import bundled_toml
from bess.simulation.analysis.pareto import Direction

Kpis = Mapping[str, float]
"""KPIs of a run, by name, as returned by :func:`bess.kpis`."""
KpisByRun = Mapping[str, Kpis]
"""KPIs by the name of the run; the name may be empty."""

HEADINGS: Final = {
    "energy": "Energy",
    "losses": "Losses",
    "money": "Money",
    "service": "Service",
    "efficiency": "Efficiency",
    "temperature": "Temperature",
    "ageing": "Ageing",
    "strings": "Strings and inverters",
    "solver": "Solver and energy balance",
}
"""Heading of each group, in the order of every table."""


@dataclass(frozen=True)
class Kpi:
    """Description of one KPI."""

    label: str
    """Name in tables and figures."""
    meaning: str
    group: str
    """Key of the heading in :data:`HEADINGS`."""
    unit: str = ""
    """Unit of the value as shown; empty for counts and ratios."""
    better: Direction | None = None
    """Preferred direction; None if there is none."""
    decimals: int | None = None
    """Decimal places; None selects scientific notation, such as ``1.2e-09``."""
    detail: bool = False
    """Whether only complete tables show it."""
    factor: float = 1.0
    """Display factor, such as 100 for a ratio shown in per cent."""

    @property
    def heading(self) -> str:
        """Label with unit, for axes and table headers."""
        return f"{self.label} ({self.unit})" if self.unit else self.label

    def number(self, value: float) -> str:
        """Return the value as shown, without its unit; a dash for NaN."""
        if math.isnan(value):
            return "–"
        if self.decimals is None:
            return f"{self.factor * value:.1e}"
        # Adding zero turns a rounded -0.0 into 0.0.
        return f"{round(self.factor * value, self.decimals) + 0.0:,.{self.decimals}f}"

    def quantity(self, value: float) -> str:
        """Return the value as shown, with its unit."""
        return f"{self.number(value)} {self.unit}".rstrip()


_TABLE = bundled_toml("kpis.toml")
CATALOGUE: Final = {name: Kpi(**entry) for name, entry in _TABLE.items()}
"""All KPIs, by their names in :func:`bess.kpis`."""


def kpi(name: str) -> Kpi:
    """Return the entry of a KPI; an unlisted KPI (of a plug-in) is labelled with its name."""
    return CATALOGUE.get(name) or Kpi(name, "", "strings", decimals=3, detail=True)


def better(name: str) -> Direction:
    """Return the preferred direction of a KPI."""
    direction = kpi(name).better
    if direction is None:
        raise InputError(f"{name}: this KPI has no preferred direction; choose another KPI")
    return direction


def grouped(names: Iterable[str]) -> dict[str, list[str]]:
    """Return KPI names by group heading, in the order of the catalogue.

    Unlisted KPIs come last within their group.
    """
    places = {name: place for place, name in enumerate(CATALOGUE)}
    ordered = sorted(dict.fromkeys(names), key=lambda name: places.get(name, len(places)))
    groups = {
        heading: [name for name in ordered if kpi(name).group == group] for group, heading in HEADINGS.items()
    }
    return {heading: members for heading, members in groups.items() if members}


_SAME_SERVICE: Final = 1e-3
"""Difference of unmet demand, as a share of the demand, up to which runs are compared by what they lose."""


def serving_most(kpis: KpisByRun) -> KpisByRun:
    """Return the runs that leave no more demand unmet than others: unmet demand is part of no loss."""
    unmet = {name: row.get("unmet_kwh", 0.0) for name, row in kpis.items()}
    least = min(unmet.values(), default=0.0)
    return {
        name: row
        for name, row in kpis.items()
        if unmet[name] <= least + _SAME_SERVICE * row.get("demand_kwh", 0.0)
    }
