"""Validation of measurements: each string is monitored separately; each finding is one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bess.arrays import Array, Flags
from bess.checkpoints import Checkpointed
from bess.edge.plant_io import Measurements
from bess.edge.serve.ageing import Ageing
from bess.edge.serve.string_monitor import FOLLOWS_WITHIN, READ_BACK_WITHIN, StringMonitor
from bess.study.sections import ServiceSection
from bess.system import State, System


@dataclass(frozen=True)
class ValidState:
    """Validated state and limits of the strings."""

    state: State
    """As measured, or as estimated if a reading is implausible."""
    soc_low: Array
    soc_high: Array
    """Range of the SOC if two values are possible; otherwise both equal the SOC of ``state``."""
    energy_kwh: Array
    """Energy between SOC 0 and 1, as aged."""
    charge_kw: Array
    discharge_kw: Array
    """Maximum power by inverter, plant and validation, ``>= 0``; 0 for a string out of service."""
    in_service: Flags
    """Strings that may run."""
    reasons: tuple[str, ...]
    """Why a string is out of service, limited or implausible; otherwise empty."""
    others: Flags
    """Strings to which another controller writes."""
    flowing_kw: Array
    """Power of strings out of service, positive = discharge; 0 for strings in service."""

    @classmethod
    def without_doubt(cls, state: State, system: System) -> ValidState:
        """A plant with all strings in service, limited by their inverters only."""
        n, most_kw = system.n_strings, system.nominal_kw
        energy_kwh, free = system.nominal_energy_kwh * state.soh_capacity, np.ones(n, dtype=bool)
        soc, reasons = state.soc, ("",) * n
        return cls(state, soc, soc, energy_kwh, most_kw, most_kw, free, reasons, ~free, np.zeros(n))

    @property
    def limit_kw(self) -> Array:
        """Power of each string in service, the larger of both directions."""
        return np.where(self.in_service, np.maximum(self.charge_kw, self.discharge_kw), 0.0)

    def worse(self, discharge: bool) -> State:
        """The possible state with the smaller capability in one direction."""
        return replace(self.state, soc=self.soc_low if discharge else self.soc_high)


class MeasurementValidator(Checkpointed):
    """Validates the measurements of all strings; ``ageing`` gives their capacity."""

    def __init__(self, system: System, service: ServiceSection, step_s: float, ageing: Ageing) -> None:
        self._system, self._ageing = system, ageing
        self._watch = [StringMonitor(system, i, service, step_s) for i in range(system.n_strings)]

    def __call__(
        self, measured: Measurements, asked_kw: Array, elapsed_s: float, *, drives: bool = True
    ) -> ValidState:
        """Validate new measurements.

        ``asked_kw`` are the set-points in force since the last call, ``elapsed_s`` ago. If they did not reach
        the plant (``drives``), it is the power of the plant.
        """
        soh_capacity = self._ageing.soh_capacity
        energy_kwh = self._system.nominal_energy_kwh * soh_capacity
        reasons, rows = [], []
        for i, watch in enumerate(self._watch):
            reason, most_kw = watch.judge(
                measured, float(asked_kw[i]), elapsed_s, float(energy_kwh[i]), drives
            )
            reasons.append(reason)
            reading_c = self._system.ambient_c if watch.temperature_c is None else watch.temperature_c
            flow = watch.flow_kw_of(measured, elapsed_s, out=most_kw == 0.0)
            rows.append((*watch.possible_soc(), reading_c, most_kw, flow))
        soc, low, high, temperature_c, cap_kw, flow_kw = np.array(rows, dtype=np.float64).T
        in_service = cap_kw > 0.0
        return ValidState(
            State(soc, temperature_c, soh_capacity, self._ageing.soh_resistance),
            low,
            high,
            energy_kwh,
            np.minimum(self._limit(measured.charge_limit_kw), cap_kw),
            np.minimum(self._limit(measured.discharge_limit_kw), cap_kw),
            in_service,
            tuple(reasons),
            np.array([watch.trouble == "other" for watch in self._watch]),
            self._at_meter(measured, in_service, flow_kw),
        )

    def state_dict(self) -> dict[str, Any]:
        """State of all monitors."""
        return {"watch": [watch.state_dict() for watch in self._watch]}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`."""
        for watch, state in zip(self._watch, state_dict["watch"], strict=True):
            watch.load_state_dict(state)

    def _limit(self, limit_kw: Array) -> Array:
        """Limit of inverter and plant in one direction; zero if the plant gives no number."""
        return np.clip(np.nan_to_num(limit_kw, nan=0.0, posinf=np.inf), 0.0, self._system.nominal_kw)

    def _at_meter(self, measured: Measurements, in_service: Flags, flow_kw: Array) -> Array:
        """Correct the power of strings out of service to the plant's meter minus the other strings."""
        nominal_kw = np.where(in_service, 0.0, self._system.nominal_kw)
        readings = np.append(measured.power_kw[in_service], measured.plant_kw)  # NaN without a meter
        if np.isfinite(readings).all():
            missing_kw = measured.plant_kw - measured.power_kw[in_service].sum() - flow_kw.sum()
            max_kw = 2.0 * (1.0 + FOLLOWS_WITHIN) * nominal_kw.sum()  # full power one way, to the other
            if READ_BACK_WITHIN * nominal_kw.sum() < abs(missing_kw) <= max_kw:
                flow_kw = flow_kw + missing_kw * nominal_kw / nominal_kw.sum()
        return np.where(np.abs(flow_kw) > READ_BACK_WITHIN * self._system.nominal_kw, flow_kw, 0.0)
