"""Run the studies of the documentation and write the numbers, tables and figures of its pages and the README.

    python docs/make_cases.py FOLDER

FOLDER keeps the runs; what is finished there is not run again.
"""

import json
import sys
from pathlib import Path

import numbers_of_pages as numbers
from tables import save_picture

from bess.report import figures


def main(folder: Path) -> None:
    """Run everything and write everything."""
    results = {name: numbers.runs(name, folder) for name in numbers.STUDIES}
    measured = {name: numbers.figures_of(runs) for name, runs in results.items()}
    day = numbers.m5bat()
    if day is None:
        print(f"{numbers.M5BAT_DATA}: no measured day of M5BAT there; its page keeps its numbers")
        day = numbers.stored()["m5bat"]
    everything = {**measured, "m5bat": day}
    numbers.TABLES.mkdir(exist_ok=True)
    numbers.STORED.write_text(json.dumps(everything, indent=1) + "\n", encoding="utf-8")
    # Read back: tables show what is stored.
    for name, text in numbers.tables(numbers.stored()).items():
        (numbers.TABLES / name).write_text(text, encoding="utf-8")

    case1, case2, differing = results["case1"], results["case2"], results["differing"]
    drawn = {
        "case1-strings": figures.strings(case1["mpc"].dataset),
        "case1-kpis": figures.kpi_bars({name: result.kpis for name, result in case1.items()}),
        "case2-radar": figures.kpi_radar({name: result.kpis for name, result in case2.items()}),
        "case2-temperature": figures.mean_temperature({name: r.dataset for name, r in case2.items()}),
        "differing-spread": figures.string_spread({name: r.dataset for name, r in differing.items()}),
    }
    for name, figure in drawn.items():
        save_picture(figure, name)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
