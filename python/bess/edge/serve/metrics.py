"""Prometheus metrics."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from bess.edge.serve.answer import Answer
from bess.edge.serve.controller import Controller

STRINGS: Final = {
    "request_kw": "Set-point; positive = discharge.",
    "soc_ratio": "State of charge as it is acted upon.",
    "temperature_celsius": "Temperature as it is acted upon.",
    "running": "Whether the inverter runs.",
    "in_service": "Whether the string may run.",
    "starts": "Starts of the inverter since the state began.",
    "charged_kwh": "Energy charged since the state began.",
    "discharged_kwh": "Energy discharged since the state began.",
    "soh_capacity_ratio": "Capacity left, as estimated.",
    "out_of_control_kw": "Power that a string out of service still gives.",
    "calibration_due_seconds": "When the string must be full again.",
}
"""Gauges of each string, and their meaning."""


class Metrics:
    """Counters and gauges of one service, in a registry of their own."""

    def __init__(self, n_strings: int) -> None:
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
        self.fallbacks = counter("bess_fallbacks", "Answers that were shared by the energy left.")
        self._demand = gauge("bess_demand_kw", "Demand of the last answer; positive = discharge.")
        self._unmet = gauge("bess_unmet_kw", "What the last answer falls short of.")
        self._plan_age = gauge("bess_plan_steps_old", "Steps since the plan was made.")
        self._strings = {name: gauge(f"bess_{name}", help_, ["string"]) for name, help_ in STRINGS.items()}
        self._cost = gauge("bess_calibration_cost_kwh", "Expected cost of the next calibration.")
        self.state_errors = gauge("bess_state_error", "1 while the state cannot be written.")
        self.cycle_age = gauge("bess_cycle_age_seconds", "Time since a control cycle of the plant ended.")
        self.cycle_period = gauge("bess_cycle_period_seconds", "Time from one control cycle to the next.")
        self.link_errors = counter("bess_link_errors", "Failed reads and writes of the plant.")

    def text(self, demand_kw: float, answer: Answer | None, controller: Controller, slot: int) -> bytes:
        """Everything, in the text format of Prometheus; gauges are those of the last answer."""
        if answer is not None:
            self._take(demand_kw, answer, controller, slot)
        return generate_latest(self.registry)

    def _take(self, demand_kw: float, answer: Answer, controller: Controller, slot: int) -> None:
        self._demand.set(demand_kw)
        self._unmet.set(answer.unmet_kw)
        plan = controller.plan.current
        self._plan_age.set(-1 if plan is None else slot - plan.slot)
        counters, trusted, calibration = controller.counters, controller.trusted, controller.calibration
        self._cost.set(np.nan if calibration.planned is None else calibration.planned[2])
        columns: dict[str, Any] = {
            "request_kw": answer.request_kw,
            "running": answer.running,
            "out_of_control_kw": answer.flowing_kw,
            "starts": controller.commitment.starts,
            "charged_kwh": counters.charged_kwh,
            "discharged_kwh": counters.discharged_kwh,
            "soh_capacity_ratio": controller.ageing.soh_capacity,
        }
        if (due_s := calibration.due_s()) is not None:
            columns["calibration_due_seconds"] = due_s
        if trusted is not None:
            columns["soc_ratio"], columns["temperature_celsius"] = (
                trusted.state.soc,
                trusted.state.temperature_c,
            )
            columns["in_service"] = trusted.in_service
        for name, values in columns.items():
            for i, value in enumerate(values):
                self._strings[name].labels(str(i)).set(value)
