"""Operation over time: states, powers, market, services and solver, selected and arranged as charts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bess.errors import InputError
from bess.report.data import (
    MAX_CURVES,
    Result,
    Results,
    TimeAxis,
    curve,
    daily,
    dataset_of,
    event_spans,
    held,
    string_curves,
    thin,
    told_apart,
)
from bess.report.drawing import style
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import colours
from bess.simulation.analysis.services import draw_kw, is_reserve, is_site
from bess.simulation.record.dataset import with_initial
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr


def strings(result: Result) -> Chart:
    """SOC and mean temperature of every string, with the demand behind.

    Runs of more than a month are shown as the daily mean of every string, with the daily range over all
    strings behind.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    n_strings = dataset.sizes["string"]
    demand = None
    if not time.daily:
        (demand,) = curve(
            time,
            dataset["demand_kw"].values,
            style.BACKGROUND,
            "demand, positive = discharge",
            kind="band",
        )
    panels = []
    for variable, label, limits in (
        ("soc", "SOC", (-0.02, 1.02)),
        ("temperature_c", "Temperature (°C)", None),
    ):
        states = with_initial(dataset, variable)
        lines: list[Series] = []
        if time.daily and n_strings <= MAX_CURVES:
            days, low, _, high = daily(time, states[1:])
            base = held(low.min(axis=1))
            lines.append(Series(days, held(high.max(axis=1)), "#DDDDDD", "daily range", "band", base))
        lines += string_curves(time, states, quantities=2)
        panels.append(Panel(label, lines, demand, "Demand (kW)", y_limits=limits))
    return Chart(time.label, panels, panel_height_in=1.75, spans=event_spans(dataset, time))


def string_spread(results: Results) -> Chart:
    """Largest difference between strings in SOC and in mean temperature, for one result or several."""
    panels = []
    for variable, label, factor in (
        ("soc", "SOC spread (points)", 100.0),
        ("temperature_c", "Temperature spread (K)", 1.0),
    ):
        lines: list[Series] = []
        for name, dataset, colour, dashed in told_apart(results):
            time = TimeAxis(dataset)
            spread = factor * np.ptp(with_initial(dataset, variable), axis=1)
            lines += curve(time, spread, colour, name, dashed=dashed)
        panels.append(Panel(label, lines))
    return Chart(time.label, panels, panel_height_in=1.4)


def mean_temperature(results: Results, *, derating_start_c: float = 45.0) -> Chart:
    """Mean over strings of the temperature, for one result or several, with the start of derating [degC]."""
    lines: list[Series] = []
    for name, dataset, colour, dashed in told_apart(results):
        time = TimeAxis(dataset)
        lines += curve(time, with_initial(dataset, "temperature_c").mean(axis=1), colour, name, dashed=dashed)
    ends, limit = time.edges[[0, -1]], np.full(2, derating_start_c)
    lines.append(Series(ends, limit, style.INK, f"derating starts, {derating_start_c:g} °C", dashed=True))
    return Chart(time.label, (Panel("Mean temperature (°C)", lines),), panel_height_in=2.4)


def derating_curves(
    system: System, gains: Sequence[tuple[float, float]] | None = None, *, string: int = 0
) -> Chart:
    """Derating factor against temperature for several pairs of gains, and the table of the system.

    Parameters
    ----------
    system
        Its string ``string`` gives start and stop temperature, its own gains, and the table.
    gains
        Pairs ``(kp [1/K], ki [1/(K step)])``; half, once and twice the system's own if omitted.

    Notes
    -----
    Response of the PI law to a constant ramp of ``r`` K per control step,
    ``k = clip(1 - kp e - ki e^2 / (2 r), 0, 1)`` with ``e = T - T_start``. With the slope ``r``, the system's
    own gains reach zero exactly at ``stop_c``; without ``stop_c``, the integral part is omitted.
    """
    law = system.strings[string].derating
    reach = law.stop_c - law.start_c
    left = 1.0 - law.kp_per_k * reach
    ramp = law.ki_per_k_step * reach**2 / (2.0 * left) if left > 0.0 and law.ki_per_k_step > 0.0 else np.inf
    if gains is None:
        gains = [(factor * law.kp_per_k, factor * law.ki_per_k_step) for factor in (0.5, 1.0, 2.0)]
    temperature = np.linspace(law.start_c - 5.0, law.stop_c + 10.0, 301)
    excess = np.maximum(temperature - law.start_c, 0.0)
    lines = [
        Series(
            temperature,
            np.clip(1.0 - kp * excess - ki * excess**2 / (2.0 * ramp), 0.0, 1.0),
            colour,
            f"Kₚ = {kp:.3g} 1/K, Kᵢ = {ki:.2g} 1/(K step)",
        )
        for (kp, ki), colour in zip(gains, colours(len(gains)), strict=True)
    ]
    lines.append(Series(np.array(law.temperature_c), np.array(law.factor), style.INK, "table in use", "dots"))
    return Chart(
        "String temperature (°C)",
        (Panel("Derating factor", lines, y_limits=(-0.03, 1.05)),),
        panel_height_in=2.5,
        width_in=style.SINGLE_COLUMN_IN,
    )


