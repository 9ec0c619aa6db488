"""Reasons for the set-points of the strings, as sentences."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

from bess.arrays import Array, Flags
from bess.edge.serve.calibration import Calibration
from bess.edge.serve.constraints import POWER_TOLERANCE_KW
from bess.edge.serve.soc_limits import PowerCapability
from bess.edge.serve.valid_state import ValidState
from bess.system import System

_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")


def status(unmet_kw: float, demand_kw: float, has_plan: bool, plan_error: str) -> str:
    """Return the status sentence of an answer."""
    if unmet_kw > 0.0:
        return f"{unmet_kw:.4g} kW of {demand_kw:.4g} kW cannot be met; see the reasons of the strings."
    if not has_plan:
        why = f" ({plan_error})" if plan_error else ""
        return f"Shared at the least loss of this step; there is no plan yet{why}."
    return "Shared within the plan."


def reasons(
    system: System,
    trusted: ValidState,
    able: PowerCapability,
    request_kw: Array,
    running: Flags,
    calibration: Calibration,
) -> tuple[str, ...]:
    """Return a sentence per string; validation problems have precedence over other reasons."""
    sentences = []
    for i, doubt in enumerate(trusted.reasons):
        gives = request_kw[i] != 0.0
        verb = "runs" if gives else ("idles" if running[i] else "rests")
        if doubt:
            why = doubt
            if trusted.flowing_kw[i]:
                verb = "flows"
                why += f"; it still gives {trusted.flowing_kw[i]:.4g} kW, which the others make up for"
        elif calibration.string == i:
            why = f"it is charged to {100.0 * calibration.target_soc:g} % for calibration"
        else:
            why = _why(i, verb, system, trusted, able, float(request_kw.sum()))
        sentences.append(f"string {i} {verb}: {why}")
    return tuple(sentences)


def _why(
    i: int, verb: str, system: System, trusted: ValidState, able: PowerCapability, plant_kw: float
) -> str:
    """Return the reason for a string with valid measurements."""
    temperature_c = trusted.state.temperature_c[i]
    is_hot = temperature_c > system.strings[i].derating.start_c
    if verb == "idles":
        return "a later start would cost more than its no-load loss"
    if is_hot:
        return f"hot, {temperature_c:.1f} °C"
    if verb == "runs":
        return "it has its share of the demand"
    if able.discharge_kw[i] <= POWER_TOLERANCE_KW and plant_kw >= 0.0:
        return f"at its lowest state of charge, {100.0 * trusted.soc_low[i]:.1f} %"
    if able.charge_kw[i] <= POWER_TOLERANCE_KW and plant_kw <= 0.0:
        return f"at its highest state of charge, {100.0 * trusted.soc_high[i]:.1f} %"
    return "it is not needed"


def grouped(sentences: Sequence[str], in_service: Flags) -> list[dict[str, Any]]:
    """Group strings by reason: strings out of service first, then the rarest reason.

    Returns
    -------
    list of dict
        ``text``, with the range of a number that differs; ``strings``, their numbers; ``in_service``.
    """
    groups: dict[str, list[int]] = {}
    texts = [sentence.removeprefix(f"string {i} ") for i, sentence in enumerate(sentences)]
    for i, text in enumerate(texts):
        groups.setdefault(_NUMBER.sub("#", text), []).append(i)
    found = []
    for strings in groups.values():
        values = iter(zip(*(_NUMBER.findall(texts[i]) for i in strings), strict=True))

        def ranged(_: re.Match[str], values: Any = values) -> str:
            numbers = next(values)
            low, high = min(numbers, key=float), max(numbers, key=float)
            return low if float(low) == float(high) else f"{low} to {high}"

        text = _NUMBER.sub(ranged, texts[strings[0]])
        found.append({"text": text, "strings": strings, "in_service": bool(in_service[strings].any())})
    return sorted(found, key=lambda group: (group["in_service"], len(group["strings"])))
