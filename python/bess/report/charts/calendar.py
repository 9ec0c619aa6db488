"""Long runs by the calendar: an hour-by-day map for each quantity, and bars for each month."""

from __future__ import annotations

import tomllib
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from bess.errors import InputError
from bess.report.data import Result, dataset_of, step_h, with_initial
from bess.report.drawing.chart import Values
from bess.report.drawing.style import (
    AVAILABILITY,
    BACKGROUND,
    BATTERY,
    CHARGE,
    DERATING,
    DISCHARGE,
    DOUBLE_COLUMN_IN,
    HYSTERESIS,
    INK,
    INVERTER,
    colours,
    new_figure,
    styled,
)
from bess.simulation.analysis.catalogue import kpi
from bess.simulation.analysis.settlement import COSTS, REVENUES, has_prices, ledger
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import xarray as xr

SHORTEST_MAP_DAYS = 14
_SHADES = 24
"""More cannot be told apart, and make a picture of a year several times as large."""
_LOSSES = (
    ("derating_loss_kw", DERATING),
    ("availability_loss_kw", AVAILABILITY),
    ("inverter_loss_kw", INVERTER),
    ("battery_loss_kw", BATTERY),
    ("hysteresis_loss_kw", HYSTERESIS),
)


class _Map(NamedTuple):
    label: str
    values: Values
    colours: str
    around_zero: bool = False


def days_of(result: Result) -> float:
    """Length of a result in days."""
    dataset = dataset_of(result)
    return dataset.sizes["time"] * step_h(dataset) / 24.0


def months_of(result: Result) -> int:
    """Number of calendar months a result touches."""
    return len(np.unique(_months(dataset_of(result))))


def _months(dataset: xr.Dataset) -> Values:
    """Month of each step, in the time zone of the market if there is one: its year begins at midnight."""
    import pandas as pd

    study = tomllib.loads(dataset.attrs.get("study", ""))
    zone = study.get("demand", {}).get("market_time_zone", "UTC")
    local = pd.DatetimeIndex(dataset["time"].values, tz="UTC").tz_convert(zone).tz_localize(None)
    return local.to_numpy().astype("datetime64[M]")


@styled
def heat_maps(result: Result) -> Figure:
    """Day across, hour of the day (UTC) up: delivered power, mean SOC, hottest string, and price if any.

    Raises
    ------
    InputError
        The run is shorter than two days.
    """
    dataset = dataset_of(result)
    if days_of(dataset) < 2.0:
        raise InputError(f"heat_maps: the run has {days_of(dataset):g} days; a map needs at least 2")
    maps = [
        _Map("Power (kW)", dataset["delivered_kw"].values.sum(axis=1), "RdBu", around_zero=True),
        _Map("Mean SOC", dataset["soc"].values.mean(axis=1), "viridis"),
        _Map("Hottest string (°C)", dataset["temperature_c"].values.max(axis=1), "inferno"),
    ]
    if has_prices(dataset):
        maps.append(_Map("Price (EUR/MWh)", dataset["price_eur_mwh"].values, "cividis"))
    figure = new_figure(DOUBLE_COLUMN_IN, 1.2 * len(maps) + 0.3)
    rows = figure.subplots(len(maps), 1, sharex=True, squeeze=False)[:, 0]
    for axes, each in zip(rows, maps, strict=True):
        _draw_map(figure, axes, dataset["time"].values, each)
    figure.supylabel("Hour of the day (UTC)", fontsize=8)
    return figure


