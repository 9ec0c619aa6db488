"""Parameter values of the relaxation: the plant's constants, and coefficients at points or over boxes of
states.

Over boxes every value is at its safe end, so that the relaxation contains every trajectory of the control
model that stays in them; a box that is one point freezes the coefficients there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bess import _core
from bess.parameters import State, System
from bess.split.envelope import Envelope
from bess.split.inputs import HorizonInputs
from bess.split.relaxation import INVERTER_PIECES, LOSSES
from bess.units import SECONDS_PER_HOUR, WATTS_PER_KW

Array = NDArray[np.float64]

THETA_ZERO_C = 25.0
THETA_UNIT_K = 10.0
LIMIT_MARGIN = 1e-6
"""A string that sheds ends within this of its SOC limit."""

CURRENT_MARGIN = 1e-5
"""Slack of the charge balance: opposite rows that coincide would leave the program without interior."""


@dataclass(frozen=True)
class Boxes:
    """Ranges of the state at the step boundaries, each of shape ``(n_strings, n_steps + 1)``."""

    soc_lo: Array
    soc_hi: Array
    tau_lo: Array
    tau_hi: Array

    @property
    def at_starts(self) -> tuple[Array, Array, Array, Array]:
        """The four ranges at the starts of the steps, ``(n_strings, n_steps)``."""
        first, second, third, fourth = (
            np.ascontiguousarray(x[:, :-1]) for x in (self.soc_lo, self.soc_hi, self.tau_lo, self.tau_hi)
        )
        return first, second, third, fourth


@dataclass(frozen=True)
class Coefficients:
    """Ranges of derating factor ``k``, voltage [V] and ``y = V^2/R`` [kW] at the start of each step, with an
    affine overestimator ``y_0 + y_soc soc + y_tau tau`` of ``y`` and an affine underestimator ``g_0 + g_tau
    tau`` of ``1 - k``.
    """

    k_lo: Array
    k_hi: Array
    v_lo: Array
    v_hi: Array
    y_lo: Array
    y_hi: Array
    y_0: Array
    y_soc: Array
    y_tau: Array
    g_0: Array
    g_tau: Array

    @classmethod
    def over(cls, horizon: _core.ControlHorizon, boxes: Boxes, near: Boxes) -> Coefficients:
        """Read the tables over boxes of states; planes are closest at the points ``near``."""
        soc, _, temperature_c, _ = near.at_starts
        k_lo, k_hi, v_lo, v_hi, _, _, y_lo, y_hi = horizon.ranges(*boxes.at_starts)
        return cls(k_lo, k_hi, v_lo, v_hi, y_lo, y_hi, *horizon.planes(*boxes.at_starts, soc, temperature_c))


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
    lines: tuple[dict[str, Array], dict[str, Array]]
    """Parameters of the inverter loss in charge and in discharge, per unit."""

    @classmethod
    def of(cls, system: System, battery_kw: Array, dt_h: float) -> PlantConstants:
        """Collect the constants; ``battery_kw`` is the nominal battery loss ``h_N`` of each string."""
        strings = system.strings
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
            lines=(lines[0], lines[1]),
        )

    def at(self, state: State) -> PlantConstants:
        """Return the constants of the strings with the capacity that they have now."""
        return replace(self, soc_per_ampere=self.soc_per_ampere / state.soh_capacity)

    @property
    def scale_kw(self) -> Array:
        """Unit of each cost variable (a, d, w, h) [kW], shape ``(n_strings, 4)``."""
        return np.stack([self.nominal_kw, self.nominal_kw, self.inverter_kw, self.battery_kw], axis=1)

    def physics(self, inputs: HorizonInputs, boxes: Boxes, data: Coefficients) -> dict[str, Array]:
        """Values of every parameter but cuts, caps and costs, with reachable states ``boxes``."""
        demand_kw, limit_kw, ambient_c = inputs.demand_kw, inputs.limit_kw, inputs.ambient_c
        n_strings, n_steps = limit_kw.shape
        direction = np.where(demand_kw >= 0.0, 1.0, -1.0)
        sign = np.broadcast_to(direction, (n_strings, n_steps))
        base_kw = self.nominal_kw.mean()
        nominal, inverter, battery = (
            x[:, None] for x in (self.nominal_kw, self.inverter_kw, self.battery_kw)
        )
        limit = limit_kw / nominal
        g_hi = 1.0 - data.k_lo

        edge = self._shedding_edge(sign, limit_kw, boxes, data)
        reach = np.where(sign > 0.0, boxes.soc_hi[:, 1:], -boxes.soc_lo[:, 1:])
        slack = np.maximum(reach - edge, 0.0)

        # I R / V at the largest power and the smallest y.
        load = limit_kw + np.where(sign > 0.0, inverter, 0.0)
        discharge = 0.5 * (1.0 - np.sqrt(np.maximum(1.0 - 4.0 * load / data.y_lo, 0.0)))
        charge = 0.5 * (np.sqrt(1.0 + 4.0 * load / data.y_lo) - 1.0)
        heat_chord = np.where(sign > 0.0, discharge, charge) * nominal / battery
        # An inverter that draws less from the grid than it loses takes the rest from the battery: P < 0 in
        # charge.
        reverse = np.where(sign > 0.0, 0.0, self.reverse_kw[:, None] / nominal)

        y_unit = battery / nominal**2
        per_volt = nominal * WATTS_PER_KW * self.soc_per_ampere[:, None]
        current_lo, current_hi = per_volt / data.v_hi, per_volt / data.v_lo
        theta = THETA_UNIT_K
        values = {
            "share": self.nominal_kw / base_kw,
            "demand": np.abs(demand_kw) / base_kw,
            "limit": limit,
            "sign": sign,
            "derating_lo": 1.0 - data.k_hi,
            "derating_hi": g_hi,
            "derating_theta": limit * data.g_tau * theta,
            "derating_0": limit * (data.g_0 + data.g_tau * THETA_ZERO_C - g_hi),
            "full_0": edge + slack,
            "full_slack": slack,
            "inverter_share": sign * inverter / nominal,
            "battery_share": sign * battery / nominal,
            "heat_chord": heat_chord,
            "heat_0": 2.0 * heat_chord * reverse,
            "y_lo": data.y_lo * y_unit,
            "y_hi": data.y_hi * y_unit,
            "y_soc": data.y_soc * y_unit,
            "y_theta": data.y_tau * theta * y_unit,
            "y_0": (data.y_0 + data.y_tau * THETA_ZERO_C - data.y_lo) * y_unit,
            "current_lo": current_lo,
            "current_hi": current_hi,
            "current_0": (current_hi - current_lo) * reverse + CURRENT_MARGIN,
            "soc_lo": boxes.soc_lo[:, 1:],
            "soc_hi": boxes.soc_hi[:, 1:],
            "keep": np.broadcast_to(self.keep[:, None], sign.shape),
            "heating": np.broadcast_to((self.kelvin_per_kw * self.battery_kw)[:, None] / theta, sign.shape),
            "air": (1.0 - self.keep[:, None]) * (ambient_c - THETA_ZERO_C) / theta,
        }
        charge_lines, discharge_lines = self.lines
        for name, for_charge in charge_lines.items():
            values[name] = np.where(sign > 0.0, discharge_lines[name][:, None], for_charge[:, None])
        return values

    def may_shed(self, inputs: HorizonInputs, boxes: Boxes, data: Coefficients) -> NDArray[np.bool_]:
        """Whether a string can reach the limit at which power is shed, shape ``(n_strings, n_steps)``."""
        sign = np.where(inputs.demand_kw >= 0.0, 1.0, -1.0) * np.ones_like(inputs.limit_kw)
        nearest = np.where(sign > 0.0, boxes.soc_lo[:, 1:], -boxes.soc_hi[:, 1:])
        edge = self._shedding_edge(sign, inputs.limit_kw, boxes, data)
        at_limit: NDArray[np.bool_] = (nearest <= edge) & (inputs.demand_kw != 0.0)
        return at_limit

    def _shedding_edge(self, sign: Array, limit_kw: Array, boxes: Boxes, data: Coefficients) -> Array:
        """``sign * soc`` at the end of a step in which a string sheds is at most this.

        In discharge it is empty but for less than the no-load loss needs, or anywhere it can be where the
        real root, ``p + w <= V^2 / 4R``, may end below the largest request. In charge it is full, or was
        empty at the start and would have to make up for the no-load loss.
        """
        rootless = data.y_lo / 4.0 < limit_kw + self.inverter_kw[:, None]
        per_kw = 2.0 * WATTS_PER_KW * self.soc_per_ampere[:, None] / data.v_lo
        stranded = self.no_load_kw[:, None] * per_kw
        drained = self.reverse_kw[:, None] * per_kw
        empty = np.where(rootless, boxes.soc_hi[:, 1:], self.soc_min[:, None] + stranded)
        may_drain = boxes.soc_lo[:, :-1] <= self.soc_min[:, None] + drained
        full = np.where(may_drain, -boxes.soc_lo[:, 1:], -self.soc_max[:, None])
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
