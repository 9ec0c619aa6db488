"""Measure the numbers of ``howto/services.md``: ``python docs/make_services.py``, a minute.

The weeks are bundled; the month of frequency control needs the measured files in ``../shared/data`` and keeps
its numbers without them.
"""

import json
from itertools import chain
from pathlib import Path
from typing import Any

from tables import markdown_table

import bess
from bess.simulation.analysis.catalogue import grouped, kpi

DOCS = Path(__file__).parent
DATA = DOCS.parents[1] / "shared" / "data"
STORED = DOCS / "_cases" / "services.json"
TABLES = {"weeks": "services-weeks.md", "month": "services-month.md"}
KINDS = ("fcr", "fcr-arbitrage", "peak-shaving", "self-consumption")
POLICIES = ("equal", "soc", "mpc")
SHOWN = (
    "undelivered_kwh",
    "lost_kwh",
    "net_eur",
    "capacity_revenue_eur",
    "penalty_eur",
    "outside_window_h",
    "peak_draw_kw",
    "self_sufficiency_pct",
    "full_cycles",
)
MONTH = {
    "demand.frequency": str(DATA / "bess" / "frequency_france_2019_05_10s.csv.zip"),
    "demand.time_zone": "UTC",
    "demand.repeat": True,
    "demand.capacity_prices": str(DATA / "fcr" / "fcr_prices_regelleistung_2024.csv.gz"),
    "demand.capacity_kw": 140.0,
    "run.start": "2023-12-31T23:00:00Z",
    "run.days": 31.0,
}
MONTH_KPIS = (
    "response_kwh",
    "capacity_revenue_eur",
    "net_eur",
    "penalty_eur",
    "outside_window_h",
    "lost_kwh",
    "full_cycles",
    "inverter_starts_mean",
)

Figures = dict[str, dict[str, float]]


def main() -> None:
    """Measure and write."""
    numbers: dict[str, Any] = stored() if STORED.exists() else {}
    numbers["weeks"] = {kind: week(kind, POLICIES) for kind in KINDS}
    if Path(MONTH["demand.frequency"]).exists():
        numbers["month"] = {
            f"{minutes:g} min, {name}": month(minutes, name)
            for minutes, name in ((15.0, "soc"), (15.0, "mpc"), (30.0, "mpc"))
        }
    else:
        print(f"{DATA}: no measured files there; the month keeps its numbers")
    STORED.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    for name, text in tables(stored()).items():
        (DOCS / "_cases" / name).write_text(text, encoding="utf-8")


def week(kind: str, policies: tuple[str, ...]) -> Figures:
    """Key figures of a bundled week, by policy."""
    return {name: _figures(bess.load_study(kind, {"policy.name": name}), SHOWN) for name in policies}


def month(duration_min: float, policy: str) -> dict[str, float]:
    """Key figures of 31 days of measured frequency at prices of January 2024."""
    values = {**MONTH, "demand.duration_min": duration_min, "policy.name": policy}
    return _figures(bess.load_study("fcr", values), MONTH_KPIS)


def stored() -> dict[str, Any]:
    """Numbers as the page shows them."""
    numbers: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    return numbers


def tables(numbers: dict[str, Any]) -> dict[str, str]:
    """Text of every file that is made of the numbers."""
    rows = [
        ["service", "policy", *(kpi(key).heading for key in chain.from_iterable(grouped(SHOWN).values()))]
    ]
    for kind, by_policy in numbers["weeks"].items():
        for policy, values in by_policy.items():
            shown = [
                kpi(key).number(values[key]) if key in values else ""
                for key in chain.from_iterable(grouped(SHOWN).values())
            ]
            rows.append([f"`{kind}`", f"`{policy}`", *shown])
    made = {TABLES["weeks"]: markdown_table(rows)}
    if "month" in numbers:
        runs = numbers["month"]
        rows = [["rule and policy", *runs]]
        rows += [
            [kpi(key).heading, *(kpi(key).number(values[key]) for values in runs.values())]
            for key in chain.from_iterable(grouped(MONTH_KPIS).values())
        ]
        made[TABLES["month"]] = markdown_table(rows)
    return {name: f"<!-- written by docs/make_services.py -->\n\n{text}" for name, text in made.items()}


def _figures(study: bess.Study, keys: tuple[str, ...]) -> dict[str, float]:
    kpis = bess.run(study, progress=False).kpis
    return {key: float(f"{kpis[key]:.7g}") for key in keys if key in kpis}


if __name__ == "__main__":
    main()