def state_of_health(result: Result) -> Chart:
    """Capacity and resistance of every string relative to the system file, and accumulated wear cost."""
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    cost_eur = np.cumsum(np.vstack([np.zeros(dataset.sizes["string"]), dataset["wear_eur"].values]), axis=0)
    rows = (
        ("Capacity (%)", 100.0 * with_initial(dataset, "soh_capacity")),
        ("Resistance (%)", 100.0 * with_initial(dataset, "soh_resistance")),
        ("Wear so far (EUR)", cost_eur),
    )
    panels = [Panel(label, string_curves(time, states)) for label, states in rows]
    return Chart(time.label, panels, panel_height_in=1.4, spans=event_spans(dataset, time))


_POINTS = 400


def duration_curves(results: Results) -> Chart:
    """Delivered power of the plant and temperature of its hottest string, each sorted from high to low.

    A point of a curve gives the share of the time in which the value was at least this high. For a single
    result the demand is drawn as well.
    """
    power: list[Series] = []
    temperature: list[Series] = []
    apart = list(told_apart(results))
    for name, dataset, colour, dashed in apart:
        delivered = dataset["delivered_kw"].values.sum(axis=1)
        hottest = dataset["temperature_c"].values.max(axis=1)
        label = name or "delivered"
        power.append(Series(*_sorted(delivered), colour, label, dashed=dashed))
        temperature.append(Series(*_sorted(hottest), colour, name, dashed=dashed))
    if len(apart) == 1:  # over the curve of the delivered power, which it often equals
        power.append(Series(*_sorted(dataset["demand_kw"].values), style.INK, "demand", dashed=True))
    return Chart(
        "Share of the time (%)",
        (Panel("Plant power (kW)", power), Panel("Hottest string (°C)", temperature)),
        panel_height_in=1.7,
    )


def _sorted(values: Values) -> tuple[Values, Values]:
    if values.size == 1:  # a single point draws no line
        return np.array([0.0, 100.0]), np.repeat(values, 2)
    falling = np.sort(values)[::-1]
    shown = np.unique(np.linspace(0, len(falling) - 1, _POINTS).astype(int))
    return 100.0 * (shown + 0.5) / len(falling), falling[shown]


_MAX_STRINGS = 4

_REQUEST = ("delivered", "derating_loss", "availability_loss")
_CONVERSION = ("inverter_loss", "battery_loss", "hysteresis_loss")


