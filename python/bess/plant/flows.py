"""Results of the control steps of a plant, and its complete state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array, ByValue, Flags
from bess.display import as_table, few, one_line


class Limit(IntFlag):
    """Limits that were active within a control step, as bits of :attr:`Flows.limits`."""

    DERATING = 1
    """Temperature derating reduced the request."""
    SOC_FULL = 2
    """The string was full: charging was reduced."""
    SOC_EMPTY = 4
    """The string was empty: discharging was reduced, or charging with less power than the inverter loss."""
    ROOT = 8
    """Maximum power transfer of the battery, at half the short-circuit current."""
    VOLTAGE = 16
    """The cells reached their voltage limit."""
    MIN_POWER = 32
    """The request was below the minimum power of the inverter, which stayed off."""


@dataclass(frozen=True, eq=False)
class Flows(ByValue):
    """Flows of one control step (``Plant.step``) or of several (``Plant.run``).

    Axes are scenario (:class:`~bess.plant.PlantEnsemble`), step (``run``) and string, unless stated
    otherwise. Powers are means over the control step. Positive power and current are discharge, losses are
    ``>= 0``, and ``|request| = |delivered| + availability loss + derating loss``.

    Attributes
    ----------
    delivered_kw : ndarray
        Delivered AC power [kW], signed.
    availability_loss_kw : ndarray
        Power undelivered after derating, because of another limit [kW].
    derating_loss_kw : ndarray
        Power undelivered because of temperature derating [kW].
    inverter_loss_kw : ndarray
        Inverter loss [kW], including the standby loss of an inverter that is off.
    standby_kw : ndarray
        Standby loss [kW], and the loss of an inverter with reactive power only; the grid supplies it in
        addition to ``delivered_kw``.
    battery_loss_kw : ndarray
        Ohmic loss ``R I^2`` [kW]: the heat in the strings, in addition to ``reversible_heat_kw``.
    hysteresis_loss_kw : ndarray
        Hysteresis loss [kW]: current times half the difference of the open-circuit voltages of charge and
        discharge. It heats the strings whose ``battery.hysteresis_heat`` is true.
    reversible_heat_kw : ndarray
        Heat of reaction ``-I T dU/dT`` [kW], negative = cooling; 0 for strings without an entropy table.
    chemical_kw : ndarray
        Power drawn from the stored chemical energy [kW], signed. This energy is a function of SOC (capacity
        times the integral of the mean of both open-circuit voltages at 25 degC).
    ocv_shift_kw : ndarray
        Power due to voltages other than in ``chemical_kw`` [kW]: a plant step uses the open-circuit voltage
        at its start and at the temperature of the string. Without a temperature dependence
        it is of first order in the plant step. ``delivered_kw - standby_kw + inverter_loss_kw +
        battery_loss_kw + hysteresis_loss_kw = chemical_kw + ocv_shift_kw``.
    current_a : ndarray
        String current [A], signed.
    soc, temperature_c : ndarray
        State of charge and mean temperature [degC] at the end of the step.
    node_max_c : ndarray
        Hottest node within the step [degC].
    derating_factor : ndarray
        Share of the request that remains after derating.
    limits : ndarray of uint8
        Bits of :class:`Limit` that were active within the step.
    inverter_starts : ndarray of int64
        Off-to-on transitions.
    soh_capacity, soh_resistance : ndarray
        Capacity and resistance relative to the system file, at the end of the step.
    calendar_loss, cyclic_loss : ndarray
        Capacity loss by calendar and by cycle ageing, relative to the system file; together with
        ``soh_capacity`` the sum is the capacity of a new string.
    aged_charge_ah : ndarray
        Charge lost with capacity at the end of the step [Ah]: SOC times the capacity loss.
    ledger_residual_kwh : ndarray
        AC energy - (chemical change + heat + hysteresis + inverter loss) + OCV shift of all strings [kWh]; no
        string axis.
    auxiliary_kw : ndarray
        Auxiliary power of cooling [kW]: fans or pumps, and the chiller; the grid supplies it in addition to
        ``delivered_kw``. 0 for a system without section ``[cooling]``; no string axis.
    node_temperature_c : ndarray or None
        Node temperatures at the end of the step [degC], with the node axis after the string axis (padded with
        NaN for strings with fewer nodes); None if not requested.
    cooling_kw : ndarray or None
        Heat removed by the coolant [kW]; None for a system without section ``[cooling]``.
    coolant_c : ndarray or None
        Inlet temperature of the coolant at the (first) string at the end of the step [degC]; no string axis;
        None for a system without section ``[cooling]``.
    reactive_kvar : ndarray or None
        Reactive power [kvar], positive = supplied by the inverter; None without reactive requests.
    """

    delivered_kw: Array
    availability_loss_kw: Array
    derating_loss_kw: Array
    inverter_loss_kw: Array
    standby_kw: Array
    battery_loss_kw: Array
    hysteresis_loss_kw: Array
    reversible_heat_kw: Array
    chemical_kw: Array
    ocv_shift_kw: Array
    current_a: Array
    soc: Array
    temperature_c: Array
    node_max_c: Array
    derating_factor: Array
    limits: NDArray[np.uint8]
    inverter_starts: NDArray[np.int64]
    soh_capacity: Array
    soh_resistance: Array
    calendar_loss: Array
    cyclic_loss: Array
    aged_charge_ah: Array
    ledger_residual_kwh: Array
    auxiliary_kw: Array
    node_temperature_c: Array | None
    cooling_kw: Array | None = None
    coolant_c: Array | None = None
    reactive_kvar: Array | None = None

    def _facts(self) -> dict[str, str]:
        *_, strings = self.delivered_kw.shape
        if self.delivered_kw.ndim > 1:
            return {"steps": " x ".join(map(str, self.delivered_kw.shape[:-1])), "strings": str(strings)}
        losses_kw = self.inverter_loss_kw + self.battery_loss_kw
        return {
            "delivered": few(self.delivered_kw, "kW"),
            "not delivered": few(self.availability_loss_kw + self.derating_loss_kw, "kW"),
            "lost": few(losses_kw, "kW"),
            "soc": few(self.soc),
            "temperature": few(self.temperature_c, "°C"),
        }

    __repr__ = one_line
    _repr_html_ = as_table

    def map(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Flows:
        """Return flows with ``change`` applied to every array, to pick or move leading axes."""
        values: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        changed: dict[str, Any] = {n: None if v is None else change(v) for n, v in values.items()}
        return Flows(**changed)


@dataclass(frozen=True, eq=False)
class PlantSnapshot(ByValue):
    """Complete state of a plant; a restored plant continues to the last bit.

    The fields are plain arrays, so a checkpoint can store them by name and rebuild the snapshot. A
    :class:`~bess.plant.PlantEnsemble` has the scenario as an additional leading axis.

    Attributes
    ----------
    soc : ndarray, shape (n_strings,)
        State of charge.
    node_temperature_c : ndarray, shape (n_strings, n_nodes)
        Node temperatures [degC]; padded with NaN for strings with fewer nodes.
    derating_integral_k : ndarray, shape (n_strings,)
        Integral of the PI derating law [K, per 15 min]; 0 under the table law.
    inverter_on : ndarray of bool, shape (n_strings,)
        Whether each inverter was on at the end of the last plant step.
    ageing : ndarray, shape (n_strings, n_numbers)
        Ageing state: losses, damages, and open cycles. Rows are padded with 0 to the length of the string
        with the most open cycles.
    cooling_stages : ndarray, shape (n_strings,), or None
        Active flow stages; None for a plant without section ``[cooling]``.
    coolant : ndarray, shape (2,), or None
        1 if the chiller may run, else 0, and the temperature of the common loop [degC].
    """

    soc: Array
    node_temperature_c: Array
    derating_integral_k: Array
    inverter_on: Flags
    ageing: Array
    cooling_stages: Array | None = None
    coolant: Array | None = None
