"""One SunSpec device: a unit at a Modbus/TCP address, its models, readings and set-points.

Models are converted to registers and back by pysunspec2's definitions. pysunspec2 returns an unscaled value
if a device omits the scale factor. Here this is an error, since the power would be wrong by a power of ten.
"""

from __future__ import annotations

import asyncio
import logging
import math
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any, Final

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from sunspec2.device import Model

from bess.edge.plant_io import calls
from bess.edge.plant_io.address import socket_name
from bess.edge.plant_io.link import LinkError, StringReadings, mean_temperature_c

MARK: Final = (0x5375, 0x6E53)
"""``SunS``, at the first register."""
BASES: Final = (40_000, 0, 50_000)
END: Final = 0xFFFF

_SCALES: Final = range(-10, 11)
_NO_GROUPS: Final = {"NStr": 0}
"""Number of strings of a bank after model 803."""


def _registers(data: bytes) -> list[int]:
    return list(struct.unpack(f">{len(data) // 2}H", data))


def decode(model_id: int, registers: Sequence[int]) -> Any:
    """Return a model from its registers, with ID and length and without repeated groups.

    Points after the last register are not implemented, as in a device with an older definition.
    """
    model = Model(model_id, data=_NO_GROUPS)
    data = struct.pack(f">{len(registers)}H", *registers)
    for point in model.points.values():
        point.set_mb(data[2 * point.offset :])
    return model


def encode(model_id: int, values: Mapping[str, Any]) -> list[int]:
    """Return a model's registers; values are unscaled, missing points are "not implemented"."""
    model = Model(model_id, data=dict(values))
    model.points["ID"].value = model_id
    model.points["L"].value = model.len - 2
    return _registers(model.get_mb())


def value(model: Any, name: str) -> float:
    """Return a point in the units of its model, NaN if not implemented; raise LinkError without a scale."""
    value = model.points[name].value
    return math.nan if value is None else float(value) * 10.0 ** scale(model, name)


def scale(model: Any, name: str) -> int:
    """Return the scale factor of a point, an exponent of ten; raise LinkError if it is not valid."""
    point = model.points[name]
    if not point.sf_required:
        return 0
    factor = point.sf_value if point.sf is None else model.points[point.sf].value
    if factor not in _SCALES:
        raise LinkError(
            f"model {model.model_id} gives {name} with scale factor {point.sf} = {factor}; "
            "nothing is read or written until this is corrected"
        )
    return int(factor)


def registers_of(model: Any, name: str, content: int) -> list[int]:
    """Return the registers of one point with an unscaled value."""
    point = model.points[name]
    return _registers(point.info.to_data(content, 2 * point.len))


@cache
def offset(model_id: int, name: str) -> int:
    """Return the offset of a point in its model, in registers."""
    return int(Model(model_id).points[name].offset)


HEARTBEAT_TIMEOUT_S: Final = 10.0
"""Time without a beat after which a device that counts seconds is lost."""


class Heartbeat:
    """Monitors a counter; one that never changed is not a heartbeat, as many devices leave it at zero."""

    def __init__(self) -> None:
        self._count = math.nan
        self._moved_at_s: float | None = None

    def see(self, count: float) -> None:
        """Record the counter; NaN if the device does not report it."""
        if not math.isnan(count) and count != self._count:
            if not math.isnan(self._count):
                self._moved_at_s = calls.CLOCK()
            self._count = count

    @property
    def doubt(self) -> str:
        """A sentence if the heartbeat has stopped; otherwise empty."""
        still_s = 0.0 if self._moved_at_s is None else calls.CLOCK() - self._moved_at_s
        if still_s < HEARTBEAT_TIMEOUT_S:
            return ""
        return f"its heartbeat has been constant at {self._count:.0f} for {still_s:.0f} s; it is lost"


REVERT_S: Final = 60
"""``WSetRvrtTms``: time after the last write until a device reverts its set-point."""
ANSWER_S: Final = 1.0
"""Time for the answer to one request."""

# Failures are raised as errors here; the log lines of the Modbus library would repeat them.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

_MAX_REGISTERS: Final = 120
_MAX_MODELS: Final = 100
_NO_VALUE: Final = 0xFFFF
_MAX_STEPS: Final = 2**31 - 1
_ON, _OFF, _WATTS, _PER_CENT = 1, 0, 1, 0
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


class NoResponseError(Exception):
    """A device gave no valid answer."""


class _RefusedError(NoResponseError):
    """A device has no such register."""


