"""Maps and bars over the calendar, inverter states, and temperatures along the air path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from bess.errors import InputError
from bess.report.data import MAX_CURVES, Result, TimeAxis, daily, dataset_of, step_h
from bess.report.drawing import style
from bess.report.drawing.chart import Values
from bess.report.drawing.style import colours, new_figure, styled
from bess.simulation.analysis.catalogue import kpi
from bess.simulation.analysis.settlement import COSTS, REVENUES, has_prices, ledger
from bess.simulation.record.dataset import study_of, with_initial
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import xarray as xr


MIN_MAP_DAYS = 14
_SHADES = 24
"""More shades cannot be told apart, and enlarge the figure of a year several times."""


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
    """Number of calendar months in a result."""
    return len(np.unique(_months(dataset_of(result))))


def _months(dataset: xr.Dataset) -> Values:
    """Month of each step, in the time zone of the market if there is one, whose months begin at midnight."""
    import pandas as pd

    zone = study_of(dataset).get("demand", {}).get("market_time_zone", "UTC")
    local = pd.DatetimeIndex(dataset["time"].values, tz="UTC").tz_convert(zone).tz_localize(None)
    return local.to_numpy().astype("datetime64[M]")


@styled()
def heat_maps(result: Result) -> Figure:
    """Maps of day by hour of the day (UTC): delivered power, mean SOC, hottest string, and price if any."""
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
    figure = new_figure(style.DOUBLE_COLUMN_IN, 1.2 * len(maps) + 0.3)
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
    # A single price peak would leave all other values in one colour.
    low, high = np.nanquantile(shown.values, [0.002, 0.998])
    if shown.around_zero:
        high = max(abs(low), abs(high), 1e-9)
        low = -high
    extent = (float(date2num(first)), float(date2num(first + n_days * day)), 0.0, 24.0)
    shades = colormaps[shown.colours].resampled(_SHADES)
    image = axes.imshow(
        field.reshape(n_days, per_day).T, aspect="auto", origin="lower", extent=extent, cmap=shades,
        vmin=low, vmax=high, interpolation="none",
    )  # fmt: skip
    axes.xaxis_date()
    axes.yaxis.set_major_locator(MultipleLocator(6))
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, pad=0.01, aspect=12)
    bar.set_label(shown.label, fontsize=7.5)
    bar.ax.yaxis.set_major_locator(MaxNLocator(4))


_Bars = tuple[str, list[tuple[str, str, Values]], Values | None]
"""A panel: its label; name, colour and values of its bars; and a line over them."""


@styled()
def monthly_bars(result: Result) -> Figure:
    """Bars for each month: money if there are prices, energy of both directions, losses, and full cycles."""
    dataset = dataset_of(result)
    months, month = np.unique(_months(dataset), return_inverse=True)
    to_mwh = step_h(dataset) / KWH_PER_MWH

    def per_month(values: Values) -> Values:
        return np.bincount(month, values, len(months))

    delivered = dataset["delivered_kw"].values
    panels: list[_Bars] = []
    if has_prices(dataset):
        entries = ledger(dataset)
        signs = {**dict.fromkeys(REVENUES, 1.0), **dict.fromkeys(COSTS, -1.0)}
        shades = (style.DISCHARGE, style.BACKGROUND, *colours(len(signs) - 1)[1:])
        bars = []
        for (name, sign), shade in zip(signs.items(), shades, strict=True):
            if name in entries and np.abs(values := per_month(entries[name].values)).max() > 0.0:
                bars.append((kpi(name).label, shade, sign * values))
        panels.append(("EUR", bars, per_month(entries["net_eur"].values)))
    energy = [
        ("Discharged", style.DISCHARGE, per_month(to_mwh * np.maximum(delivered, 0.0).sum(axis=1))),
        ("Charged", style.CHARGE, -per_month(to_mwh * np.maximum(-delivered, 0.0).sum(axis=1))),
    ]
    panels.append(("MWh", energy, None))
    lost = [
        (kpi(f"{name}_kwh").label, colour, per_month(to_mwh * dataset[f"{name}_kw"].values.sum(axis=1)))
        for name, colour in style.LOSSES.items()
        if name.endswith("_loss") and f"{name}_kw" in dataset
    ]
    panels.append(("MWh", lost, None))
    travelled = np.abs(np.diff(with_initial(dataset, "soc"), axis=0)).mean(axis=1) / 2.0
    panels.append(("Full cycles", [("", style.INK, per_month(travelled))], None))
    return _draw_months(months, panels)


def _draw_months(months: Values, panels: list[_Bars]) -> Figure:
    figure = new_figure(style.DOUBLE_COLUMN_IN, 1.45 * len(panels))
    rows = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    places = np.arange(len(months))
    for axes, (unit, bars, net) in zip(rows, panels, strict=True):
        above, below = np.zeros(len(months)), np.zeros(len(months))
        for name, colour, values in bars:
            base = np.where(values >= 0.0, above, below)
            axes.bar(places, values, 0.72, bottom=base, color=colour, label=name or None)
            above += np.maximum(values, 0.0)
            below += np.minimum(values, 0.0)
        if net is not None:
            label = kpi("net_eur").label
            axes.plot(places, net, "o-", color=style.INK, markersize=3.5, linewidth=1.0, label=label)
        axes.axhline(0.0, color=style.INK, linewidth=0.6)
        axes.set_ylabel(unit)
        axes.grid(visible=False, axis="x")
        if len(bars) > 1:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    every = -(-len(months) // 18)
    names = [np.datetime_as_string(value, unit="M") for value in months]
    rows[-1].set_xticks(places[::every], names[::every], rotation=30 if len(months) > 8 else 0)
    return figure


_CHARGING, _OFF, _DISCHARGING, _REACTIVE = "#56B4E9", "#EFEFEF", "#D55E00", "#009E73"


@styled()
def inverter_pattern(result: Result) -> Figure:
    """Inverter states: charge, discharge, off; for runs above a month, hours of operation on each day."""
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    running = np.sign(np.round(dataset["delivered_kw"].values, 6))
    if "reactive_kvar" in dataset:
        alone = (running == 0.0) & (np.round(dataset["reactive_kvar"].values, 6) != 0.0)
        running = np.where(alone, 2.0, running)
    n_strings = running.shape[1]
    height = 0.85 + min(0.3 * n_strings, 3.2 + 0.02 * n_strings)
    figure = new_figure(style.DOUBLE_COLUMN_IN, height)
    axes = figure.subplots()
    place: dict[str, Any] = {
        "aspect": "auto",
        "interpolation": "nearest",
        "extent": (*_horizontal(axes, time), n_strings - 0.5, -0.5),
        "rasterized": True,
    }
    if time.daily:
        hours = 24.0 * daily(time, (running != 0.0).astype(np.float64))[2]
        image = axes.imshow(hours.T, cmap="viridis", vmin=0.0, vmax=24.0, **place)
        figure.colorbar(image, ax=axes, label="Hours on per day", pad=0.01)
    else:
        norm = BoundaryNorm([-1.5, -0.5, 0.5, 1.5, 2.5], 4)
        states = ListedColormap([_CHARGING, _OFF, _DISCHARGING, _REACTIVE])
        axes.imshow(running.T, cmap=states, norm=norm, **place)
        named = [(_CHARGING, "on, charging"), (_DISCHARGING, "on, discharging"), (_OFF, "off")]
        if (running == 2.0).any():
            named.insert(2, (_REACTIVE, "on, reactive power alone"))
        handles = [Patch(color=colour, label=name) for colour, name in named]
        figure.legend(handles=handles, loc="outside upper center", ncols=len(named))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=12, integer=True, min_n_ticks=1))
    axes.grid(visible=False)
    if n_strings <= MAX_CURVES:
        axes.set_yticks(np.arange(n_strings - 1) + 0.5, minor=True)
        axes.grid(visible=True, which="minor", axis="y", color="white", linewidth=min(3.0, 24.0 / n_strings))
    axes.tick_params(which="minor", length=0)
    axes.set_ylabel("String")
    axes.set_xlabel(time.label)
    return figure


@styled()
def node_temperatures(result: Result) -> Figure:
    """Space-time map of node temperatures along the air path, a panel for each string, one colour scale.

    Raises
    ------
    InputError
        The temperatures of nodes were not recorded.
    """
    dataset = dataset_of(result)
    if "node_temperature_c" not in dataset:
        raise InputError("the result has no node_temperature_c; set output.node_temperatures in the study")
    time = TimeAxis(dataset)
    field = dataset["node_temperature_c"]
    n_strings, n_nodes = field.sizes["string"], field.sizes["node"]
    columns = 1 if n_strings <= 3 else (2 if n_strings <= 8 else 4)
    rows = -(-n_strings // columns)
    height = 2.0 if rows == 1 else (1.35 if rows <= 4 else 0.95)
    figure = new_figure(style.DOUBLE_COLUMN_IN, rows * height + 0.5)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for index, axes in enumerate(panels):
        if index >= n_strings:
            axes.remove()
            continue
        image = axes.imshow(
            field.isel(string=index).values.T, aspect="auto", origin="lower", cmap="inferno",
            extent=(*_horizontal(axes, time), -0.5, n_nodes - 0.5), rasterized=True,
            vmin=float(field.min()), vmax=float(field.max()),
        )  # fmt: skip
        axes.set_title(f"string {index}", loc="left", fontsize=7.5, pad=2)
        axes.grid(visible=False)
        axes.tick_params(labelbottom=index + columns >= n_strings)
    figure.supylabel("Node (0 = air inlet)", fontsize=8)
    figure.supxlabel(time.label, fontsize=8)
    figure.colorbar(image, ax=list(panels[:n_strings]), label="Temperature (°C)", aspect=30, pad=0.01)
    return figure


def _horizontal(axes: Any, time: TimeAxis) -> tuple[float, float]:
    """Ends of the time axis as numbers; images do not take dates themselves."""
    if not np.issubdtype(time.edges.dtype, np.datetime64):
        return float(time.edges[0]), float(time.edges[-1])
    axes.xaxis_date()
    return float(date2num(time.edges[0])), float(date2num(time.edges[-1]))
