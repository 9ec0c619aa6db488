"""Why the strings do what they do, in sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bess.numbers import Array
from bess.parameters import System
from bess.serve.calibration import Calibration
from bess.serve.constraints import CRUMBS_KW
from bess.serve.guard import Trusted
from bess.serve.reserves import Able

Flags = NDArray[np.bool_]


def status(unmet_kw: float, demand_kw: float, has_plan: bool, plan_error: str) -> str:
    """A sentence on the whole answer."""
    if unmet_kw > 0.0:
        return f"{unmet_kw:.4g} kW of {demand_kw:.4g} kW cannot be met; see the reasons of the strings."
    if not has_plan:
        why = f" ({plan_error})" if plan_error else ""
        return f"Shared at the least loss of this step; there is no plan yet{why}."
    return "Shared within the plan."


def reasons(
    system: System,
    trusted: Trusted,
    able: Able,
    request_kw: Array,
    running: Flags,
    calibration: Calibration | None,
) -> tuple[str, ...]:
    """A sentence for each string; a doubt of the guard comes before every other reason."""
    sentences = []
    for i, doubt in enumerate(trusted.reasons):
        gives = request_kw[i] != 0.0
        verb = "runs" if gives else ("idles" if running[i] else "rests")
        if doubt:
            why = doubt
        elif calibration is not None and calibration.string == i:
            why = f"it is charged to {100.0 * calibration.target_soc:g} % for calibration"
        else:
            why = _why(i, verb, system, trusted, able, float(request_kw.sum()))
        sentences.append(f"string {i} {verb}: {why}")
    return tuple(sentences)


def _why(i: int, verb: str, system: System, trusted: Trusted, able: Able, plant_kw: float) -> str:
    """Reason of a string in which nobody has a doubt."""
    temperature_c = trusted.state.temperature_c[i]
    is_hot = temperature_c > system.strings[i].derating.start_c
    if verb == "idles":
        return "a start later would cost more than the standby now"
    if is_hot:
        return f"hot, {temperature_c:.1f} °C"
    if verb == "runs":
        return "it has its share of the demand"
    if able.discharge_kw[i] <= CRUMBS_KW and plant_kw >= 0.0:
        return f"at its lowest state of charge, {100.0 * trusted.soc_low[i]:.1f} %"
    if able.charge_kw[i] <= CRUMBS_KW and plant_kw <= 0.0:
        return f"at its highest state of charge, {100.0 * trusted.soc_high[i]:.1f} %"
    return "it is not needed"