class Gateway:
    """One Modbus/TCP address; reconnects after every failure, so that a late answer is never mismatched."""

    def __init__(self, host: str, port: int) -> None:
        self.place = socket_name(host, port)
        self.losses = 0
        self.turn = asyncio.Semaphore(1)
        self._host, self._port = host, port
        self._client: Any = None  # its methods carry no types

    async def request(self, what: str, unit: int, *arguments: Any, **named: Any) -> Any:
        """Return the answer to one request, or raise :class:`NoResponseError`."""
        try:
            if self._client is None or not self._client.connected:
                self._lost()
                self._client = AsyncModbusTcpClient(
                    self._host, port=self._port, timeout=ANSWER_S, retries=0, reconnect_delay=0.0
                )
                if not await self._client.connect():
                    self._lost()
                    raise NoResponseError(f"{self.place} cannot be reached")
            answer = await getattr(self._client, what)(*arguments, device_id=unit, **named)
        except ConnectionException as error:
            self._lost()
            raise NoResponseError(f"{self.place} cannot be reached (it closed the connection)") from error
        except (ModbusException, OSError) as error:
            self.disconnect()
            raise NoResponseError(
                f"unit {unit} at {self.place} gives no answer within {ANSWER_S:g} s"
            ) from error
        except asyncio.CancelledError:
            self.disconnect()
            raise
        if answer.isError():
            code = answer.exception_code
            raise _RefusedError(
                f"unit {unit} at {self.place} refuses register {arguments[0]} (Modbus exception {code})"
            )
        return answer

    def disconnect(self) -> None:
        """Close the connection."""
        if self._client is not None:
            self._client.close()
            self._client = None

    def _lost(self) -> None:
        """Record that the other end has closed the connection: the layout of its devices is read again."""
        if self._client is not None:
            self.disconnect()
            self.losses += 1


