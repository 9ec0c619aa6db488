"""Measure the tables about several markets: ``python docs/make_markets.py`` (15 CPU min).

Prices and frequency are read from ``../shared/data``. The months are drawn at random (seed 26).
"""

from pathlib import Path
from typing import Any

import numpy as np
from tables import markdown_table

import bess

DOCS = Path(__file__).parent
DATA = DOCS.parents[1] / "shared" / "data"
INTRADAY = DATA / "prices" / "energy-charts_de_intraday15_2021.csv"
DAYS = 7.0
FORECASTS = ("perfect", "persistence")
FIXED_KW = (35.0, 70.0, 105.0, 140.0)


def main() -> None:
    """Measure both tables, and write them."""
    months = sorted((1 + np.random.default_rng(26).choice(12, 3, replace=False)).tolist())
    chosen = [f"chosen, `{forecast}`" for forecast in FORECASTS]
    rows = [["2024", *(f"{kw:g} kW" for kw in FIXED_KW), *chosen]]
    for month in months:
        nets = [reserve(month, capacity_kw=kw)["net_eur"] for kw in FIXED_KW]
        nets += [
            reserve(month, capacity_kw=FIXED_KW[-1], choose_capacity=each)["net_eur"] for each in FORECASTS
        ]
        rows.append([f"{month:02}", *(f"{net:.0f}" for net in nets)])
        print(rows[-1], flush=True)
    write("markets-reserve", rows)
    rows = [["2021", "`forecast`", "auction", "ID3", "both", "gain"]]
    # Without foresight the dispatch is made anew in every step, so there is one month of it.
    for month, forecast in [*((each, "perfect") for each in months), (months[0], "persistence")]:
        auction = traded(month, forecast, "auction")["net_eur"]
        last = traded(month, forecast, "id3")["net_eur"]
        both = traded(month, forecast, "id3", "auction")["net_eur"]
        nets = (f"{net:.0f}" for net in (auction, last, both))
        rows.append([f"{month:02}", f"`{forecast}`", *nets, f"{both / max(auction, last) - 1.0:.0%}"])
        print(rows[-1], flush=True)
    write("markets-auctions", rows)


def traded(month: int, forecast: str, last: str, *auctions: str) -> dict[str, float]:
    """Key figures in 15-minute intraday markets, without wear."""
    values: dict[str, Any] = {
        "demand.prices": str(INTRADAY),
        "demand.product": last,
        "demand.forecast": forecast,
        "policy.name": "equal",
        "wear.model": "none",
        "run.start": f"2021-{month:02}-01T00:00:00Z",
        "run.days": DAYS,
    }
    if auctions:
        values["demand.market"] = [{"name": name, "product": name, "step_min": 15.0} for name in auctions]
    return bess.run(bess.load_study("arbitrage-2024", values), progress=False).kpis


def reserve(month: int, **keys: object) -> dict[str, float]:
    """Key figures of reserve and trade together, at prices of the tenders and of the day-ahead market."""
    values = {
        "demand.prices": str(DATA / "prices" / "smard_de_viertelstunde_2024_berechnet_resaved.csv"),
        "demand.capacity_prices": str(DATA / "fcr" / "fcr_prices_regelleistung_2024.csv.gz"),
        "demand.frequency": str(DATA / "bess" / "frequency_france_2019_05_10s.csv.zip"),
        "demand.time_zone": "UTC",
        "demand.repeat": True,
        "policy.name": "equal",
        "run.start": f"2024-{month:02}-01T00:00:00Z",
        "run.days": DAYS,
        **{f"demand.{key}": value for key, value in keys.items()},
    }
    return bess.run(bess.load_study("fcr-arbitrage", values), progress=False).kpis


def write(name: str, rows: list[list[str]]) -> None:
    """Write a table of the page."""
    text = f"<!-- written by docs/make_markets.py -->\n\n{markdown_table(rows)}"
    (DOCS / "_cases" / f"{name}.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