def power_split(result: Result) -> Chart:
    """Power of every string, stacked: requests as delivered + undelivered (left), losses (right).

    The left stack is the request, upwards in discharge, downwards in charge. More than four strings are drawn
    as their sum, because their stacks would not be readable. Runs of more than a month are drawn as daily
    means of charge and of discharge, which would otherwise cancel.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    n_strings = dataset.sizes["string"]
    apart = n_strings <= _MAX_STRINGS
    groups = [[index] for index in range(n_strings)] if apart else [list(range(n_strings))]
    discharging = dataset["request_kw"].values > 0.0
    panels = []
    for group in groups:
        title = f"string {group[0]}" if apart else f"sum of {n_strings} strings"
        strings = dataset.isel(string=group)
        up = discharging[:, group]
        request = _stack(time, strings, _REQUEST, up) + _stack(time, strings, _REQUEST, -1.0 * ~up)
        losses = _stack(time, strings, _CONVERSION, np.ones_like(up))
        nothing = curve(time, np.zeros(len(time.start)), style.INK, kind="step")
        panels += [
            Panel("Requested (kW)", request or nothing, title=title),
            Panel("Loss (kW)", losses or nothing, title=title),
        ]
    # A single row needs room for the legend.
    height_in = 1.5 if len(groups) > 1 else 2.4
    return Chart(time.label, panels, columns=2, panel_height_in=height_in, spans=event_spans(dataset, time))


def _stack(time: TimeAxis, strings: xr.Dataset, parts: Sequence[str], factor: Values) -> list[Series]:
    """Bands of powers, summed over the strings and stacked from zero; ``factor``: 1 upwards, -1 downwards."""
    bands: list[Series] = []
    edges, base = time.edges, np.zeros(1)
    for name in parts:
        if f"{name}_kw" not in strings:
            continue
        power = (np.abs(strings[f"{name}_kw"].values) * factor).sum(axis=1)
        if not power.any():
            continue
        if time.daily:
            edges, _, power, _ = daily(time, power)
        top = base + held(power)
        colour = style.LOSSES.get(name, style.DISCHARGE)
        bands.append(Series(edges, top, colour, name.replace("_", " "), "band", base))
        base = top
    return bands


def reactive_power(result: Result) -> Chart:
    """Reactive power of the plant; reactive and apparent power of every string.

    Raises
    ------
    InputError
        The run has no reactive power.
    """
    dataset = dataset_of(result)
    if "reactive_kvar" not in dataset:
        raise InputError("the result has no reactive_kvar; set [reactive] in the study")
    time = TimeAxis(dataset)
    q_kvar = dataset["reactive_kvar"].values
    apparent_kva = np.hypot(dataset["delivered_kw"].values, q_kvar)
    delivered_kvar, demand_kvar = q_kvar.sum(axis=1), dataset["reactive_demand_kvar"].values
    plant = curve(time, delivered_kvar, style.INK, "delivered", kind="step")
    plant += curve(time, demand_kvar, style.AVAILABILITY, "demand", kind="step", dashed=True)
    panels = (
        Panel("Plant (kvar)", plant, y_limits=_with_zero(delivered_kvar, demand_kvar)),
        Panel("Strings (kvar)", string_curves(time, q_kvar)),
        Panel("Strings (kVA)", string_curves(time, apparent_kva)),
    )
    return Chart(time.label, panels, panel_height_in=1.35, spans=event_spans(dataset, time))


def _with_zero(*values: Values) -> tuple[float, float]:
    """Axis limits that include zero and all values; otherwise constant values would show rounding errors."""
    low, high = (float(end([end(each) for each in values] + [0.0])) for end in (np.min, np.max))
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def market_dispatch(result: Result) -> Chart:
    """Price, dispatch and mean SOC of a market study; for more than a month, daily energy.

    If the dispatch predicts the delivered power, the prediction is shown as well.

    Raises
    ------
    InputError
        The run has no prices.
    """
    dataset = dataset_of(result)
    if "price_eur_mwh" not in dataset:
        raise InputError("the result has no price_eur_mwh: it is not a market study")
    time = TimeAxis(dataset)
    strings_kw = dataset["delivered_kw"].values
    delivered = strings_kw.sum(axis=1)
    planned = dataset["expected_kw"].values if "expected_kw" in dataset else None
    steps = partial(curve, time, kind="step")
    panels = [Panel("Price (EUR/MWh)", steps(dataset["price_eur_mwh"].values, style.INVERTER))]
    if time.daily:
        sold = _per_day(time, np.maximum(strings_kw, 0.0).sum(axis=1), style.DISCHARGE, "sold")
        bought = _per_day(time, np.minimum(strings_kw, 0.0).sum(axis=1), style.CHARGE, "bought")
        panels.append(Panel("Energy per day (kWh)", (sold, bought)))
        if planned is not None:
            # Planned minus delivered energy; negative if the plan was exceeded.
            short_kw = np.abs(planned) - np.abs(delivered)
            short = _per_day(time, short_kw, style.DERATING, "planned less delivered")
            panels.append(Panel("Short of plan (kWh/day)", (short,)))
    else:
        lines = steps(delivered, style.DISCHARGE, "delivered, positive = sold")
        lines += steps(dataset["demand_kw"].values, style.INK, "demand", dashed=True)
        if planned is not None:
            lines += steps(planned, style.DERATING, "planned to be delivered", dashed=True)
        panels.append(Panel("Power (kW)", lines))
    soc = curve(time, with_initial(dataset, "soc").mean(axis=1), style.BATTERY)
    panels.append(Panel("Mean SOC", soc, y_limits=(-0.02, 1.02)))
    return Chart(time.label, panels, panel_height_in=1.35)


def _per_day(time: TimeAxis, power_kw: Values, colour: str, label: str) -> Series:
    """Energy of each day."""
    days, _, mean, _ = daily(time, power_kw)
    return Series(days, held(mean * time.steps_per_day * time.step_h), colour, label, "band")


def service(result: Result) -> Chart:
    """Frequency, power and required window of a reserve; load, grid import and SOC behind a meter.

    Raises
    ------
    InputError
        The run is not of a service.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    soc = curve(time, with_initial(dataset, "soc").mean(axis=1), style.BATTERY, "mean over the strings")
    steps = partial(curve, time, kind="step")
    power = steps(dataset["delivered_kw"].values.sum(axis=1), style.DISCHARGE, "delivered")
    if is_reserve(dataset):
        power += steps(dataset["schedule_kw"].values, style.AVAILABILITY, "scheduled")
        for name in ("soc_low", "soc_high"):
            soc += steps(dataset[name].values, style.AVAILABILITY, "required window", dashed=True)
        first = Panel("Frequency (mHz from nominal)", steps(dataset["frequency_mhz"].values, style.INK))
    elif is_site(dataset):
        load = steps(dataset["load_kw"].values, style.BACKGROUND, "load")
        if np.any(dataset["generation_kw"].values > 0.0):
            load += steps(dataset["generation_kw"].values, style.CHARGE, "generation")
        load += steps(draw_kw(dataset)[1], style.INK, "drawn from the grid")
        if "grid_limit_kw" in dataset:
            load += steps(dataset["grid_limit_kw"].values, style.AVAILABILITY, "limit", dashed=True)
        first = Panel("Site (kW)", load)
    else:
        raise InputError("the result has neither response_kw nor load_kw: it is not of a service")
    panels = (first, Panel("Plant (kW)", power), Panel("SOC", soc, y_limits=(-0.02, 1.02)))
    return Chart(time.label, panels, panel_height_in=1.35)


