"""Monitoring of a service: Prometheus metrics, and the history of the live page."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from bess.arrays import Array
from bess.edge.serve.answer import Answer, ControlRequest
from bess.edge.serve.controller import Controller

_OF_STRINGS: Final[Mapping[str, tuple[str, Callable[[Controller, Answer], Any]]]] = {
    "request_kw": ("Set-point; positive = discharge.", lambda c, a: a.request_kw),
    "soc_ratio": ("State of charge, as validated.", lambda c, a: c.valid and c.valid.state.soc),
    "temperature_celsius": (
        "Temperature, as validated.",
        lambda c, a: c.valid and c.valid.state.temperature_c,
    ),
    "running": ("Whether the inverter is on.", lambda c, a: a.running),
    "in_service": ("Whether the string takes set-points.", lambda c, a: c.valid and c.valid.in_service),
    "starts": ("Starts of the inverter since the state began.", lambda c, a: c.commitment.starts),
    "charged_kwh": ("Energy charged since the state began.", lambda c, a: c.charged_kwh),
    "discharged_kwh": ("Energy discharged since the state began.", lambda c, a: c.discharged_kwh),
    "soh_capacity_ratio": ("Estimated capacity relative to nominal.", lambda c, a: c.ageing.soh_capacity),
    "out_of_control_kw": ("Power that a string out of service still supplies.", lambda c, a: a.flowing_kw),
    "calibration_due_seconds": ("When the string must be full again.", lambda c, a: c.calibration.due_s()),
}
"""Gauges of each string: their meaning, and their values, or None if these are unknown."""
SPANS: Final = {"2h": (60.0, 120), "day": (300.0, 288), "week": (1800.0, 336)}
"""Spans of the history: length of a step [s], and number of steps."""
QUANTILES: Final = (0.0, 0.1, 0.5, 0.9, 1.0)
MAX_LINES: Final = 8
"""Maximum number of strings recorded individually; larger plants are recorded by quantiles only."""
_PLANT: Final = ("time_s", "demand_kw", "request_kw", "measured_kw", "foreseen_kw", "starts", "hottest_c")
_DIGITS: Final = 4


class Metrics:
    """Counters and gauges of one service, in a separate registry."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        counter = partial(Counter, registry=self.registry)
        gauge = partial(Gauge, registry=self.registry)
        self.requests = counter("bess_requests", "Requests by path and status.", ["path", "status"])
        self.answer_time = Histogram(
            "bess_answer_seconds",
            "Time from a demand to its answer.",
            buckets=(0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0),
            registry=self.registry,
        )
        self.fallbacks = counter("bess_fallbacks", "Fallback answers, allocated by stored energy.")
        self._demand = gauge("bess_demand_kw", "Demand of the last answer; positive = discharge.")
        self._unmet = gauge("bess_unmet_kw", "Unmet demand of the last answer.")
        self._plan_age = gauge("bess_plan_steps_old", "Age of the plan in steps.")
        self._strings = [
            (gauge(f"bess_{name}", meaning, ["string"]), values_of)
            for name, (meaning, values_of) in _OF_STRINGS.items()
        ]
        self._cost = gauge("bess_calibration_cost_kwh", "Expected cost of the next calibration.")
        self.state_errors = gauge("bess_state_error", "1 while the state cannot be written.")
        self.cycle_age = gauge("bess_cycle_age_seconds", "Time since a control cycle of the plant ended.")
        self.cycle_period = gauge("bess_cycle_period_seconds", "Time from one control cycle to the next.")
        self.link_errors = counter("bess_link_errors", "Failed reads and writes of the plant.")

    def text(self, last: tuple[float, ControlRequest, Answer] | None, controller: Controller) -> bytes:
        """All metrics in the text format of Prometheus, with gauges of the last answer, if any."""
        if last is None:
            return generate_latest(self.registry)
        at_s, request, answer = last
        self._demand.set(request.demand.now_kw)
        self._unmet.set(answer.unmet_kw)
        plan, planned = controller.plan.current, controller.calibration.planned
        self._plan_age.set(-1 if plan is None else controller.plan.slot(at_s) - plan.slot)
        self._cost.set(np.nan if planned is None else planned.cost_kwh)
        for metric, values_of in self._strings:
            values = values_of(controller, answer)
            for i, value in enumerate(() if values is None else values):
                metric.labels(str(i)).set(value)
        return generate_latest(self.registry)


class History:
    """Means over the steps of each span, in bounded memory."""

    def __init__(self) -> None:
        self._spans = {name: _Span(*span) for name, span in SPANS.items()}
        self._began_s = self._now_s = np.nan

    def add(self, plant: dict[str, float], soc: Array, request_kw: Array) -> None:
        """Add one control step: values of the plant (NaN where unknown), SOC and set-points [kW]."""
        each = (soc, request_kw) if soc.size <= MAX_LINES else ()
        self._now_s = plant["time_s"]
        self._began_s = self._now_s if np.isnan(self._began_s) else self._began_s
        row = np.concatenate([[plant[name] for name in _PLANT], np.quantile(soc, QUANTILES), *each])
        for span in self._spans.values():
            span.add(row)

    def document(self, name: str) -> dict[str, Any]:
        """Columns of a span: those of the plant, ``soc`` (quantiles), and each string of a small plant.

        While a shorter span still contains the whole history, its finer steps are returned.
        """
        age_s = self._now_s - self._began_s
        span = next(
            span for each, span in self._spans.items() if each == name or age_s < span.every_s * span.most
        )
        columns = [[None if np.isnan(v) else round(v, _DIGITS) for v in column] for column in span.columns()]
        known, rest = dict(zip(_PLANT, columns, strict=False)), columns[len(_PLANT) :]
        n = (len(rest) - len(QUANTILES)) // 2
        soc, each = rest[: len(QUANTILES)], rest[len(QUANTILES) :]
        return {"every_s": span.every_s, **known, "soc": soc, "string_soc": each[:n], "string_kw": each[n:]}


class _Span:
    """Rows of one span, each beginning with its time; one thread reads them, another writes them."""

    def __init__(self, every_s: float, most: int) -> None:
        self.every_s, self.most = every_s, most
        # Number of a step, sums of the known values, and their counts.
        self._rows: deque[tuple[int, Array, Array]] = deque(maxlen=most + 1)

    def add(self, row: Array) -> None:
        step = int(row[0] // self.every_s)
        values, known = np.nan_to_num(row), np.isfinite(row).astype(np.float64)
        if self._rows and self._rows[-1][0] == step:
            _, total, count = self._rows[-1]
            self._rows[-1] = (step, total + values, count + known)
        else:
            self._rows.append((step, values, known))

    def columns(self) -> list[list[float]]:
        rows = list(self._rows)
        if not rows:
            return [[] for _ in (*_PLANT, *QUANTILES)]
        total, count = (np.array(column) for column in list(zip(*rows, strict=True))[1:])
        means = np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan)
        kept: list[list[float]] = means[means[:, 0] > means[-1, 0] - self.most * self.every_s].T.tolist()
        return kept
