"""Link to SunSpec devices over Modbus/TCP: one unit for each string, at one address or several.

It reads models 701 (AC power, state), 702 (limits), 713 or 802 (SOC, state) and 803 (temperature). It writes
``WSet`` of model 704, which reverts by itself after ``WSetRvrtTms``, and the controller's heartbeat
``CtrlHb`` of model 802. A device whose own heartbeat ``Hb`` stops is out of service and is not written, since
a gateway may answer for a lost device. A device without revert is refused: its last set-point would outlive
this controller.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import fields
from datetime import UTC, datetime
from typing import Any, Final, TypeVar
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from bess.edge.plant_io.address import PORTS, Address
from bess.edge.plant_io.calls import CLOSING_TIME_S, Calls, Rounds
from bess.edge.plant_io.link import LinkError, Measurements, checked_setpoints, whole_watts
from bess.edge.plant_io.sunspec_device import REVERT_S, Device, DeviceReadings, Gateway, NoResponseError
from bess.errors import InputError

REFRESH_S: Final = 20.0
HEARTBEAT_S: Final = 1.0
"""Refresh interval of devices that monitor the controller's heartbeat."""
ALL_S: Final = 3.0
"""Deadline for reading or writing all strings."""
CLOCK: Final = time.monotonic

T = TypeVar("T")


class Link:
    """A plant of SunSpec devices; several addresses are read and written in parallel.

    The address names units as ``1`` or, at another host, ``1@10.0.0.6:502``; the default is 1, 2, ... Methods
    are those of :class:`bess.edge.plant_io.PlantLink`.

    Raises
    ------
    InputError
        The address has another number of units, or an invalid unit.
    """

    def __init__(self, address: Address, n_strings: int) -> None:
        names = address.strings or tuple(str(unit + 1) for unit in range(n_strings))
        places = [_place(name, address) for name in names]
        if len(names) != n_strings or len(set(places)) < n_strings or None in places:
            raise InputError(
                f"plant {address.url}: ?unit= names {', '.join(names)}; expected {n_strings} Modbus units, "
                "one for each string, each 0 to 247, or 1@HOST:PORT if it is elsewhere"
            )
        self.n_strings = n_strings
        known = [place for place in places if place is not None]
        gateways = {place[:2]: Gateway(*place[:2]) for place in known}
        self._gateways = tuple(gateways.values())
        self._devices = [Device(gateways[place[:2]], place[2], CLOCK) for place in known]
        self._heartbeat = 0
        # An earlier process may have written.
        self._holds_until = [CLOCK() + REVERT_S + 1.0] * n_strings
        self._calls = Calls()
        self._readings: Rounds[int, DeviceReadings] = Rounds(NoResponseError)
        self._writings: Rounds[int, None] = Rounds(NoResponseError)

    @property
    def refresh_s(self) -> float:
        """Maximum time [s] between two writes: 1 s if a device may monitor the heartbeat."""
        return HEARTBEAT_S if any(device.may_watch_heartbeat for device in self._devices) else REFRESH_S

    def read(self) -> Measurements:
        """Return the present measurements.

        Raises
        ------
        LinkError
            No device can be read.
        """
        said, silent = self._each(self._readings, range(self.n_strings), lambda i: self._devices[i].measure())
        if not said:
            raise LinkError(f"no device can be read: {next(iter(silent.values()))}")
        devices = [
            said[i] if i in said else DeviceReadings(remarks=str(silent[i])) for i in range(self.n_strings)
        ]
        columns: dict[str, Any] = {
            entry.name: np.array([getattr(device, entry.name) for device in devices])
            for entry in fields(DeviceReadings)
        }
        remarks = tuple(columns.pop("remarks").tolist())
        return Measurements(time=datetime.now(UTC), remarks=remarks, **columns)

    def write(self, power_kw: NDArray[np.float64]) -> None:
        """Write set-points; NaN clears that of a string."""
        setpoints = whole_watts(checked_setpoints(power_kw, self.n_strings))
        now = CLOCK()
        wanted = {i: w for i, w in enumerate(setpoints) if w is not None or now < self._holds_until[i]}
        failures = self._write(wanted)
        # A set-point that cannot be cleared reverts by itself.
        self._raise({i: error for i, error in failures.items() if setpoints[i] is not None})

    def release(self) -> None:
        """Clear all set-points; those that cannot be cleared revert by themselves."""
        self._raise(self._write(dict.fromkeys(range(self.n_strings))))

    def close(self) -> None:
        """Close the connections."""
        self._calls.close(self._disconnect())

    async def _disconnect(self) -> None:
        for gateway in self._gateways:
            gateway.disconnect()

    def _write(self, power_w: Mapping[int, int | None]) -> dict[int, NoResponseError]:
        """Write set-points, cleared ones first; return failures."""
        self._heartbeat = (self._heartbeat + 1) % 0xFFFF
        beat = self._heartbeat
        now = CLOCK()
        for i, watts in power_w.items():
            if watts is not None:
                self._holds_until[i] = now + REVERT_S + 1.0
        done, failures = self._each(
            self._writings,
            power_w,
            lambda i: self._devices[i].write(power_w[i], beat),
            lambda i: power_w[i] is None,
        )
        for i in done:
            if power_w[i] is None:
                self._holds_until[i] = -math.inf
        return failures

    def _raise(self, failures: Mapping[int, NoResponseError]) -> None:
        if failures:
            names = ", ".join(self._devices[i].name for i in failures)
            reason = next(iter(failures.values()))
            raise LinkError(f"set-points of {names} not written: {reason}")

    def _each(
        self,
        rounds: Rounds[int, T],
        strings: Iterable[int],
        call: Callable[[int], Awaitable[T]],
        first: Callable[[int], bool] = lambda i: False,
    ) -> tuple[dict[int, T], dict[int, NoResponseError]]:
        """Call all strings, in parallel for several addresses; return results and failures."""
        round_ = rounds(list(strings), call, lambda i: self._devices[i].gateway.turn, ALL_S, first)
        try:
            done, failed = self._calls(round_, ALL_S + CLOSING_TIME_S)
        except TimeoutError:
            raise LinkError(f"no answer within {ALL_S:g} s") from None
        late = f"is too slow: not done within {ALL_S:g} s"
        return done, {
            i: error
            if isinstance(error, NoResponseError)
            else NoResponseError(f"{self._devices[i].gateway.place} {late}")
            for i, error in failed.items()
        }


def _place(name: str, address: Address) -> tuple[str, int, int] | None:
    """Return host, port and unit of a string; None for an invalid text."""
    unit, at, elsewhere = name.partition("@")
    if not re.fullmatch(r"[0-9]{1,3}", unit) or int(unit) > 247:
        return None
    if not at:
        return address.host, address.port, int(unit)
    try:
        parts = urlsplit(f"//{elsewhere}")
        port = parts.port
    except ValueError:
        return None
    if not parts.hostname or port == 0 or parts.path or parts.username is not None:
        return None
    return parts.hostname, port or PORTS["sunspec"], int(unit)
