"""Names of KPIs for people, their units, and which direction is better."""

from __future__ import annotations

from typing import Final, NamedTuple

from bess.analysis.pareto import Direction


class KpiName(NamedTuple):
    """How one KPI is shown."""

    text: str
    unit: str
    better: Direction
    decimals: int = 2

    @property
    def label(self) -> str:
        """For axes and table headers."""
        return f"{self.text} ({self.unit})" if self.unit else self.text


KPI_NAMES: Final[dict[str, KpiName]] = {
    "availability_pct": KpiName("Availability", "%", "max"),
    "derating_efficiency_pct": KpiName("Derating efficiency", "%", "max"),
    "inverter_efficiency_pct": KpiName("Inverter efficiency", "%", "max"),
    "battery_efficiency_pct": KpiName("Battery efficiency", "%", "max"),
    "system_efficiency_pct": KpiName("System efficiency", "%", "max"),
    "peak_mean_temperature_c": KpiName("Peak mean temperature", "°C", "min", 1),
    "peak_string_temperature_c": KpiName("Peak string temperature", "°C", "min", 1),
    "peak_node_temperature_c": KpiName("Hottest node", "°C", "min", 1),
}
"""The KPIs that carry a judgement, in the order of the tables; others are listed as they are."""

EFFICIENCIES: Final = tuple(name for name in KPI_NAMES if name.endswith("_pct"))
RADAR_KPIS: Final = (*EFFICIENCIES, "peak_mean_temperature_c")
MOST_COMPARED: Final = 8
"""More scenarios than this are shown as a table and a front, not side by side."""
