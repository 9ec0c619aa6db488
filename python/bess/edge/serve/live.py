"""What the live page shows of a service, as one document."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bess.edge.serve.reasons import grouped

if TYPE_CHECKING:
    from bess.edge.serve.controller import Controller
    from bess.edge.serve.service import Service


def live(service: Service, span: str) -> dict[str, Any]:
    """Plant, demand and strings of the last answer, and the history of a span of :data:`.history.SPANS`."""
    controller = service.controller
    return {
        "study": service.name,
        "time_s": service.clock(),
        "n_strings": controller.n_strings,
        "nominal_kw": controller.system.nominal_kw.tolist(),
        "derating_c": min(string.derating.start_c for string in controller.system.strings),
        "starts": controller.commitment.starts.tolist(),
        "answers": controller.counters.answers,
        "fallbacks": controller.counters.fallbacks,
        "notes": [note for note in (*service.notes, service.memory.error) if note],
        "calibration": _calibration(controller),
        "history": service.history.document(span),
        "status": "no demand yet" if service.last is None else service.last[2].status,
        "last": _last(service),
    }


def _calibration(controller: Controller) -> dict[str, Any]:
    """String that is being calibrated, the one that is next with start and cost, and when each is due."""
    calibration = controller.calibration
    next_, due_s = calibration.planned, calibration.due_s()
    return {
        "string": calibration.string,
        "next": None if next_ is None else dict(zip(("string", "start_s", "cost_kwh"), next_, strict=True)),
        "due_s": None if due_s is None or np.isnan(due_s).any() else due_s.tolist(),
    }


def _last(service: Service) -> dict[str, Any] | None:
    """The last answer, what the strings can do, and the demand ahead; None before the controller's first."""
    controller, trusted = service.controller, service.controller.trusted
    if service.last is None or trusted is None:
        return None
    at_s, demand_kw, answer = service.last
    state, limits, fit = trusted.state, controller.soc_limits, answer.in_service
    energy_kwh = controller.system.nominal_energy_kwh * state.soh_capacity
    kwh = {
        discharge: float((limits.room(trusted.worse(discharge).soc, discharge) * energy_kwh)[fit].sum())
        for discharge in (True, False)
    }
    plan = controller.plan
    return {
        "time_s": at_s,
        "demand_kw": demand_kw,
        "request_kw": answer.request_kw.tolist(),
        "measured_kw": None if np.isnan(service.measured_kw) else service.measured_kw,
        "unmet_kw": answer.unmet_kw,
        "status": answer.status,
        "fallback": answer.fallback,
        "flowing_kw": answer.flowing_kw.tolist(),
        "running": answer.running.tolist(),
        "in_service": fit.tolist(),
        "reasons": list(answer.reasons),
        "because": grouped(answer.reasons, fit),
        "soc": state.soc.tolist(),
        "temperature_c": state.temperature_c.tolist(),
        "plant_soc": float(np.average(state.soc, weights=energy_kwh)),
        "discharge_kwh": kwh[True],
        "charge_kwh": kwh[False],
        "discharge_kw": float(controller.able.discharge_kw.sum()),
        "charge_kw": float(controller.able.charge_kw.sum()),
        "ahead_kw": controller.ahead_kw.tolist(),
        "ahead_step_s": plan.step_s,
        "ahead_start_s": plan.slot(at_s) * plan.step_s,
        "ahead_told": service.told_ahead,
        "gap": None if plan.current is None else plan.current.gap,
    }