_MIN_GAP_PCT = 1e-4
_MAX_DOTS = 800


def solver_effort(result: Result, solve_time_s: ArrayLike | None = None) -> Chart:
    """Solve time, nodes and gap of every step; steps with a fallback are marked.

    Parameters
    ----------
    result
        Result of a policy that optimises.
    solve_time_s
        Wall-clock time of each step [s], as in ``log.jsonl``; without it, there is no panel of solve times.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    nodes = dataset["solver_nodes"].values.astype(float)
    gaps = (
        ("rigorous gap", 100.0 * dataset["solver_gap"].values, style.DISCHARGE),
        ("search gap", 100.0 * dataset["solver_search_gap"].values, style.BATTERY),
    )
    panels = []
    if solve_time_s is not None:
        spent = 1e3 * np.asarray(solve_time_s, dtype=float)
        panels.append(
            Panel("Solve time (ms)", (_dots(time.start, spent, style.INVERTER),), log=bool(np.any(spent > 0)))
        )
    effort = [_dots(time.start, nodes, style.DISCHARGE)]
    fell_back = dataset["fallback"].values.astype(bool)
    if fell_back.any():
        effort.append(_dots(time.start[fell_back], nodes[fell_back], style.AVAILABILITY, "fallback"))
    panels.append(Panel("Nodes", effort))
    shown = [
        _dots(time.start, np.maximum(gap, _MIN_GAP_PCT), colour, label)
        for label, gap, colour in gaps
        if np.any(np.isfinite(gap))
    ]
    if shown:
        panels.append(Panel("Gap (%)", shown, log=True))
    return Chart(time.label, panels, panel_height_in=1.25)


def _dots(x: Values, y: Values, colour: str, label: str = "") -> Series:
    return Series(*thin(x, y, _MAX_DOTS), colour, label, "dots")
