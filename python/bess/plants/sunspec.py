"""The link to SunSpec devices over Modbus/TCP: one unit for each string.

Read are models 701 (AC power, state), 702 (limits), 713 or 802 (SOC, state) and 803 (temperature); written
is ``WSet`` of model 704, which reverts by itself after ``WSetRvrtTms``, and the controller's heartbeat
``CtrlHb`` of model 802. A device that cannot revert is refused: nothing would take the last set-point back
if this controller were lost.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from bess.errors import InputError
from bess.plants.address import Address
from bess.plants.link import LinkError, Measurements
from bess.plants.setpoints import checked_setpoints, watts
from bess.plants.sunspec_models import BASES, END, MARK, decode, offset, registers_of, scale, value

REVERT_S: Final = 60
"""``WSetRvrtTms``: time after the last write until a device takes its set-point back."""
REFRESH_S: Final = 20.0
HEARTBEAT_S: Final = 1.0
"""The same of devices that watch the controller's heartbeat."""
CLOCK: Final = time.monotonic
ANSWER_S: Final = 1.0
"""Time for the answer to one request."""
ALL_S: Final = 3.0
"""Time for one reading of all strings, or for writing all of them."""

# Every failure is an error of ours; Modbus' own lines would only say it again.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

_MOST_REGISTERS: Final = 120
_MOST_MODELS: Final = 100
_MOST_STEPS: Final = 2**31 - 1
_ON, _OFF, _WATTS = 1, 0, 1
_OUT_OF_SERVICE: Final[Mapping[tuple[int, str], tuple[int, ...]]] = {
    (701, "St"): (0,),  # off
    (701, "InvSt"): (0, 5, 6),  # off, shutting down, fault
    (701, "ConnSt"): (0,),  # disconnected
    (713, "Sta"): (2,),  # error
    (802, "LocRemCtl"): (1,),  # under local control
    (802, "State"): (1, 6, 99),  # disconnected, suspending, fault
}
_CHARGE_LIMITS: Final = ("WChaRteMaxRtg", "WChaRteMax")
_DISCHARGE_LIMITS: Final = ("WMaxRtg", "WMax", "WDisChaRteMaxRtg", "WDisChaRteMax")


def link(address: Address, n_strings: int) -> SunSpec:
    """Return the link to the devices at ``address``."""
    return SunSpec(address, n_strings)


class _Silent(Exception):  # noqa: N818 - one device, not the link
    """One device gave no answer that can be used."""


class _Refused(_Silent):
    """One device answered that it has no such register."""


@dataclass(frozen=True)
class _Layout:
    """Where the models of a device begin, and how many registers each has, its first two included."""

    models: Mapping[int, tuple[int, int]]


