"""Prometheus metrics."""

from __future__ import annotations

from functools import partial

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from bess.edge.serve.answer import Answer
from bess.edge.serve.controller import Controller


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
        names = ["string"]
        self._request = gauge("bess_request_kw", "Set-point; positive = discharge.", names)
        self._soc = gauge("bess_soc_ratio", "State of charge as it is acted upon.", names)
        self._temperature = gauge("bess_temperature_celsius", "Temperature as it is acted upon.", names)
        self._running = gauge("bess_running", "Whether the inverter runs.", names)
        self._in_service = gauge("bess_in_service", "Whether the string may run.", names)
        self._starts = gauge("bess_starts", "Starts of the inverter since the state began.", names)
        self._charged = gauge("bess_charged_kwh", "Energy charged since the state began.", names)
        self._discharged = gauge("bess_discharged_kwh", "Energy discharged since the state began.", names)
        self._soh = gauge("bess_soh_capacity_ratio", "Capacity left, as estimated.", names)
        self._flowing = gauge(
            "bess_out_of_control_kw", "Power that a string out of service still gives.", names
        )
        self._due = gauge("bess_calibration_due_seconds", "When the string must be full again.", names)
        self._cost = gauge("bess_calibration_cost_kwh", "Cost of the next calibration by the plan.")
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
        counters, trusted = controller.counters, controller.trusted
        calibration, due_s = controller.calibration, controller.calibration.due_s()
        self._cost.set(calibration.planned[2] if calibration.planned is not None else float("nan"))
        for i in range(controller.n_strings):
            name = str(i)
            self._request.labels(name).set(answer.request_kw[i])
            self._flowing.labels(name).set(answer.flowing_kw[i])
            if due_s is not None:
                self._due.labels(name).set(due_s[i])
            self._running.labels(name).set(bool(answer.running[i]))
            self._starts.labels(name).set(int(controller.commitment.starts[i]))
            self._soh.labels(name).set(controller.ageing.soh_capacity[i])
            self._charged.labels(name).set(counters.charged_kwh[i])
            self._discharged.labels(name).set(counters.discharged_kwh[i])
            if trusted is not None:
                self._soc.labels(name).set(trusted.state.soc[i])
                self._temperature.labels(name).set(trusted.state.temperature_c[i])
                self._in_service.labels(name).set(bool(trusted.in_service[i]))
