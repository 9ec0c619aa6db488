"""Maps over time: inverter states, and temperatures along the air path."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from bess.errors import InputError
from bess.report.charts.long_runs import MAX_CURVES, daily
from bess.report.data import Result, TimeAxis, dataset_of
from bess.report.drawing.style import DOUBLE_COLUMN_IN, new_figure, styled

_CHARGING, _OFF, _DISCHARGING, _REACTIVE = "#56B4E9", "#EFEFEF", "#D55E00", "#009E73"


@styled
def inverter_pattern(result: Result) -> Figure:
    """Which inverter charges, discharges or is off; of more than a month, the hours on of each day."""
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    running = np.sign(np.round(dataset["delivered_kw"].values, 6))
    if "reactive_kvar" in dataset:
        alone = (running == 0.0) & (np.round(dataset["reactive_kvar"].values, 6) != 0.0)
        running = np.where(alone, 2.0, running)
    n_strings = running.shape[1]
    height = 0.85 + min(0.3 * n_strings, 3.2 + 0.02 * n_strings)
    figure = new_figure(DOUBLE_COLUMN_IN, height)
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


@styled
def node_temperatures(result: Result) -> Figure:
    """Space-time map of node temperatures along the air path, a panel for each string, one colour scale.

    Raises
    ------
    InputError
        The temperatures of nodes were not recorded.
    """
    dataset = dataset_of(result)
    if "node_temperature_c" not in dataset:
        raise InputError("the result has no node_temperature_c; ask for it in the study's [output]")
    time = TimeAxis(dataset)
    field = dataset["node_temperature_c"]
    n_strings, n_nodes = field.sizes["string"], field.sizes["node"]
    columns = 1 if n_strings <= 3 else (2 if n_strings <= 8 else 4)
    rows = -(-n_strings // columns)
    height = 2.0 if rows == 1 else (1.35 if rows <= 4 else 0.95)
    figure = new_figure(DOUBLE_COLUMN_IN, rows * height + 0.5)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    low, high = float(field.min()), float(field.max())
    shade: dict[str, Any] = {"cmap": "inferno", "vmin": low, "vmax": high, "origin": "lower"}
    for index, axes in enumerate(panels):
        if index >= n_strings:
            axes.remove()
            continue
        axes.imshow(
            field.isel(string=index).values.T,
            aspect="auto",
            extent=(*_horizontal(axes, time), -0.5, n_nodes - 0.5),
            rasterized=True,
            **shade,
        )
        axes.set_title(f"string {index}", loc="left", fontsize=7.5, pad=2)
        axes.grid(visible=False)
        axes.tick_params(labelbottom=index + columns >= n_strings)
    figure.supylabel("Node (0 = air inlet)", fontsize=8)
    figure.supxlabel(time.label, fontsize=8)
    scale = ScalarMappable(Normalize(low, high), "inferno")
    figure.colorbar(scale, ax=list(panels[:n_strings]), label="Temperature (°C)", aspect=30, pad=0.01)
    return figure


def _horizontal(axes: Any, time: TimeAxis) -> tuple[float, float]:
    """Ends of the time axis as numbers; images do not take dates themselves."""
    if not np.issubdtype(time.edges.dtype, np.datetime64):
        return float(time.edges[0]), float(time.edges[-1])
    axes.xaxis_date()
    return float(date2num(time.edges[0])), float(date2num(time.edges[-1]))
