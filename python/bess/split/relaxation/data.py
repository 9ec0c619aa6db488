"""Parameter values of the relaxation: the plant's constants, and coefficients at points or over boxes of
states.

Over boxes every value is at its safe end, so that the relaxation contains every trajectory of the control
model that stays in them; a box that is one point freezes the coefficients there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.convexity import Envelope
from bess.numbers import Array
from bess.parameters import State, System
from bess.split.problem import SplitProblem
from bess.split.relaxation.equations import INVERTER_PIECES, LOSSES
from bess.units import SECONDS_PER_HOUR, WATTS_PER_KW

THETA_ZERO_C = 25.0
THETA_UNIT_K = 10.0
LIMIT_MARGIN = 1e-6
"""A string that sheds ends within this of its SOC limit."""

CURRENT_MARGIN = 1e-5
"""Slack of the charge balance: opposite rows that coincide would leave the program without interior."""


@dataclass(frozen=True)
class PlantConstants:
    """What the relaxation needs to know of a plant and a step length; arrays over strings, powers in kW."""

    nominal_kw: Array
    inverter_kw: Array
    battery_kw: Array
    no_load_kw: Array
    reverse_kw: Array
    soc_per_ampere: Array
    keep: Array
    kelvin_per_kw: Array
    soc_min: Array
    soc_max: Array
    voltage_min_v: Array
    voltage_max_v: Array
    lines: tuple[dict[str, Array], dict[str, Array]]
    """Parameters of the inverter loss in charge and in discharge, per unit."""
    alike: NDArray[np.bool_]
    """Whether string ``m + 1`` is like string ``m``, shape ``(n_strings - 1,)``."""

    @classmethod
    def of(cls, system: System, dt_h: float) -> PlantConstants:
        """Collect the constants."""
        strings = system.strings
        _, battery_kw = system.control_at(system.initial_state()).nominal_loss_kw()
        tables = [string.model_dump(exclude={"site"}) for string in strings]
        largest = np.array([max(*s.inverter.loss_charge, *s.inverter.loss_discharge) for s in strings])
        k1 = np.array([s.thermal.lumped.k1_k_per_j for s in strings])
        k2 = np.array([s.thermal.lumped.k2_per_s for s in strings])
        seconds = dt_h * SECONDS_PER_HOUR
        lines = tuple(
            _lines(
                [
                    Envelope.of_table(
                        np.array(s.inverter.load), np.array(getattr(s.inverter, name)) / unit, INVERTER_PIECES
                    )
                    for s, unit in zip(strings, largest, strict=True)
                ]
            )
            for name in ("loss_charge", "loss_discharge")
        )
        return cls(
            nominal_kw=system.nominal_kw,
            inverter_kw=largest * system.nominal_kw,
            battery_kw=battery_kw,
            no_load_kw=np.array([s.inverter.loss_discharge[0] for s in strings]) * system.nominal_kw,
            reverse_kw=system.nominal_kw
            * [np.max(np.subtract(s.inverter.loss_charge, s.inverter.load)) for s in strings],
            soc_per_ampere=dt_h / system.capacity_ah,
            keep=1.0 - k2 * seconds,
            kelvin_per_kw=k1 * seconds * WATTS_PER_KW,
            soc_min=np.array([s.battery.soc_min for s in strings]),
            soc_max=np.array([s.battery.soc_max for s in strings]),
            voltage_min_v=np.array([s.battery.voltage_min_v for s in strings]),
            voltage_max_v=np.array([s.battery.voltage_max_v for s in strings]),
            lines=(lines[0], lines[1]),
            alike=np.array([a == b for a, b in pairwise(tables)], dtype=bool),
        )

    def at(self, state: State) -> PlantConstants:
        """Return the constants of the strings as they are now: of their capacity, alike in their states."""
        alike = self.alike
        for values in (state.soc, state.temperature_c, state.soh_capacity, state.soh_resistance):
            alike = alike & (np.diff(values) == 0.0)
        return replace(self, soc_per_ampere=self.soc_per_ampere / state.soh_capacity, alike=alike)

    @property
    def scale_kw(self) -> Array:
        """Unit of each cost variable (a, d, w, h) [kW], shape ``(n_strings, 4)``."""
        return np.stack([self.nominal_kw, self.nominal_kw, self.inverter_kw, self.battery_kw], axis=1)

    def physics(
        self, problem: SplitProblem, boxes: _core.StateBoxes, data: _core.CoefficientRanges
    ) -> dict[str, Array]:
        """Values of every parameter but cuts, caps and costs, for states within ``boxes``."""
        demand_kw, limit_kw, ambient_c = problem.demand_kw, problem.limit_kw, problem.ambient_c
        n_strings, n_steps = limit_kw.shape
        direction = np.where(demand_kw >= 0.0, 1.0, -1.0)
        sign = np.broadcast_to(direction, (n_strings, n_steps))
        base_kw = self.nominal_kw.mean()
        nominal, inverter, battery = (
            x[:, None] for x in (self.nominal_kw, self.inverter_kw, self.battery_kw)
        )
        limit = limit_kw / nominal
        g_hi = 1.0 - data.derating_low

        edge = self._shedding_edge(sign, limit_kw, boxes, data)
        reach = np.where(sign > 0.0, boxes.soc_high[:, 1:], -boxes.soc_low[:, 1:])
        slack = np.maximum(reach - edge, 0.0)

        # I R / V at the largest power and the smallest y.
        load = limit_kw + np.where(sign > 0.0, inverter, 0.0)
        discharge = 0.5 * (1.0 - np.sqrt(np.maximum(1.0 - 4.0 * load / data.power_scale_low_kw, 0.0)))
        charge = 0.5 * (np.sqrt(1.0 + 4.0 * load / data.power_scale_low_kw) - 1.0)
        heat_chord = np.where(sign > 0.0, discharge, charge) * nominal / battery
        # An inverter that draws less from the grid than it loses takes the rest from the battery: P < 0 in
        # charge.
        reverse = np.where(sign > 0.0, 0.0, self.reverse_kw[:, None] / nominal)

        y_unit = battery / nominal**2
        per_volt = nominal * WATTS_PER_KW * self.soc_per_ampere[:, None]
        current_lo, current_hi = per_volt / data.voltage_high_v, per_volt / data.voltage_low_v
        theta = THETA_UNIT_K
        values = {
            "share": self.nominal_kw / base_kw,
            "demand": np.abs(demand_kw) / base_kw,
            "limit": limit,
            "sign": sign,
            "derating_lo": 1.0 - data.derating_high,
            "derating_hi": g_hi,
            "derating_theta": limit * data.derated_per_k * theta,
            "derating_0": limit * (data.derated + data.derated_per_k * THETA_ZERO_C - g_hi),
            "full_0": edge + slack,
            "full_slack": slack,
            "inverter_share": sign * inverter / nominal,
            "battery_share": sign * battery / nominal,
            "heat_chord": heat_chord,
            "heat_0": 2.0 * heat_chord * reverse,
            "y_lo": data.power_scale_low_kw * y_unit,
            "y_hi": data.power_scale_high_kw * y_unit,
            "y_soc": data.plane_per_soc_kw * y_unit,
            "y_theta": data.plane_per_k_kw * theta * y_unit,
            "y_0": (data.plane_kw + data.plane_per_k_kw * THETA_ZERO_C - data.power_scale_low_kw) * y_unit,
            "current_lo": current_lo,
            "current_hi": current_hi,
            "current_0": (current_hi - current_lo) * reverse + CURRENT_MARGIN,
            "soc_lo": boxes.soc_low[:, 1:],
            "soc_hi": boxes.soc_high[:, 1:],
            "keep": np.broadcast_to(self.keep[:, None], sign.shape),
            "heating": np.broadcast_to((self.kelvin_per_kw * self.battery_kw)[:, None] / theta, sign.shape),
            "air": (1.0 - self.keep[:, None]) * (ambient_c - THETA_ZERO_C) / theta,
        }
        charge_lines, discharge_lines = self.lines
        for name, for_charge in charge_lines.items():
            values[name] = np.where(sign > 0.0, discharge_lines[name][:, None], for_charge[:, None])
        return values

    def _shedding_edge(
        self, sign: Array, limit_kw: Array, boxes: _core.StateBoxes, data: _core.CoefficientRanges
    ) -> Array:
        """``sign * soc`` at the end of a step in which a string sheds is at most this.

        In discharge it is empty but for less than the no-load loss needs, or anywhere it can be where the
        real root, ``p + w <= V^2 / 4R``, may end below the largest request. In charge it is full, or was
        empty at the start and would have to make up for the no-load loss. Where the largest request may
        take the terminals to a voltage limit, it can be anywhere.
        """
        rootless = data.power_scale_low_kw / 4.0 < limit_kw + self.inverter_kw[:, None]
        per_kw = 2.0 * WATTS_PER_KW * self.soc_per_ampere[:, None] / data.voltage_low_v
        stranded = self.no_load_kw[:, None] * per_kw
        drained = self.reverse_kw[:, None] * per_kw
        # R I at the largest request, with R <= V^2 / y and I at most twice P / V.
        load_kw = limit_kw + np.where(sign > 0.0, self.inverter_kw[:, None], 0.0)
        factor = np.where(sign > 0.0, 2.0, 1.0)
        drop_v = factor * data.voltage_high_v**2 * load_kw / (data.power_scale_low_kw * data.voltage_low_v)
        too_low = data.voltage_low_v - drop_v < self.voltage_min_v[:, None]
        too_high = data.voltage_high_v + drop_v > self.voltage_max_v[:, None]
        empty = np.where(rootless | too_low, boxes.soc_high[:, 1:], self.soc_min[:, None] + stranded)
        may_drain = boxes.soc_low[:, :-1] <= self.soc_min[:, None] + drained
        full = np.where(may_drain | too_high, -boxes.soc_low[:, 1:], -self.soc_max[:, None])
        return np.where(sign > 0.0, empty, full) + LIMIT_MARGIN


def _lines(envelopes: list[Envelope]) -> dict[str, Array]:
    """Parameters of the inverter loss from one envelope for each string."""
    values = {
        "inverter_chord_slope": np.array([e.chord_slope for e in envelopes]),
        "inverter_chord_0": np.array([e.chord_intercept for e in envelopes]),
    }
    for j in range(INVERTER_PIECES):
        values[f"inverter_slope_{j}"] = np.array([e.slope[j] for e in envelopes])
        values[f"inverter_0_{j}"] = np.array([e.intercept[j] for e in envelopes])
    return values


def costs(prefix: str, cost: Array) -> dict[str, Array]:
    """Parameters of a cost row from costs ``(n_strings, 4)`` in the units of the variables."""
    return {f"{prefix}_{name}": cost[:, i] for i, name in enumerate(LOSSES)}
