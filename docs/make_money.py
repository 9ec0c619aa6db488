"""Measure the numbers of ``howto/money.md``: ``python docs/make_money.py [month|look|ages|accuracy|year]``.

A month takes seconds, the year of two ages and four weeks of the published benchmark a few minutes, its whole
year (``year``, alone) twenty.
Prices are read from ``../shared/data/prices``; without them the stored numbers stay.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from tables import markdown_table

import bess
from bess.study import Study, expand

DOCS = Path(__file__).parent
PRICES = DOCS.parents[1] / "shared" / "data" / "prices"
SMARD = PRICES / "smard_de_viertelstunde_2024_berechnet_resaved.csv"
INTRADAY = PRICES / "energy-charts_de_intraday15_2021.csv"
STORED = DOCS / "_cases" / "money.json"

KPIS = (
    "net_eur", "revenue_eur", "wear_eur", "shortfall_eur", "fulfilment_pct", "round_trip_efficiency_pct",
    "short_of_charge_kwh", "short_of_discharge_kwh", "delivered_kwh", "soh_capacity_mean",
)  # fmt: skip
WEAR_EUR_MWH = (0.0, 20.0, 40.0, 60.0)
MONTHS = {"linear": ("linear", "equal"), "aware": ("aware", "equal"), "aware, mpc": ("aware", "mpc")}
"""Plan and policy of the runs over a month."""
LOOK_H = (12.0, 24.0, 36.0, 72.0, 168.0)
LOOK_STARTS = {"January": "2024-01-01T00:00:00Z", "May": "2024-05-01T00:00:00Z"}
LOOK_WEAR_EUR_MWH = (0.0, 60.0)
YEAR_DAYS = 365.0
BATTERY_KWH = 180.0
"""Energy that the publication takes for a full cycle."""
START_HEALTH = 0.92
"""Mean capacity at the start of the study ``unequal-ages``."""

PUBLISHED = {
    "linear-r1": (10_850, 583, 91.4, 0.818, 1.082),
    "aware-r1": (10_898, 584, 91.5, 0.018, 0.031),
    "linear-r2": (10_282, 575, 87.7, 5.176, 1.344),
    "aware-r2": (10_478, 582, 88.6, 0.000, 0.034),
    "linear-r3": (9_690, 564, 84.2, 10.283, 1.610),
    "aware-r3": (10_056, 580, 86.1, 0.000, 0.037),
}
"""Revenue [EUR/a], full cycles a year of 180 kWh, round trip [%], short of charge and of discharge [MWh/a] of
arXiv 2506.17059; what is ``aware`` here is a nonlinear program there."""

Figures = dict[str, dict[str, float]]


class Piece(NamedTuple):
    """What is measured: the runs of a study over so many days, and over a few that a test repeats."""

    prices: Path
    days: float
    few_days: float

    def runs(self, name: str, days: float) -> dict[str, Study]:
        """Runs by name."""
        values = {"demand.prices": str(self.prices), "run.days": days}
        if name == "look":
            return {
                f"{month}, {price:g}, {look_h:g}": bess.load_study(
                    "arbitrage-2024",
                    values
                    | {
                        "policy.name": "equal",
                        "run.start": start,
                        "wear.eur_per_mwh": price,
                        "demand.look_ahead_h": look_h,
                    },
                )
                for month, start in LOOK_STARTS.items()
                for price in LOOK_WEAR_EUR_MWH
                for look_h in LOOK_H
            }
        if name != "month":
            study = {"ages": "unequal-ages", "accuracy": "model-accuracy"}[name]
            return dict(expand(bess.load_study(study, values)))
        return {
            f"{label}, {price:g}": bess.load_study(
                "arbitrage-2024",
                values | {"policy.name": policy, "demand.plan": plan, "wear.eur_per_mwh": price},
            )
            for label, (plan, policy) in MONTHS.items()
            for price in WEAR_EUR_MWH
        }

    def measure(self, name: str, days: float, every: int = 1) -> Figures:
        """Key figures of every run, or of one of so many."""
        runs = list(self.runs(name, days).items())[::every]
        return {label: figures(bess.run(study, progress=False)) for label, study in runs}


PIECES = {
    "month": Piece(SMARD, 28.0, 2.0),
    "look": Piece(SMARD, 28.0, 0.5),
    "ages": Piece(SMARD, 366.0, 2.0),
    "accuracy": Piece(INTRADAY, 28.0, 0.5),
}


def main(names: list[str]) -> None:
    """Measure and write."""
    if names[:1] == ["year"]:
        return measure_year(names[1:])
    for name, piece in {name: PIECES[name] for name in names or PIECES}.items():
        if piece.prices.exists():
            measured = {name: piece.measure(name, piece.days)}
            measured[f"{name}, few days"] = piece.measure(name, piece.few_days)
            write({**stored(), **measured})


def measure_year(names: list[str]) -> None:
    """Measure the published benchmark over its year: all runs, or those named, such as ``aware-r1``."""
    runs = PIECES["accuracy"].runs("accuracy", YEAR_DAYS)
    for name in names or runs:
        measured = figures(bess.run(runs[name], progress=False))
        numbers = stored()
        write({**numbers, "year": {**numbers.get("year", {}), name: measured}})


def write(numbers: Mapping[str, Any]) -> None:
    """Write the numbers and the tables made of them."""
    STORED.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    for name, text in tables(numbers).items():
        (DOCS / "_cases" / name).write_text(text, encoding="utf-8")


def stored() -> dict[str, Any]:
    """Numbers as the page shows them."""
    numbers: dict[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    return numbers


def figures(result: bess.Result) -> dict[str, float]:
    """Key figures that the page shows, to seven digits."""
    return {key: float(f"{result.kpis[key]:.7g}") for key in KPIS if key in result.kpis}


def tables(numbers: Mapping[str, Any]) -> dict[str, str]:
    """Text of every file that is made of the numbers."""
    made = {
        "money-month.md": _month(numbers["month"]),
        "money-look.md": _look(numbers["look"]),
        "money-ages.md": _ages(numbers["ages"]),
        "money-accuracy.md": _accuracy(numbers["accuracy"]),
        "money-year.md": _year(numbers["year"]),
    }
    return {
        name: f"<!-- written by docs/make_money.py -->\n\n{markdown_table(rows)}"
        for name, rows in made.items()
    }


def _month(runs: Figures) -> list[list[str]]:
    rows = [["wear [EUR/MWh]", *(f"net, {label} [EUR]" for label in MONTHS), "fulfilled, the same order [%]"]]
    for price in WEAR_EUR_MWH:
        each = [runs[f"{label}, {price:g}"] for label in MONTHS]
        fulfilled = " / ".join(f"{run['fulfilment_pct']:.1f}" for run in each)
        rows.append([f"{price:g}", *(f"{run['net_eur']:.1f}" for run in each), fulfilled])
    return rows


def _look(runs: Figures) -> list[list[str]]:
    rows = [["month, wear [EUR/MWh]", *(f"{look_h:g} h" for look_h in LOOK_H)]]
    for month in LOOK_STARTS:
        for price in LOOK_WEAR_EUR_MWH:
            nets = [runs[f"{month}, {price:g}, {look_h:g}"]["net_eur"] for look_h in LOOK_H]
            rows.append([f"{month}, {price:g}", *(f"{net:.1f}" for net in nets)])
    return rows


def _ages(runs: Figures) -> list[list[str]]:
    rows = [["", "revenue [EUR]", "health lost [points]", "revenue per point [EUR]", "net [EUR]"]]
    for name, run in runs.items():
        lost = 100.0 * (START_HEALTH - run["soh_capacity_mean"])
        each = f"{run['revenue_eur'] / lost:,.0f}"
        rows.append(
            [f"`{name}`", f"{run['revenue_eur']:,.0f}", f"{lost:.2f}", each, f"{run['net_eur']:,.0f}"]
        )
    return rows


def _accuracy(runs: Figures) -> list[list[str]]:
    rows = [
        [
            "",
            "revenue over linear [%]",
            "round trip [%]",
            "short of charge [kWh/MWh]",
            "of discharge [kWh/MWh]",
        ]
    ]
    for name, run in runs.items():
        revenue, cycles, round_trip, charge, discharge = PUBLISHED[name]
        linear = name.replace("aware", "linear")
        moved_mwh, published_mwh = run["delivered_kwh"] / 2000.0, BATTERY_KWH / 1000.0 * cycles
        pairs = [
            (run["revenue_eur"] / runs[linear]["revenue_eur"], revenue / PUBLISHED[linear][0]),
            (run["round_trip_efficiency_pct"], round_trip),
            (run["short_of_charge_kwh"] / moved_mwh, 1000.0 * charge / published_mwh),
            (run["short_of_discharge_kwh"] / moved_mwh, 1000.0 * discharge / published_mwh),
        ]
        pairs[0] = (100.0 * (pairs[0][0] - 1.0), 100.0 * (pairs[0][1] - 1.0))
        rows.append([f"`{name}`", *(f"{here:.1f} ({there:.1f})" for here, there in pairs)])
    return rows


def _year(runs: Figures) -> list[list[str]]:
    rows = [["", "revenue [EUR]", "full cycles", "round trip [%]", "short of charge, discharge [MWh]"]]
    for name, published in PUBLISHED.items():
        if name in runs:
            run = runs[name]
            cycles = run["delivered_kwh"] / 2.0 / BATTERY_KWH
            short = [run[f"short_of_{way}_kwh"] / 1000.0 for way in ("charge", "discharge")]
            revenue, their_cycles, round_trip, *their_short = published
            rows.append(
                [
                    f"`{name}`",
                    f"{run['revenue_eur']:,.0f} ({revenue:,})",
                    f"{cycles:.0f} ({their_cycles})",
                    f"{run['round_trip_efficiency_pct']:.1f} ({round_trip})",
                    f"{short[0]:.3f}, {short[1]:.3f} ({their_short[0]:.3f}, {their_short[1]:.3f})",
                ]
            )
    return rows


if __name__ == "__main__":
    main(sys.argv[1:])