class Device:
    """One unit.

    Calls raise :class:`NoResponseError`, or :class:`LinkError`, which does not name the unit, if it must not
    be controlled.
    """

    def __init__(self, gateway: Gateway, unit: int) -> None:
        self.gateway = gateway
        self._unit = unit
        self._models: dict[int, tuple[int, int]] = {}
        self._losses = 0
        self._heartbeat = Heartbeat()
        # An earlier process may have written.
        self._holds_until_s = calls.CLOCK() + REVERT_S + 1.0

    def __str__(self) -> str:
        return f"unit {self._unit} at {self.gateway.place}"

    @property
    def may_watch_heartbeat(self) -> bool:
        """Whether it has a register for the controller's heartbeat, or has not been read yet."""
        return not self._models or 802 in self._models

    @property
    def may_hold_setpoint(self) -> bool:
        """Whether its last set-point may not have been cleared or reverted."""
        return calls.CLOCK() < self._holds_until_s

    async def measure(self) -> StringReadings:
        """Return the present readings."""
        known = await self._layout()
        models = {m: await self._model(m) for m in (701, 702, 704, 713, 802, 803) if m in known}
        soc = setpoint_kw = temperature_c = math.nan
        for model_id in (802, 713):
            if model_id in models and not math.isnan(said := value(models[model_id], "SoC")):
                soc = said / 100.0
        power_kw = value(models[701], "W") / 1000.0
        charge_kw, discharge_kw = (_limit_kw(models, names) for names in (_CHARGE_LIMITS, _DISCHARGE_LIMITS))
        if models[704].points["WSetEna"].value == _ON:
            setpoint_kw = _setpoint_kw(models)
        if 803 in models:
            ends_c = (value(models[803], name) for name in ("ModTmpMin", "ModTmpMax"))
            temperature_c = mean_temperature_c(*ends_c)
        in_service = all(
            model_id not in models or models[model_id].points[name].value not in states
            for (model_id, name), states in _OUT_OF_SERVICE.items()
        )
        if 802 in models:
            self._heartbeat.see(value(models[802], "Hb"))
        remark = self._heartbeat.doubt
        required = {"no state of charge": soc, "no power": power_kw}
        if missing := [name for name, reading in required.items() if math.isnan(reading)]:
            remark = f"the device reports {' and '.join(missing)}"
        fit = in_service and not remark
        return StringReadings(soc, temperature_c, power_kw, charge_kw, discharge_kw, setpoint_kw, fit, remark)

    async def write(self, power_w: int | None, heartbeat: int) -> None:
        """Write a set-point that reverts by itself, or clear it (None); advance the controller's heartbeat.

        A device whose own heartbeat has stopped gets no set-point: the last one reverts.
        """
        start, _ = (await self._layout())[704]
        control = await self._model(704)
        points = control.points
        if points["WSetRvrtTms"].value is None:
            raise LinkError("has no WSetRvrtTms: its set-points would never expire, so it is not controlled")
        if power_w is None:
            await self._send(start + points["WSetEna"].offset, [_OFF])
            self._holds_until_s = -math.inf
        elif doubt := self._heartbeat.doubt:
            raise NoResponseError(f"{self}: {doubt}")
        else:
            step_w = 10.0 ** scale(control, "WSet")
            steps = math.trunc(power_w / step_w)
            if abs(steps) > _MAX_STEPS:
                raise LinkError(f"WSet in steps of {step_w:g} W is too fine for {power_w} W")
            # The time first, so that the set-point reverts from the beginning.
            revert = [
                *registers_of(control, "WSetEnaRvrt", _OFF),
                *registers_of(control, "WSetRvrtTms", REVERT_S),
            ]
            await self._send(start + points["WSetEnaRvrt"].offset, revert)
            setpoint = [_ON, _WATTS, *registers_of(control, "WSet", steps)]
            self._holds_until_s = calls.CLOCK() + REVERT_S + 1.0
            await self._send(start + points["WSetEna"].offset, setpoint)
        if 802 in self._models:
            battery, _ = self._models[802]
            await self._send(battery + offset(802, "CtrlHb"), [heartbeat])
            # Also between two readings: a counter of N seconds, read every N seconds, seems to stand still.
            with suppress(NoResponseError):
                (beat,) = await self._registers(battery + offset(802, "Hb"), 1)
                self._heartbeat.see(math.nan if beat == _NO_VALUE else beat)

    async def _layout(self) -> Mapping[int, tuple[int, int]]:
        """Return address and length of each model; read again after a lost connection."""
        if self._losses != self.gateway.losses:
            self._models = {}
        if not self._models:
            self._models = await self._walk(await self._base())
            self._losses = self.gateway.losses
        return self._models

    async def _base(self) -> int:
        refusal = ""
        for base in BASES:
            try:
                if tuple(await self._registers(base, 2)) == MARK:
                    return base
            except _RefusedError as error:
                refusal = refusal or f"; {error}"
        raise NoResponseError(f"{self} holds no SunSpec models at {', '.join(map(str, BASES))}{refusal}")

    async def _walk(self, base: int) -> dict[int, tuple[int, int]]:
        models: dict[int, tuple[int, int]] = {}
        address = base + len(MARK)
        for _ in range(_MAX_MODELS):
            model_id, length = await self._registers(address, 2)
            if model_id == END:
                break
            models.setdefault(model_id, (address, length + 2))
            address += length + 2
        if missing := {701, 704} - models.keys():
            raise LinkError(
                f"has no model {' and '.join(map(str, sorted(missing)))}, only {', '.join(map(str, models))}"
            )
        if not {713, 802} & models.keys():
            raise LinkError("has neither model 713 nor 802, so no state of charge")
        return models

    async def _model(self, model_id: int) -> Any:
        address, count = self._models[model_id]
        registers: list[int] = []
        while len(registers) < count:
            piece = min(count - len(registers), _MAX_REGISTERS)
            registers += await self._registers(address + len(registers), piece)
        if registers[0] != model_id:
            self._models = {}
            raise NoResponseError(f"{self} has another layout than before")
        return decode(model_id, registers)

    async def _registers(self, address: int, count: int) -> list[int]:
        answer = await self.gateway.request("read_holding_registers", self._unit, address, count=count)
        if len(answer.registers) != count:
            raise NoResponseError(f"{self} answers with {len(answer.registers)} registers of {count}")
        return list(answer.registers)

    async def _send(self, address: int, registers: Sequence[int]) -> None:
        await self.gateway.request("write_registers", self._unit, address, list(registers))


def _setpoint_kw(models: Mapping[int, Any]) -> float:
    """Return the set-point of a device, which other controllers may give in per cent of its ``WMax``."""
    control = models[704]
    if control.points["WSetMod"].value != _PER_CENT:
        return value(control, "WSet") / 1000.0
    most_kw = _limit_kw(models, ("WMaxRtg", "WMax"))
    return value(control, "WSetPct") / 100.0 * most_kw if most_kw < math.inf else math.nan


def _limit_kw(models: Mapping[int, Any], names: Sequence[str]) -> float:
    """Return the smallest limit of a device; infinite if it reports none."""
    limits = [value(models[702], name) for name in names] if 702 in models else []
    return min((watt for watt in limits if watt == watt), default=math.inf) / 1000.0
