"""The answer of one control step to a request: set-points, status and reasons."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bess.arrays import Array, Flags
from bess.display import rounded
from bess.edge.plant_io import Measurements
from bess.edge.serve.calibration import Calibration
from bess.edge.serve.constraints import POWER_TOLERANCE_KW, PowerCapability, SetPointRange
from bess.edge.serve.measurement_validator import ValidState
from bess.system import System


@dataclass(frozen=True)
class Demand:
    """Demand now, and its forecast for the present step of the plan and the next ones [kW]."""

    now_kw: float
    forecast_kw: list[float] | None = None
    source: str = ""

    @classmethod
    def of(cls, kw: float | list[float], source: str = "") -> Demand:
        """A demand without a forecast, or a forecast that begins with the demand now."""
        return cls(kw[0], kw, source) if isinstance(kw, list) else cls(kw, None, source)


@dataclass(frozen=True)
class ControlRequest:
    """Input of one control step, and when it was received [s of the monotonic clock]."""

    measured: Measurements
    demand: Demand
    received_s: float = field(default_factory=time.monotonic)

    @property
    def measured_kw(self) -> float:
        """Power of all strings; NaN if that of one is unknown."""
        return float(self.measured.power_kw.sum())


@dataclass(frozen=True)
class Answer:
    """Set-points for one control step; powers kW, positive = discharge."""

    request_kw: Array
    """``(n_strings,)``: set-points; with ``flowing_kw`` and ``unmet_kw`` they sum to the demand."""
    plan_kw: Array
    """``(n_strings, n_steps)``: the set-points, then those of the plan for the next steps of the forecast."""
    status: str
    gap: float | None
    """Relative gap to a rigorous bound, if these are the set-points of a certified split or the first ones of
    a plan with a bound; else None, as between two plans and for the fallback."""
    fallback: bool
    """Whether the demand was shared by stored energy, because the controller had no answer in time."""
    unmet_kw: float
    """Magnitude of the deviation of the set-points from the demand."""
    valid_for_s: float
    solve_time_s: float
    """Validity of the set-points, and computing time."""
    running: Flags
    """``(n_strings,)``: inverters that are on, including those at no load."""
    in_service: Flags
    """``(n_strings,)``: strings available for set-points."""
    flowing_kw: Array
    """``(n_strings,)``: known power of strings out of service; the set-points compensate it."""
    reasons: tuple[str, ...]
    """Reason for the set-point of each string, one sentence each."""

    def document(self) -> dict[str, Any]:
        """The JSON of ``POST /v1/split``."""
        entries = {**vars(self), "solve_time_s": round(self.solve_time_s, 6)}
        return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in entries.items()}


def unmet(demand_kw: float, request_kw: Array) -> float:
    """Magnitude of the deviation of set-points from the demand [kW]; 0 within rounding."""
    off_kw = abs(demand_kw - float(request_kw.sum()))
    return 0.0 if off_kw <= 1e-9 * max(1.0, abs(demand_kw)) else off_kw


def status(unmet_kw: float, demand_kw: float, has_plan: bool, plan_error: str) -> str:
    """Return the status sentence of an answer."""
    if unmet_kw > 0.0:
        missing, demand = rounded(unmet_kw, 5), rounded(demand_kw, 5)
        return f"{missing} kW of {demand} kW cannot be met; see the reasons of the strings."
    if not has_plan:
        why = f" ({plan_error})" if plan_error else ""
        return f"Shared at minimum loss of this step; there is no plan yet{why}."
    return "Shared within the plan."


@dataclass(frozen=True)
class Sharing:
    """A demand as it was shared among the strings; powers kW, positive = discharge."""

    demand_kw: float
    request_kw: Array
    able: PowerCapability
    limits: SetPointRange
    """Range of the set-points, with the ramp limit."""
    minimum_kw: Array
    """Minimum magnitude of a set-point other than zero."""


def reasons(
    system: System, valid: ValidState, shared: Sharing, running: Flags, calibration: Calibration
) -> tuple[str, ...]:
    """Return a sentence per string; validation problems have precedence over other reasons."""
    sentences = []
    for i, doubt in enumerate(valid.reasons):
        temperature_c = valid.state.temperature_c[i]
        hot = f"hot, {temperature_c:.1f} °C" if temperature_c > system.strings[i].derating.start_c else ""
        verb = "runs" if shared.request_kw[i] != 0.0 else ("idles" if running[i] else "rests")
        if doubt:
            why = doubt
            if valid.flowing_kw[i]:
                verb = "flows"
                flowing = rounded(float(valid.flowing_kw[i]), 4)
                why += f"; it still supplies {flowing} kW, which the other strings compensate"
        elif calibration.string == i:
            why = f"it is charged to {100.0 * calibration.target_soc:g} % for calibration"
        elif verb == "runs":
            why = _why_power(i, shared, hot)
        else:
            no_start = "a later start would cost more than its no-load loss" if verb == "idles" else ""
            why = _why_no_power(i, shared, valid, no_start or hot)
        sentences.append(f"string {i} {verb}: {why}")
    return tuple(sentences)


def _why_power(i: int, shared: Sharing, hot: str) -> str:
    power_kw, (low_kw, high_kw), least_kw = shared.request_kw[i], shared.limits, shared.minimum_kw[i]
    most_kw = float(shared.able.towards(power_kw > 0.0)[i])
    is_full = abs(power_kw) >= most_kw - POWER_TOLERANCE_KW
    if not is_full and min(power_kw - low_kw[i], high_kw[i] - power_kw) <= POWER_TOLERANCE_KW:
        return "its ramp limit permits no faster change"
    if not is_full and abs(power_kw) <= least_kw + POWER_TOLERANCE_KW:
        return f"at its minimum power of {rounded(least_kw, 4)} kW"
    if hot:
        return hot
    return f"at its limit of {rounded(most_kw, 4)} kW" if is_full else "it has its share of the demand"


def _why_no_power(i: int, shared: Sharing, valid: ValidState, other: str) -> str:
    discharge = shared.demand_kw >= 0.0
    demand_kw, least_kw = abs(shared.demand_kw), shared.minimum_kw[i]
    next_kw = shared.limits[1] if discharge else -shared.limits[0]
    if (next_kw < 0.0).any():
        return "other strings must first ramp down from the other direction"
    if POWER_TOLERANCE_KW < next_kw[i] < least_kw:
        most = rounded(next_kw[i], 4)
        return f"at most {most} kW are possible, less than its minimum power of {rounded(least_kw, 4)} kW"
    if 0.0 < demand_kw < least_kw - POWER_TOLERANCE_KW:
        demand = rounded(demand_kw, 4)
        return f"the demand of {demand} kW is below its minimum power of {rounded(least_kw, 4)} kW"
    if other:
        return other
    if shared.able.towards(discharge)[i] <= POWER_TOLERANCE_KW:
        end, soc = ("lowest", valid.soc_low) if discharge else ("highest", valid.soc_high)
        return f"at its {end} state of charge, {100.0 * soc[i]:.1f} %"
    return "it is not needed"