def _draw_map(figure: Figure, axes: Axes, times: Values, shown: _Map) -> None:
    day = np.timedelta64(1, "D")
    step = times[1] - times[0]
    per_day = max(round(day / step), 1)
    first = times[0].astype("datetime64[D]")
    skipped = round((times[0] - first) / step)
    n_days = -(-(skipped + len(times)) // per_day)
    field = np.full(n_days * per_day, np.nan)
    field[skipped : skipped + len(times)] = shown.values
    # A single peak of a price would leave all else in one colour.
    low, high = np.nanquantile(shown.values, [0.002, 0.998])
    norm: Any = Normalize(low, high)
    if shown.around_zero:
        reach = max(abs(low), abs(high), 1e-9)
        norm = TwoSlopeNorm(0.0, -reach, reach)
    extent = (float(date2num(first)), float(date2num(first + n_days * day)), 0.0, 24.0)
    shades = colormaps[shown.colours].resampled(_SHADES)
    image = axes.imshow(
        field.reshape(n_days, per_day).T, aspect="auto", origin="lower", extent=extent, cmap=shades,
        norm=norm, interpolation="none",
    )  # fmt: skip
    axes.xaxis_date()
    axes.yaxis.set_major_locator(MultipleLocator(6))
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, pad=0.01, aspect=12)
    bar.set_label(shown.label, fontsize=7.5)
    bar.ax.yaxis.set_major_locator(MaxNLocator(4))


@styled
def monthly_bars(result: Result) -> Figure:
    """Bars for each month: money if there are prices, energy of both directions, losses, and full cycles."""
    dataset = dataset_of(result)
    months, month = np.unique(_months(dataset), return_inverse=True)
    to_mwh = step_h(dataset) / KWH_PER_MWH

    def per_month(values: Values) -> Values:
        return np.bincount(month, values, len(months))

    delivered = dataset["delivered_kw"].values
    panels: list[tuple[str, list[tuple[str, str, Values]], Values | None]] = []
    if has_prices(dataset):
        entries = ledger(dataset)
        shades = dict(
            zip(
                (*REVENUES, *COSTS),
                (DISCHARGE, BACKGROUND, *colours(len(REVENUES + COSTS) - 1)[1:]),
                strict=True,
            )
        )
        signed = [*((name, 1.0) for name in REVENUES), *((name, -1.0) for name in COSTS)]
        bars = []
        for name, sign in signed:
            if name in entries and np.abs(values := per_month(entries[name].values)).max() > 0.0:
                bars.append((kpi(name).label, shades[name], sign * values))
        panels.append(("EUR", bars, per_month(entries["net_eur"].values)))
    energy = [
        ("Discharged", DISCHARGE, per_month(to_mwh * np.maximum(delivered, 0.0).sum(axis=1))),
        ("Charged", CHARGE, -per_month(to_mwh * np.maximum(-delivered, 0.0).sum(axis=1))),
    ]
    panels.append(("MWh", energy, None))
    lost = [
        (
            kpi(name.removesuffix("_kw") + "_kwh").label,
            colour,
            per_month(to_mwh * dataset[name].values.sum(axis=1)),
        )
        for name, colour in _LOSSES
        if name in dataset
    ]
    panels.append(("MWh", lost, None))
    travelled = np.abs(np.diff(with_initial(dataset, "soc"), axis=0)).mean(axis=1) / 2.0
    panels.append(("Full cycles", [("", INK, per_month(travelled))], None))
    return _draw_months(months, panels)


def _draw_months(
    months: Values, panels: list[tuple[str, list[tuple[str, str, Values]], Values | None]]
) -> Figure:
    figure = new_figure(DOUBLE_COLUMN_IN, 1.45 * len(panels))
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    places = np.arange(len(months))
    for axes, (label, bars, net) in zip(rows, panels, strict=True):
        above, below = np.zeros(len(months)), np.zeros(len(months))
        for name, colour, values in bars:
            base = np.where(values >= 0.0, above, below)
            axes.bar(places, values, 0.72, bottom=base, color=colour, label=name or None)
            above += np.maximum(values, 0.0)
            below += np.minimum(values, 0.0)
        if net is not None:
            axes.plot(
                places, net, color=INK, marker="o", markersize=3.5, linewidth=1.0, label=kpi("net_eur").label
            )
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.set_ylabel(label)
        axes.grid(visible=False, axis="x")
        if len(bars) > 1:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    every = -(-len(months) // 18)
    names = [np.datetime_as_string(value, unit="M") for value in months]
    rows[-1].set_xticks(places[::every], names[::every], rotation=30 if len(months) > 8 else 0)
    return figure
