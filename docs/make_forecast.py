"""Measure the table of ``howto/forecast.md``: ``python docs/make_forecast.py`` (1.5 CPU min).

Prices are read from ``../shared/data/prices``.
"""

from pathlib import Path

from tables import markdown_table

import bess

DOCS = Path(__file__).parent
PRICES = DOCS.parents[1] / "shared" / "data" / "prices"
FILES = {
    "Germany 2024": ("smard_de_viertelstunde_2024_berechnet_resaved.csv", "DE-LU", 2024),
    "Portugal 2024": ("entsoe_gui_PT_2024_60min.csv.gz", "PT", 2024),
    "Hungary 2023": ("entsoe_gui_HU_eur-mwh-column.csv.gz", "HU", 2023),
}
MONTHS = (2, 5, 7, 8, 10, 12)
DAYS = 7.0
FORECASTS = ("perfect", "bands", "expected", "persistence")


def main() -> None:
    """Measure the weeks, and write the table."""
    rows = [["", *(f"`{forecast}`" for forecast in FORECASTS)]]
    total = dict.fromkeys(FORECASTS, 0.0)
    for name, (file, zone, year) in FILES.items():
        for month in MONTHS:
            values = {
                "demand.prices": str(PRICES / file),
                "demand.zone": zone,
                "policy.name": "equal",
                "run.start": f"{year}-{month:02}-08T00:00:00Z",
                "run.days": DAYS,
            }
            nets = {forecast: net_eur(values | {"demand.forecast": forecast}) for forecast in FORECASTS}
            total = {forecast: total[forecast] + net for forecast, net in nets.items()}
            rows.append([f"{name}, {month:02}", *(f"{net:.1f}" for net in nets.values())])
            print(rows[-1], flush=True)
    rows.append(["all", *(f"{each:.0f}" for each in total.values())])
    rows.append(["share of `perfect`", *(f"{each / total['perfect']:.1%}" for each in total.values())])
    text = f"<!-- written by docs/make_forecast.py -->\n\n{markdown_table(rows)}"
    (DOCS / "_cases" / "forecast.md").write_text(text, encoding="utf-8")


def net_eur(values: dict[str, object]) -> float:
    """Net income of a run, from the record of the plant."""
    return float(bess.run(bess.load_study("arbitrage-2024", values), progress=False).kpis["net_eur"])


if __name__ == "__main__":
    main()
