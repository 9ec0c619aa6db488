"""Requested power of every string: delivered, undelivered and losses."""

from __future__ import annotations

import numpy as np

from bess.report.charts.long_runs import curve, daily, held
from bess.report.data import Result, TimeAxis, dataset_of, event_spans
from bess.report.drawing.chart import Chart, Panel, Series, Values
from bess.report.drawing.style import (
    AVAILABILITY,
    BATTERY,
    DERATING,
    DISCHARGE,
    HYSTERESIS,
    INK,
    INVERTER,
)

_MOST_STRINGS = 4

_REQUEST = (
    ("delivered_kw", "delivered", DISCHARGE),
    ("derating_loss_kw", "lost to derating", DERATING),
    ("availability_loss_kw", "lost to availability", AVAILABILITY),
)
_CONVERSION = (
    ("inverter_loss_kw", "inverter loss", INVERTER),
    ("battery_loss_kw", "battery loss", BATTERY),
    ("hysteresis_loss_kw", "hysteresis loss", HYSTERESIS),
)


def power_split(result: Result) -> Chart:
    """Requested power = delivered + lost (left), conversion losses (right), stacked, for every string.

    The height of the left stack is the request, upwards in discharge, downwards in charge. Above four
    strings their sum is drawn, since the stacks would not be readable; of a run of more than a month, daily
    means, with charge and discharge apart, so that they do not cancel.
    """
    dataset = dataset_of(result)
    time = TimeAxis(dataset)
    n_strings = dataset.sizes["string"]
    apart = n_strings <= _MOST_STRINGS
    groups = [[index] for index in range(n_strings)] if apart else [list(range(n_strings))]
    discharging = dataset["request_kw"].values > 0.0
    panels = []
    for group in groups:
        title = f"string {group[0]}" if apart else f"sum of {n_strings} strings"

        def flows(parts: tuple[tuple[str, str, str], ...], mask: Values, sign: float) -> list[Series]:
            powers = [
                (sign * (np.abs(dataset[name].values) * mask)[:, group].sum(axis=1), label, colour)  # noqa: B023
                for name, label, colour in parts
                if name in dataset
            ]
            return _stack(time, powers)

        request = flows(_REQUEST, discharging, 1.0) + flows(_REQUEST, ~discharging, -1.0)
        losses = flows(_CONVERSION, np.ones_like(discharging), 1.0)
        nothing = curve(time, np.zeros(len(time.start)), INK, kind="step")
        panels += [
            Panel("Requested (kW)", tuple(request or nothing), title=title),
            Panel("Loss (kW)", tuple(losses or nothing), title=title),
        ]
    return Chart(time.label, tuple(panels), columns=2, panel_height_in=1.5, spans=event_spans(dataset, time))


def _stack(time: TimeAxis, powers: list[tuple[Values, str, str]]) -> list[Series]:
    bands = []
    edges, base = time.edges, np.zeros(1)
    for power, label, colour in powers:
        if not power.any():
            continue
        if time.daily:
            edges, _, power, _ = daily(time, power)
        top = base + held(power)
        bands.append(Series(edges, top, colour, label, "band", np.broadcast_to(base, top.shape)))
        base = top
    return bands
