"""Equations 1 to 6 once more, from the text, in plain Python: the oracle of the compiled control model.

Works on the parameters as validated (cell level), one string at a time, and finds the limit by bisection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

REFERENCE_C = 25.0


@dataclass(frozen=True)
class Step:
    delivered_kw: float
    availability_loss_kw: float
    derating_loss_kw: float
    inverter_loss_kw: float
    battery_loss_kw: float
    current_a: float
    soc: float
    temperature_c: float


def ocv_v(string: Any, charge: bool, soc: float, temperature_c: float) -> float:
    table = string.battery.ocv_v
    rows = [np.interp(soc, table.soc, row) for row in (table.charge if charge else table.discharge)]
    return float(np.interp(temperature_c, table.temperature_c, rows)) * string.battery.cells_series


def resistance_ohm(string: Any, soc: float, temperature_c: float) -> float:
    battery = string.battery
    over_t, over_soc = battery.resistance_temperature, battery.resistance_soc

    def f_t(t: float) -> float:
        return float(np.interp(t, over_t.temperature_c, over_t.resistance_mohm))

    cell = f_t(temperature_c)
    if soc < battery.low_soc_switch:
        cell = float(np.interp(soc, over_soc.soc, over_soc.resistance_mohm)) * cell / f_t(REFERENCE_C)
    return cell * 1e-3 * battery.r_scale * battery.cells_series / battery.cells_parallel


def derating_factor(string: Any, temperature_c: float) -> float:
    return float(np.interp(temperature_c, string.derating.temperature_c, string.derating.factor))


def inverter_loss_kw(string: Any, charge: bool, power_kw: float) -> float:
    if power_kw <= 0.0:
        return 0.0
    inverter = string.inverter
    table = inverter.loss_charge if charge else inverter.loss_discharge
    return float(np.interp(power_kw / inverter.nominal_kw, inverter.load, table)) * inverter.nominal_kw


def battery_current_a(voltage_v: float, resistance: float, charge: bool, internal_kw: float) -> float:
    """Small root of ``V I +- R I^2 = P``; NaN where there is none."""
    sign = 1.0 if charge else -1.0
    square = voltage_v**2 + sign * 4.0 * resistance * internal_kw * 1e3
    if square < 0.0:
        return math.nan
    return sign * (-voltage_v + math.sqrt(square)) / (2.0 * resistance)


def current_of_power_a(string: Any, v: float, r: float, charge: bool, power_kw: float) -> float:
    if power_kw <= 0.0:
        return 0.0
    loss = inverter_loss_kw(string, charge, power_kw)
    return battery_current_a(v, r, charge, power_kw - loss if charge else power_kw + loss)


def step(
    string: Any,
    soc: float,
    temperature_c: float,
    request_kw: float,
    charge: bool,
    ambient_c: float,
    dt_h: float,
) -> Step:
    """One interval of one string; magnitudes."""
    battery = string.battery
    k = derating_factor(string, temperature_c)
    v = ocv_v(string, charge, soc, temperature_c)
    r = resistance_ohm(string, soc, temperature_c)
    capacity_ah = battery.cell_capacity_ah * battery.cells_parallel
    derated = (1.0 - k) * request_kw
    wanted = request_kw - derated

    def allowed(power_kw: float) -> bool:
        current = current_of_power_a(string, v, r, charge, power_kw)
        if math.isnan(current):
            return False
        terminal_v = v + (r if charge else -r) * current
        limits = battery.cell_voltage_min_v, battery.cell_voltage_max_v
        min_v, max_v = (None if each is None else each * battery.cells_series for each in limits)
        if charge and max_v is not None and current > 0.0 and terminal_v > max_v * (1.0 + 1e-15):
            return False
        if not charge and min_v is not None and terminal_v < min_v * (1.0 - 1e-15):
            return False
        end = soc + (current if charge else -current) * dt_h / capacity_ah
        return end <= battery.soc_max + 1e-15 if charge else end >= battery.soc_min - 1e-15

    delivered = wanted
    if not allowed(wanted):
        low, high = 0.0, wanted
        for _ in range(200):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if allowed(middle) else (low, middle)
        delivered = low
    if delivered < string.inverter.min_power_kw:
        delivered = 0.0
    current = current_of_power_a(string, v, r, charge, delivered)
    if charge and soc + current * dt_h / capacity_ah < battery.soc_min:
        delivered, current = 0.0, 0.0
    heat_kw = r * current**2 / 1e3
    lumped = string.thermal.lumped
    return Step(
        delivered,
        wanted - delivered,
        derated,
        inverter_loss_kw(string, charge, delivered),
        heat_kw,
        current,
        soc + (current if charge else -current) * dt_h / capacity_ah,
        temperature_c
        + 3600.0 * dt_h * (lumped.k1_k_per_j * heat_kw * 1e3 - lumped.k2_per_s * (temperature_c - ambient_c)),
    )


def rollout(system: Any, state: Any, request_kw: Any, dt_h: float, ambient_c: float) -> dict[str, Any]:
    """Signed arrays ``(n_strings, n_steps)``, by the names of :class:`bess.Rollout`."""
    names = list(Step.__dataclass_fields__)
    out = {name: np.zeros(np.shape(request_kw)) for name in names}
    for m, string in enumerate(system.strings):
        soc, temperature_c = float(state.soc[m]), float(state.temperature_c[m])
        for t, request in enumerate(request_kw[m]):
            charge = request < 0.0
            flow = step(string, soc, temperature_c, abs(request), charge, ambient_c, dt_h)
            soc, temperature_c = flow.soc, flow.temperature_c
            for name in names:
                sign = -1.0 if charge and name in ("delivered_kw", "current_a") else 1.0
                out[name][m, t] = sign * getattr(flow, name)
    return out
