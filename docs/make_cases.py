"""Run the paper's cases and write the tables and figures of ``cases.md`` and the README.

    python docs/make_cases.py FOLDER

FOLDER keeps the runs; what is finished there is not run again. Every number of this package on the page comes
from here.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import bess
from bess.report import figures
from bess.report.kpi_names import EFFICIENCIES, KPI_NAMES
from bess.report.paper import comparisons, reading
from bess.report.style import save_figure

DOCS = Path(__file__).parent
TABLES = DOCS / "_cases"
ROWS = (
    *EFFICIENCIES,
    "peak_mean_temperature_c",
    "peak_string_temperature_c",
    "soc_spread_max",
    "inverter_starts_mean",
    "fallback_steps",
    "solver_gap_median",
    "solver_search_gap_median",
)
EXTRA = {
    "delivered_kwh": ("delivered, both ways", "kWh", 0),
    "solver_gap_median": ("rigorous gap, median", "%", 2),
    "solver_search_gap_median": ("search gap, median", "%", 3),
    "soc_spread_max": ("largest SOC spread", "–", 2),
    "inverter_starts_mean": ("starts of an inverter", "–", 1),
    "fallback_steps": ("fallback steps", "–", 0),
}


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
        svg, png = save_figure(figure, static / name)
        png.unlink()
        print(f"{svg.name}: {svg.stat().st_size / 1000:.0f} kB")


def _kpi_table(kpis: Mapping[str, Mapping[str, float]]) -> str:
    table = [["", *kpis]]
    for key in ("delivered_kwh", *ROWS):
        if key in EXTRA:
            text, unit, decimals = EXTRA[key]
        else:
            text, unit, decimals = KPI_NAMES[key].text, KPI_NAMES[key].unit, 2 if key in EFFICIENCIES else 1
        scale = 100.0 if "gap" in key else 1.0
        label = text if unit == "–" else f"{text} [{unit}]"
        cells = [f"{scale * k[key]:.{decimals}f}" if key in k else "–" for k in kpis.values()]
        table.append([label, *cells])
    return _table(table)


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *body = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([head, "|" + " --- |" * len(rows[0]), *body]) + "\n"


def _write(name: str, text: str) -> None:
    (TABLES / name).write_text(f"<!-- written by docs/make_cases.py -->\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