class SunSpec:
    """A plant of SunSpec devices behind one Modbus/TCP address; one unit for each string.

    Parameters
    ----------
    address
        Of the gateway, with the units of the strings; without, they are 1, 2, ...
    n_strings
        Number of strings.

    Raises
    ------
    InputError
        If the address names another number of units, or what is no unit.
    """

    def __init__(self, address: Address, n_strings: int) -> None:
        names = address.strings or [str(unit + 1) for unit in range(n_strings)]
        if len(names) != n_strings or not all(n.isascii() and n.isdigit() and int(n) <= 247 for n in names):
            raise InputError(
                f"plant {address.url}: ?unit= names {', '.join(names)}; "
                f"expected {n_strings} Modbus units, one for each string, each 0 to 247"
            )
        self.n_strings = n_strings
        self._url = address.url
        self._units = [int(name) for name in names]
        self._client: Any = ModbusTcpClient(  # its methods carry no types
            address.host, port=address.port, timeout=ANSWER_S, retries=0
        )
        self._layouts: dict[int, _Layout] = {}
        self._heartbeat = 0
        # A process before this one may have written.
        self._holds_until = dict.fromkeys(self._units, CLOCK() + REVERT_S + 1.0)

    @property
    def refresh_s(self) -> float:
        """Longest time [s] between two writes: 1 s where a device watches the heartbeat, or may do so."""
        known = len(self._layouts) == self.n_strings
        return (
            REFRESH_S if known and not any(802 in x.models for x in self._layouts.values()) else HEARTBEAT_S
        )

    def read(self) -> Measurements:
        """Return what the devices say now; see :class:`bess.plants.PlantLink`."""
        deadline = time.monotonic() + ALL_S
        nan = math.nan
        rows = []
        silent: dict[int, _Silent] = {}
        for unit in self._units:
            try:
                rows.append(self._measure(unit, deadline))
            except _Silent as error:
                silent[unit] = error
                rows.append((nan, nan, nan, 0.0, 0.0, False))
        if len(silent) == self.n_strings:
            raise LinkError(f"{self._url}: no device can be read: {next(iter(silent.values()))}")
        soc, temperature_c, power_kw, charge_kw, discharge_kw, available = zip(*rows, strict=True)
        return Measurements(
            time=datetime.now(UTC),
            soc=np.array(soc),
            temperature_c=np.array(temperature_c),
            power_kw=np.array(power_kw),
            charge_limit_kw=np.array(charge_kw),
            discharge_limit_kw=np.array(discharge_kw),
            available=np.array(available),
        )

    def write(self, power_kw: NDArray[np.float64]) -> None:
        """Write set-points; see :class:`bess.plants.PlantLink`. NaN takes back the string's set-point."""
        setpoints = dict(zip(self._units, checked_setpoints(power_kw, self.n_strings).tolist(), strict=True))
        now = CLOCK()
        wanted = {u: kw for u, kw in setpoints.items() if not math.isnan(kw) or now < self._holds_until[u]}
        failures = self._write_all(wanted)
        # What cannot be taken back reverts by itself: the strings that were written are well.
        self._raise({unit: error for unit, error in failures.items() if not math.isnan(setpoints[unit])})

    def release(self) -> None:
        """Take back all set-points; what does not arrive reverts by itself."""
        self._raise(self._write_all(dict.fromkeys(self._units, math.nan)))

    def close(self) -> None:
        """Close the connection."""
        self._disconnect()

    def _write_all(self, power_kw: Mapping[int, float]) -> dict[int, _Silent]:
        """Write, first what takes a set-point back; return what did not arrive."""
        deadline = time.monotonic() + ALL_S
        self._heartbeat = (self._heartbeat + 1) % 0xFFFF
        failures: dict[int, _Silent] = {}
        for unit, kw in sorted(power_kw.items(), key=lambda item: not math.isnan(item[1])):
            if not math.isnan(kw):
                self._holds_until[unit] = CLOCK() + REVERT_S + 1.0
            try:
                self._write(unit, kw, deadline)
                if math.isnan(kw):
                    self._holds_until[unit] = -math.inf
            except _Silent as error:
                failures[unit] = error
        return failures

    def _raise(self, failures: Mapping[int, _Silent]) -> None:
        if failures:
            units = ", ".join(str(unit) for unit in failures)
            reason = next(iter(failures.values()))
            raise LinkError(f"{self._url}: set-points of units {units} not written: {reason}")

    def _measure(self, unit: int, deadline: float) -> tuple[float, float, float, float, float, bool]:
        models = {
            model_id: self._model(unit, model_id, deadline)
            for model_id in (701, 702, 713, 802, 803)
            if model_id in self._layout(unit, deadline).models
        }
        try:
            soc = math.nan
            for model_id in (802, 713):
                if model_id in models and not math.isnan(said := value(models[model_id], "SoC")):
                    soc = said / 100.0
            power_kw = value(models[701], "W") / 1000.0
            charge_kw, discharge_kw = (
                min((w for w in self._limits(models, names) if w == w), default=math.inf) / 1000.0
                for names in (_CHARGE_LIMITS, _DISCHARGE_LIMITS)
            )
            temperature_c = math.nan
            if 803 in models:
                temperature_c = (value(models[803], "ModTmpMin") + value(models[803], "ModTmpMax")) / 2.0
        except LinkError as error:
            raise LinkError(f"{self._url} unit {unit}: {error}") from error
        in_service = all(
            model_id not in models or models[model_id].points[name].value not in states
            for (model_id, name), states in _OUT_OF_SERVICE.items()
        )
        known = math.isfinite(soc) and math.isfinite(power_kw)
        return soc, temperature_c, power_kw, charge_kw, discharge_kw, known and in_service

    @staticmethod
    def _limits(models: Mapping[int, Any], names: Sequence[str]) -> list[float]:
        return [value(models[702], name) for name in names] if 702 in models else []

    def _write(self, unit: int, power_kw: float, deadline: float) -> None:
        layout = self._layout(unit, deadline)
        control = self._model(unit, 704, deadline)
        start, _ = layout.models[704]
        points = control.points
        if points["WSetRvrtTms"].value is None:
            raise LinkError(
                f"{self._url} unit {unit}: has no WSetRvrtTms, its set-points would never lapse; not driven"
            )
        if math.isnan(power_kw):
            self._send(unit, start + points["WSetEna"].offset, [_OFF], deadline)
        else:
            try:
                step_w = 10.0 ** scale(control, "WSet")
            except LinkError as error:
                raise LinkError(f"{self._url} unit {unit}: {error}") from error
            steps = math.trunc(watts(power_kw) / step_w)
            if abs(steps) > _MOST_STEPS:
                raise LinkError(
                    f"{self._url} unit {unit}: WSet in steps of {step_w:g} W is too fine for {power_kw:g} kW"
                )
            # The time first: from its first moment on, a set-point is one that reverts.
            revert = registers_of(control, "WSetEnaRvrt", _OFF) + registers_of(
                control, "WSetRvrtTms", REVERT_S
            )
            self._send(unit, start + points["WSetEnaRvrt"].offset, revert, deadline)
            setpoint = [_ON, _WATTS, *registers_of(control, "WSet", steps)]
            self._send(unit, start + points["WSetEna"].offset, setpoint, deadline)
        if 802 in layout.models:
            address = layout.models[802][0] + offset(802, "CtrlHb")
            self._send(unit, address, [self._heartbeat], deadline)

    def _layout(self, unit: int, deadline: float) -> _Layout:
        """Return where the models of a device are, asked for once in each connection."""
        if unit not in self._layouts:
            for base in BASES:
                try:
                    marked = tuple(self._registers(unit, base, 2, deadline)) == MARK
                except _Refused:
                    continue
                if marked:
                    self._layouts[unit] = self._walk(unit, base + 2, deadline)
                    break
            else:
                raise _Silent(f"unit {unit} holds no SunSpec models at {', '.join(map(str, BASES))}")
        return self._layouts[unit]

    def _walk(self, unit: int, address: int, deadline: float) -> _Layout:
        models: dict[int, tuple[int, int]] = {}
        for _ in range(_MOST_MODELS):
            model_id, length = self._registers(unit, address, 2, deadline)
            if model_id == END:
                break
            models.setdefault(model_id, (address, length + 2))
            address += length + 2
        if missing := {701, 704} - models.keys():
            raise LinkError(
                f"{self._url} unit {unit}: has no model {' and '.join(map(str, sorted(missing)))}, "
                f"only {', '.join(map(str, models))}"
            )
        if not {713, 802} & models.keys():
            raise LinkError(f"{self._url} unit {unit}: has neither model 713 nor 802, so no state of charge")
        return _Layout(models)

    def _model(self, unit: int, model_id: int, deadline: float) -> Any:
        address, count = self._layout(unit, deadline).models[model_id]
        registers: list[int] = []
        while len(registers) < count:
            piece = min(count - len(registers), _MOST_REGISTERS)
            registers += self._registers(unit, address + len(registers), piece, deadline)
        if registers[0] != model_id:
            self._layouts.pop(unit)
            raise _Silent(f"unit {unit} has another layout than before")
        return decode(model_id, registers)

    def _registers(self, unit: int, address: int, count: int, deadline: float) -> list[int]:
        answer = self._request("read_holding_registers", unit, deadline, address, count=count)
        if len(answer.registers) != count:
            raise _Silent(f"unit {unit} answers with {len(answer.registers)} registers of {count}")
        return list(answer.registers)

    def _send(self, unit: int, address: int, registers: list[int], deadline: float) -> None:
        self._request("write_registers", unit, deadline, address, registers)

    def _request(self, what: str, unit: int, deadline: float, *arguments: Any, **named: Any) -> Any:
        if time.monotonic() > deadline:
            self._disconnect()  # late answers must not be taken for those to later requests
            raise LinkError(f"{self._url}: no answers of all units within {ALL_S:g} s")
        try:
            if not self._client.connect():
                raise LinkError(f"{self._url}: cannot be reached")
            answer = getattr(self._client, what)(*arguments, device_id=unit, **named)
        except (ModbusException, OSError) as error:
            self._disconnect()
            raise _Silent(f"unit {unit} gives no answer within {ANSWER_S:g} s") from error
        if answer.isError():
            raise _Refused(f"unit {unit} refuses register {arguments[0]} ({answer})")
        return answer

    def _disconnect(self) -> None:
        """Close the connection; what the devices hold is looked up anew in the next."""
        self._client.close()
        self._layouts.clear()
