"""Run the paper's cases and write the tables and figures of ``cases.md`` and the README.

    python docs/make_cases.py FOLDER

FOLDER keeps the runs; what is finished there is not run again. Every number of this package on the page comes
from here.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import bess
from bess.analysis.catalogue import in_order, kpi
from bess.report import figures
from bess.report.kpi_figures import EFFICIENCIES
from bess.report.paper import comparisons, reading
from bess.report.style import save_figure

DOCS = Path(__file__).parent
TABLES = DOCS / "_cases"
ROWS = (
    "delivered_kwh",
    "undelivered_kwh",
    "lost_kwh",
    *EFFICIENCIES,
    "peak_mean_temperature_c",
    "peak_string_temperature_c",
    "soc_spread_max",
    "inverter_starts_mean",
    "fallback_steps",
    "solver_gap_median",
    "solver_search_gap_median",
)


def main(folder: Path) -> None:
    """Run both studies and write everything."""
    TABLES.mkdir(exist_ok=True)
    case2 = bess.run_scenarios(bess.load_study("case2"), out=folder / "case2", resume=True)
    policies = bess.run_scenarios(bess.load_study("policies"), out=folder / "policies", resume=True)
    kpis2 = {name: result.kpis for name, result in case2.items()}
    kpis1 = {name: result.kpis for name, result in policies.items()}

    rows = comparisons(kpis2)
    table = [["", "the paper", "here", "comes out"]]
    table += [[row.statement, row.paper, row.here, str(row.verdict)] for row in rows]
    _write("case2-paper.md", _table(table) + "\n" + "\n\n".join(reading(rows)) + "\n")
    _write("case2-kpis.md", _kpi_table(kpis2))
    _write("policies.md", _kpi_table(kpis1))

    static = DOCS / "_static"
    drawn = {
        "case1-strings": figures.strings(policies["mpc"].dataset),
        "case1-kpis": figures.kpi_bars(kpis1),
        "case2-radar": figures.kpi_radar(kpis2),
        "case2-temperature": figures.mean_temperature({name: r.dataset for name, r in case2.items()}),
    }
    for name, figure in drawn.items():
        svg, *others = save_figure(figure, static / name)
        for other in others:
            other.unlink()
        print(f"{svg.name}: {svg.stat().st_size / 1000:.0f} kB")


def _kpi_table(kpis: Mapping[str, Mapping[str, float]]) -> str:
    table = [["", *kpis]]
    table += [
        [kpi(key).heading, *(kpi(key).number(k.get(key, math.nan)) for k in kpis.values())]
        for key in in_order(ROWS)
    ]
    return _table(table)


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *body = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([head, "|" + " --- |" * len(rows[0]), *body]) + "\n"


def _write(name: str, text: str) -> None:
    (TABLES / name).write_text(f"<!-- written by docs/make_cases.py -->\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
