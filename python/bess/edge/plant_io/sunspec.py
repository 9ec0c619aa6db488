"""Link to SunSpec devices over Modbus/TCP: one unit for each string, at one address or several.

It reads models 701 (AC power, state), 702 (limits), 713 or 802 (SOC, state) and 803 (temperature). It writes
``WSet`` of model 704, which reverts by itself after ``WSetRvrtTms``, and the controller's heartbeat
``CtrlHb`` of model 802. A device whose own heartbeat ``Hb`` stops is out of service and is not written, since
a gateway may answer for a lost device. A device without revert is refused: its last set-point would outlive
this controller.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Final, TypeVar

from bess.edge.plant_io import calls
from bess.edge.plant_io.address import Address, parse_address
from bess.edge.plant_io.calls import CLOSING_TIME_S, Rounds
from bess.edge.plant_io.link import (
    REFRESH_S,
    LinkError,
    Measurements,
    StringLink,
    StringReadings,
    measurements,
)
from bess.edge.plant_io.sunspec_device import Device, Gateway, NoResponseError
from bess.errors import InputError

HEARTBEAT_S: Final = 1.0
"""Refresh interval of devices that monitor the controller's heartbeat."""

T = TypeVar("T")


class Link(StringLink[Device]):
    """A plant of SunSpec devices; several addresses are read and written in parallel.

    The address names units as ``1`` or, at another host, ``1@10.0.0.6:502``; the default is 1, 2, ... Methods
    are those of :class:`bess.edge.plant_io.PlantLink`.
    """

    def __init__(self, address: Address, n_strings: int) -> None:
        names = address.strings or tuple(str(unit + 1) for unit in range(n_strings))
        try:
            places = [_place(name, address) for name in names]
        except ValueError:
            places = []
        if len(places) != n_strings or len(set(places)) < n_strings:
            raise InputError(
                f"plant {address.url}: ?unit= names {', '.join(names)}; expected {n_strings} Modbus units, "
                "one for each string, each 0 to 247, or 1@HOST:PORT if it is elsewhere"
            )
        gateways = {(host, port): Gateway(host, port) for host, port, _ in places}
        self._gateways = tuple(gateways.values())
        super().__init__([Device(gateways[host, port], unit) for host, port, unit in places], n_strings)
        self._heartbeat = 0
        self._readings: Rounds[Device, StringReadings] = Rounds(NoResponseError)
        self._writings: Rounds[Device, None] = Rounds(NoResponseError)

    @property
    def refresh_s(self) -> float:
        """Maximum time [s] between two writes: 1 s if a device may monitor the heartbeat."""
        return HEARTBEAT_S if any(device.may_watch_heartbeat for device in self._strings) else REFRESH_S

    def read(self) -> Measurements:
        """Return the present measurements, if any device can be read."""
        readings, silent = self._each(self._readings, self._strings, Device.measure)
        if not readings:
            raise LinkError(f"no device can be read: {next(iter(silent.values()))}")
        readings |= {device: StringReadings(remarks=str(error)) for device, error in silent.items()}
        return measurements([readings[device] for device in self._strings])

    async def _disconnect(self) -> None:
        for gateway in self._gateways:
            gateway.disconnect()

    def _may_hold(self, string: Device) -> bool:
        return string.may_hold_setpoint

    def _set(self, power_w: Mapping[Device, int | None]) -> Mapping[Device, Exception]:
        self._heartbeat = (self._heartbeat + 1) % 0xFFFF
        beat = self._heartbeat
        _, failures = self._each(
            self._writings,
            list(power_w),
            lambda device: device.write(power_w[device], beat),
            lambda device: power_w[device] is None,
        )
        return failures

    def _each(
        self,
        rounds: Rounds[Device, T],
        devices: Sequence[Device],
        call: Callable[[Device], Awaitable[T]],
        first: Callable[[Device], bool] = lambda device: False,
    ) -> tuple[dict[Device, T], dict[Device, Exception]]:
        """Call all devices, in parallel for several addresses; return results and failures."""

        async def named(device: Device) -> T:
            try:
                return await call(device)
            except LinkError as error:
                raise LinkError(f"{device}: {error}") from error

        round_ = rounds(devices, named, lambda device: device.gateway.turn, first)
        done, failed = self._within(round_, calls.DEADLINE_S + CLOSING_TIME_S)
        late = f"is too slow: not done within {calls.DEADLINE_S:g} s"
        return done, {
            device: error
            if isinstance(error, NoResponseError)
            else NoResponseError(f"{device.gateway.place} {late}")
            for device, error in failed.items()
        }


def _place(name: str, address: Address) -> tuple[str, int, int]:
    """Return host, port and unit of a string; raise ValueError for an invalid text."""
    unit, at, elsewhere = name.partition("@")
    if not re.fullmatch(r"[0-9]{1,3}", unit) or int(unit) > 247:
        raise ValueError(name)
    if not at:
        return address.host, address.port, int(unit)
    place = parse_address(f"sunspec={elsewhere}")
    return place.host, place.port, int(unit)
