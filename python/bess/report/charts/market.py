"""Market studies: price, what was sold and bought, and the energy in store."""

from __future__ import annotations

from bess.errors import InputError
from bess.report.chart import Chart, Panel
from bess.report.data import Result, TimeAxis, dataset_of, with_initial
from bess.report.long_runs import curve
from bess.report.style import BATTERY, DISCHARGE, INK, INVERTER


def market_dispatch(result: Result) -> Chart:
    """Price, dispatch (demand and delivered power) and mean SOC of a market study."""
    dataset = dataset_of(result)
    if "price_eur_mwh" not in dataset:
        raise InputError("the result has no price_eur_mwh: it is not a market study")
    time = TimeAxis(dataset)
    delivered = dataset["delivered_kw"].values.sum(axis=1)
    price = curve(time, dataset["price_eur_mwh"].values, INVERTER, kind="step")
    power = curve(time, delivered, DISCHARGE, "delivered, positive = sold", kind="step")
    power += curve(time, dataset["demand_kw"].values, INK, "asked for", kind="step", dashed=True, band=False)
    soc = curve(time, with_initial(dataset, "soc").mean(axis=1), BATTERY)
    return Chart(
        time.label,
        (
            Panel("Price (EUR/MWh)", tuple(price)),
            Panel("Power (kW)", tuple(power)),
            Panel("Mean SOC", tuple(soc), y_limits=(-0.02, 1.02)),
        ),
        panel_height_in=1.35,
    )
