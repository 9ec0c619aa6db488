"""A plain NumPy plant, written from the specification alone, as an oracle: scalar, limits by bisection."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass
class ReferenceString:
    """One string; ``document`` is a system file, one-temperature OCV and switched resistance."""

    document: dict[str, Any]
    soc: float
    temperature_c: NDArray[np.float64]
    step_s: float = 10.0
    pi_law: bool = False
    integral_k: float = 0.0
    totals: dict[str, float] = field(default_factory=dict)

    def control_step(self, request_w: float, ambient_c: float, duration_s: float = 900.0) -> dict[str, float]:
        """Advance; returns mean flows [W, A]."""
        n = round(duration_s / self.step_s)
        self.totals = {}
        if self.pi_law:
            excess = float(self.temperature_c.mean()) - self.document["derating"]["start_c"]
            self.integral_k = max(0.0, self.integral_k + excess * duration_s / 900.0)
        for _ in range(n):
            self._plant_step(request_w, ambient_c)
        return {name: total / n for name, total in self.totals.items()}

    def _plant_step(self, request_w: float, ambient_c: float) -> None:
        charging = request_w < 0
        factor = self._factor()
        wanted = factor * abs(request_w)
        node_r = self.node_resistance()
        r = float(node_r.mean())
        p = self._largest(wanted, r, charging)
        loss = self._loss(p, charging) if p > 0 else 0.0
        current, _ = self._current(p, loss, r, charging)
        before, gap_v = self.soc, self._open_v(-1.0) - self._open_v(1.0)
        self.soc -= current * self.step_s / (3600.0 * self._capacity_ah())
        heat = current**2 * node_r / node_r.size
        self.temperature_c = self.temperature_c + self.step_s * self.slope(heat, ambient_c)
        for name, value in {
            "delivered": -p if charging else p,
            "availability": wanted - p,
            "derating": abs(request_w) - wanted,
            "inverter": loss,
            "battery": current**2 * r,
            "hysteresis": abs(current) * gap_v / 2.0,
            "chemical": self._stored_j(before, self.soc) / self.step_s,
            "current": current,
            "factor": factor,
        }.items():
            self.totals[name] = self.totals.get(name, 0.0) + value

    def _factor(self) -> float:
        d, mean = self.document["derating"], float(self.temperature_c.mean())
        if not self.pi_law:
            return float(np.interp(mean, d["temperature_c"], d["factor"]))
        excess = max(mean - d["start_c"], 0.0)
        return float(np.clip(1.0 - d["kp_per_k"] * excess - d["ki_per_k_step"] * self.integral_k, 0.0, 1.0))

    def _capacity_ah(self) -> float:
        b = self.document["battery"]
        return float(b["cell_capacity_ah"] * b["cells_parallel"])

    def node_resistance(self) -> NDArray[np.float64]:
        """Resistance of the string at the temperature of each node [Ohm]."""
        b = self.document["battery"]
        t, s = b["resistance_temperature"], b["resistance_soc"]
        cell = np.interp(self.temperature_c, t["temperature_c"], t["resistance_mohm"])
        if self.soc < b["low_soc_switch"]:
            at_25 = np.interp(25.0, t["temperature_c"], t["resistance_mohm"])
            cell = cell * np.interp(self.soc, s["soc"], s["resistance_mohm"]) / at_25
        scale = 1e-3 * b.get("r_scale", 1.0) * b["cells_series"] / b["cells_parallel"]
        return np.asarray(cell * scale)

    def _loss(self, p: float, charging: bool) -> float:
        i = self.document["inverter"]
        nominal = 1e3 * i["nominal_kw"]
        return float(
            nominal * np.interp(p / nominal, i["load"], i["loss_charge" if charging else "loss_discharge"])
        )

    def _current(self, p: float, loss: float, r: float, charging: bool) -> tuple[float, float]:
        """Small root of ``V I - R I^2 = P``; NaN where there is none."""
        power = loss - p if charging else loss + p
        b = self.document["battery"]
        table = b["ocv_v"]["discharge" if power > 0 else "charge"]
        v = float(b["cells_series"] * np.interp(self.soc, b["ocv_v"]["soc"], table))
        with np.errstate(invalid="ignore"):
            return float((v - np.sqrt(v * v - 4.0 * r * power)) / (2.0 * r)), v

    def _feasible(self, p: float, r: float, charging: bool) -> bool:
        b = self.document["battery"]
        current, _ = self._current(p, self._loss(p, charging), r, charging)
        after = self.soc - current * self.step_s / (3600.0 * self._capacity_ah())
        voltage = b["cells_series"] * b.get("cell_voltage_max_v", np.inf)
        if charging and current < 0.0 and self._open_v(current) - r * current > voltage:
            return False
        voltage = b["cells_series"] * b.get("cell_voltage_min_v", 0.0)
        if not charging and self._open_v(current) - r * current < voltage:
            return False
        return bool(b["soc_min"] <= after <= b["soc_max"])

    def _open_v(self, current: float) -> float:
        b = self.document["battery"]
        table = b["ocv_v"]["discharge" if current > 0 else "charge"]
        return float(b["cells_series"] * np.interp(self.soc, b["ocv_v"]["soc"], table))

    def _stored_j(self, high: float, low: float) -> float:
        """Capacity times the integral of the mean of both open-circuit voltages from ``low`` to ``high``."""
        b = self.document["battery"]
        table = b["ocv_v"]
        mean_v = 0.5 * b["cells_series"] * np.add(table["charge"], table["discharge"])
        inside = [soc for soc in table["soc"] if min(low, high) < soc < max(low, high)]
        soc = np.array([min(low, high), *inside, max(low, high)])
        area_v = np.trapezoid(np.interp(soc, table["soc"], mean_v), soc)
        return float(np.sign(high - low) * 3600.0 * self._capacity_ah() * area_v)

    def _largest(self, wanted: float, r: float, charging: bool) -> float:
        if wanted == 0.0 or self._feasible(wanted, r, charging):
            return wanted
        # Both losses rise with power by less than one watt per watt: the feasible powers are an interval.
        trials = wanted * np.linspace(0.0, 1.0, 401)[:-1]
        feasible = [p for p in trials if p > 0 and self._feasible(p, r, charging)]
        if not feasible:
            return 0.0
        low = float(max(feasible))
        high = low + wanted / 400.0
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._feasible(middle, r, charging) else (low, middle)
        return low

    def slope(self, heat_w: NDArray[np.float64], ambient_c: float) -> NDArray[np.float64]:
        """``dT/dt`` [K/s] of every node for string heat ``heat_w`` [W] in each node."""
        t = self.document["thermal"]["spatial"]
        temperature = self.temperature_c
        n, dx = t["nodes"], t["length_m"] / t["nodes"]
        node_j_k = t["density_kg_m3"] * t["specific_heat_j_kgk"] * t["section_m2"] * dx
        air_w_k = t["air_flow_kg_s"] * t["air_cp_j_kgk"]
        share = np.exp(-t["lateral_u_w_m2k"] * t["width_m"] * dx / air_w_k)
        air = np.empty(n + 1)
        air[0] = ambient_c
        for i in range(n):
            air[i + 1] = temperature[i] + (air[i] - temperature[i]) * share
        flux = np.zeros(n + 1)
        flux[1:-1] = t["conductivity_w_mk"] * (temperature[:-1] - temperature[1:]) / dx
        if t["end_u_w_m2k"] > 0:
            film = 1.0 / (1.0 / t["end_u_w_m2k"] + 0.5 * dx / t["conductivity_w_mk"])
            flux[0], flux[-1] = film * (air[0] - temperature[0]), film * (temperature[-1] - air[-1])
        conducted = t["section_m2"] * (flux[:-1] - flux[1:])
        # What the air takes up between the two faces of a cell left that cell.
        to_air = air_w_k * np.diff(air)
        return np.asarray((conducted + heat_w / t["packs_per_string"] - to_air) / node_j_k)
