"""What a plant reports of its control steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bess.display import as_table, few, one_line
from bess.numbers import ByValue

Floats = NDArray[np.float64]


class Limit(IntFlag):
    """Limits that bound within a control step, as bits of :attr:`Flows.limits`."""

    DERATING = 1
    """Temperature derating cut the request."""
    SOC_FULL = 2
    """The string was full: charging was cut."""
    SOC_EMPTY = 4
    """The string was empty: discharging was cut, or charging with less power than the inverter loses."""
    ROOT = 8
    """The battery's largest power, where the current is half the short-circuit current."""
    VOLTAGE = 16
    """The cells were at their voltage limit."""


@dataclass(frozen=True, eq=False)
class Flows(ByValue):
    """Flows of one control step (``Plant.step``) or of several (``Plant.run``).

    The last axis of every array is the string, unless it says otherwise; before it stands the step (``run``)
    and before that the scenario (:class:`~bess.plant.Fleet`). Powers are means over the control step.
    Positive power and current are discharge, losses are ``>= 0``, and ``|request| = |delivered| +
    availability loss + derating loss``.

    Attributes
    ----------
    delivered_kw : ndarray
        Delivered AC power [kW], signed.
    availability_loss_kw : ndarray
        Wanted after derating, not delivered because a limit bound [kW].
    derating_loss_kw : ndarray
        Requested, not wanted because of the temperature [kW].
    inverter_loss_kw : ndarray
        Inverter loss [kW], with the standby of an inverter that is off.
    standby_kw : ndarray
        That standby alone [kW], and the loss of an inverter with reactive power but no active power; the grid
        supplies it beside ``delivered_kw``.
    battery_loss_kw : ndarray
        Ohmic loss ``R I^2`` [kW]: the heat that the strings take up, beside ``reversible_heat_kw``.
    hysteresis_loss_kw : ndarray
        Loss of hysteresis [kW]: current times half the distance of the open-circuit voltages of charge and
        discharge. It warms the strings whose ``battery.hysteresis_heat`` is true.
    reversible_heat_kw : ndarray
        Heat of reaction ``-I T dU/dT`` [kW], negative where it cools; 0 for strings without a table of
        entropy.
    chemical_kw : ndarray
        Power taken from the chemical store [kW], signed: the fall of chemical energy, which is a function of
        SOC (capacity times the integral of the mean of both open-circuit voltages at 25 degC).
    ocv_shift_kw : ndarray
        Power [kW] of voltages that differ from those ``chemical_kw`` counts: a plant step holds the
        open-circuit voltage of its beginning, at the temperature of the string. Without a temperature
        dependence it is of first order in the plant step. ``delivered_kw - standby_kw + inverter_loss_kw +
        battery_loss_kw + hysteresis_loss_kw = chemical_kw + ocv_shift_kw``.
    current_a : ndarray
        String current [A], signed.
    soc, temperature_c : ndarray
        State of charge and mean temperature [degC] at the end of the step.
    node_max_c : ndarray
        Hottest node within the step [degC].
    derating_factor : ndarray
        Share of the request that the temperature let through.
    limits : ndarray of uint8
        Bits of :class:`Limit` that bound within the step.
    inverter_starts : ndarray of int64
        Off-to-on transitions.
    soh_capacity, soh_resistance : ndarray
        Capacity and resistance over those of the system file, at the end of the step.
    calendar_loss, cyclic_loss : ndarray
        Capacity lost by standing and by cycling, as shares of that of the system file; with them and
        ``soh_capacity`` the sum is the capacity of a new string.
    aged_charge_ah : ndarray
        Charge that went with capacity at the end of the step [Ah]: SOC times the capacity lost.
    ledger_residual_kwh : ndarray
        AC energy - (chemical change + heat + hysteresis + inverter loss) + OCV shift of all strings [kWh]; no
        string axis.
    auxiliary_kw : ndarray
        Power of cooling [kW]: fans or pumps, and the source of cold; the grid supplies it beside
        ``delivered_kw``. 0 for a system without section ``[cooling]``; no string axis.
    node_temperature_c : ndarray or None
        Node temperatures at the end of the step [degC], with the node as one more axis after the string (NaN
        beyond the nodes of a string that has fewer than others); None if not asked for.
    cooling_kw : ndarray or None
        Heat that the coolant carried off [kW]; None for a system without section ``[cooling]``.
    coolant_c : ndarray or None
        Temperature at which the coolant reaches the (first) string at the end of the step [degC]; no string
        axis; None for a system without section ``[cooling]``.
    reactive_kvar : ndarray or None
        Reactive power [kvar], positive where the inverter gives it; None if none was asked for.
    """

    delivered_kw: Floats
    availability_loss_kw: Floats
    derating_loss_kw: Floats
    inverter_loss_kw: Floats
    standby_kw: Floats
    battery_loss_kw: Floats
    hysteresis_loss_kw: Floats
    reversible_heat_kw: Floats
    chemical_kw: Floats
    ocv_shift_kw: Floats
    current_a: Floats
    soc: Floats
    temperature_c: Floats
    node_max_c: Floats
    derating_factor: Floats
    limits: NDArray[np.uint8]
    inverter_starts: NDArray[np.int64]
    soh_capacity: Floats
    soh_resistance: Floats
    calendar_loss: Floats
    cyclic_loss: Floats
    aged_charge_ah: Floats
    ledger_residual_kwh: Floats
    auxiliary_kw: Floats
    node_temperature_c: Floats | None
    cooling_kw: Floats | None = None
    coolant_c: Floats | None = None
    reactive_kvar: Floats | None = None

    def _facts(self) -> dict[str, str]:
        *_, strings = self.delivered_kw.shape
        if self.delivered_kw.ndim > 1:
            return {"steps": " x ".join(map(str, self.delivered_kw.shape[:-1])), "strings": str(strings)}
        losses_kw = self.inverter_loss_kw + self.battery_loss_kw
        return {
            "delivered": few(self.delivered_kw, ".3g", "kW"),
            "not delivered": few(self.availability_loss_kw + self.derating_loss_kw, ".3g", "kW"),
            "lost": few(losses_kw, ".3g", "kW"),
            "soc": few(self.soc),
            "temperature": few(self.temperature_c, ".3g", "°C"),
        }

    __repr__ = one_line
    _repr_html_ = as_table

    def map(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Flows:
        """Return flows with ``change`` applied to every array, to pick or move leading axes."""
        values: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        changed: dict[str, Any] = {n: None if v is None else change(v) for n, v in values.items()}
        return Flows(**changed)
