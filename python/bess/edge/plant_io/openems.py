"""The link to an OpenEMS edge, by the channels of its REST interface (``Controller.Api.Rest.ReadWrite``).

Facts from the edge's source that this link rests on:

- ``ActivePower`` and ``SetActivePowerEquals`` are in W, positive = discharge; ``Soc`` is in whole per cent.
- The edge writes a value anew in every cycle until ``apiTimeout`` (60 s) after the *last* value that came in,
  whichever string that was for. A string that is no longer written thus keeps its set-point for as long as
  others are. The value ``null`` takes it back at once; where that does not arrive, nothing is written to any
  string until the edge has forgotten all (:class:`~bess.edge.plant_io.shared_watchdog.SharedWatchdog`).
- It notices by itself that a battery does not answer any more, and says so by ``State``; it names no
  heartbeat.
- A wrong password is answered by status 500, as every other failure.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import ssl
import time
from collections.abc import Coroutine, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final, TypeVar

import httpx
import numpy as np
from numpy.typing import NDArray

from bess.edge.plant_io.address import Address
from bess.edge.plant_io.calls import GRACE_S, Calls, NotReached, Rounds, Stalled
from bess.edge.plant_io.json_numbers import number
from bess.edge.plant_io.link import LinkError, Measurements
from bess.edge.plant_io.setpoints import checked_setpoints, whole_watts
from bess.edge.plant_io.shared_watchdog import SharedWatchdog
from bess.errors import InputError

USER, PASSWORD = "BESS_PLANT_USER", "BESS_PLANT_PASSWORD"
"""Variables of the environment, for what the address does not name."""

REFRESH_S: Final = 20.0
"""A third of ``apiTimeout``, so that two writes in a row may be lost."""
FORGETS_S: Final = 65.0
"""``apiTimeout`` as the edge is delivered, and a little more."""
CLOCK: Final = time.monotonic
ANSWER_S: Final = 3.0
"""Time for one reading of all strings, or for writing all of them."""
CONNECTIONS: Final = 4
"""An edge takes five (``connectionlimit``), and one may be somebody else's."""
IDLE_S: Final = 20.0
"""A connection is kept that long: an edge takes ten new ones in 5 s, and closes idle ones after 30 s."""

_SET: Final = "SetActivePowerEquals"
_UNITS: Final[Mapping[str, tuple[str, ...]]] = {
    "Soc": ("%",),
    "ActivePower": ("W",),
    "AllowedChargePower": ("W",),
    "AllowedDischargePower": ("W",),
    "MinCellTemperature": ("°C", "C"),
    "MaxCellTemperature": ("°C", "C"),
    _SET: ("W",),
}
_FAULT: Final = 3
_OFF_GRID: Final = (2, 3)
_LONGEST_ANSWER: Final = 8 * 2**20
"""Bytes; an edge with dozens of batteries answers with some 100 kB."""

_Channels = dict[str, Any]
T = TypeVar("T")


class _RefusedError(LinkError):
    """The edge answered, and did not do what it was asked."""


class Link:
    """A plant behind an OpenEMS edge; one ``ess`` component for each string.

    Parameters
    ----------
    address
        Of the edge. Names of components that it does not give are asked of the edge: all ``essN`` that take
        set-points, in the order of their numbers. User and password that it does not give are taken from the
        environment, ``BESS_PLANT_USER`` and ``BESS_PLANT_PASSWORD``.
    n_strings
        Number of strings.

    Raises
    ------
    InputError
        If the address names another number of strings, or what cannot be a component.
    """

    refresh_s = REFRESH_S

    def __init__(self, address: Address, n_strings: int) -> None:
        odd = [
            name
            for name in (*address.strings, *address.meter.split())
            if not re.fullmatch(r"[A-Za-z0-9_]+", name)
        ]
        if odd or len(address.strings) not in (0, n_strings):
            raise InputError(
                f"plant {address.url}: ?ess= names {', '.join(address.strings)}; "
                f"expected {n_strings} components, one for each string, of letters and digits"
            )
        self.n_strings = n_strings
        self._url = address.url
        self._names: Sequence[str] = address.strings
        self._meter = address.meter
        user = address.user or os.environ.get(USER) or "x"  # the edge finds the user by the password alone
        password = address.password or os.environ.get(PASSWORD)
        self._calls = Calls()
        self._rounds: Rounds[str, bytes] = Rounds(LinkError)
        self._at_once = CONNECTIONS
        self._client = httpx.AsyncClient(
            base_url=address.url,
            auth=(user, password) if password else None,
            headers={"Accept-Encoding": "identity"},
            timeout=None,  # every call has a time for all of it
            limits=httpx.Limits(max_connections=CONNECTIONS, keepalive_expiry=IDLE_S),
            trust_env=False,  # no proxy between controller and plant
            verify=ssl.create_default_context() if address.scheme == "https" else False,
        )
        self._units_are_known = False
        self._watchdog = SharedWatchdog(REFRESH_S, FORGETS_S, CLOCK)

    def read(self) -> Measurements:
        """Return what the edge says now; see :class:`bess.edge.plant_io.PlantLink`.

        Raises
        ------
        LinkError
            The edge does not answer, or knows no inverter of these names.
        """
        return self._within(self._read())

    async def _read(self) -> Measurements:
        components = await self._components()
        if not self._names:
            self._names = self._found(components)
        strings = [components.get(name, {}) for name in self._names]
        if not any(strings):
            raise LinkError(f"{self._url}: knows none of {', '.join(self._names)}")
        self._check_units(strings)
        limits = [
            (_limit(s, "AllowedChargePower", -1.0), _limit(s, "AllowedDischargePower", 1.0)) for s in strings
        ]
        soc = np.array([number(s.get("Soc")) for s in strings]) / 100.0
        power_kw = np.array([number(s.get("ActivePower")) for s in strings]) / 1000.0
        charge_kw, discharge_kw = np.array(limits).T / 1000.0
        known = np.isfinite(soc) & np.isfinite(power_kw) & ~np.isnan(charge_kw) & ~np.isnan(discharge_kw)
        fit = np.array([s.get("State") != _FAULT and s.get("GridMode") not in _OFF_GRID for s in strings])
        return Measurements(
            time=datetime.now(UTC),
            soc=soc,
            temperature_c=np.array([_temperature_c(s) for s in strings]),
            power_kw=power_kw,
            charge_limit_kw=np.nan_to_num(charge_kw, nan=0.0, posinf=np.inf),
            discharge_limit_kw=np.nan_to_num(discharge_kw, nan=0.0, posinf=np.inf),
            available=known & fit,
            plant_kw=number(components.get(self._meter, {}).get("ActivePower")) / 1000.0,
            setpoint_kw=np.array([number(s.get(_SET)) for s in strings]) / 1000.0,
            remarks=tuple(
                "" if name in components and is_known else f"the edge says nothing of {name}, or not all"
                for name, is_known in zip(self._names, known, strict=True)
            ),
        )

    def write(self, power_kw: NDArray[np.float64]) -> None:
        """Write set-points; see :class:`bess.edge.plant_io.PlantLink`. NaN takes back the string's set-point.

        Raises
        ------
        LinkError
            The edge does not answer, or a set-point that stands cannot be changed.
        """
        setpoints = checked_setpoints(power_kw, self.n_strings)
        if not self._units_are_known:
            self.read()
        stuck, wait_s = self._watchdog.wait_s()
        if wait_s > 0.0:
            raise LinkError(
                f"{self._url}: {', '.join(stuck)} may still have a set-point that cannot be changed; "
                f"nothing is written for another {wait_s:.0f} s, so that it lapses"
            )
        values = dict(zip(self._names, whole_watts(setpoints), strict=True))
        failures = self._set({n: v for n, v in values.items() if v is not None or self._watchdog.may_hold(n)})
        # What cannot be taken back is the watchdog's matter: the strings that were written are well.
        self._raise({name: error for name, error in failures.items() if values[name] is not None})

    def release(self) -> None:
        """Take back the set-points of all strings; what does not arrive lapses after ``apiTimeout``."""
        self._raise(self._set(dict.fromkeys(self._names)))

    def close(self) -> None:
        """Close the connections."""
        self._calls.close(self._client.aclose())

    def _within(self, call: Coroutine[Any, Any, T], within_s: float | None = None) -> T:
        """Return what comes of a call, which ends in time whatever the edge does."""
        try:
            return self._calls(call, ANSWER_S if within_s is None else within_s)
        except TimeoutError:
            raise self._late() from None

    def _late(self) -> LinkError:
        return LinkError(f"{self._url}: no answer within {ANSWER_S:g} s")

    def _set(self, values: Mapping[str, int | None]) -> dict[str, LinkError]:
        """Write, first what takes a set-point back; return what did not arrive."""

        def post(name: str) -> Coroutine[Any, Any, bytes]:
            return self._call("POST", f"/rest/channel/{name}/{_SET}", {"value": values[name]})

        turn = asyncio.Semaphore(self._at_once)
        written: dict[str, bytes] = {}
        failed: Mapping[str, Exception] = dict.fromkeys(values, TimeoutError())
        try:
            written, failed = self._within(
                self._rounds(list(values), post, lambda name: turn, ANSWER_S, lambda n: values[n] is None),
                ANSWER_S + GRACE_S,
            )
        finally:
            refused = [name for name, error in failed.items() if isinstance(error, _RefusedError)]
            untouched = {name for name, error in failed.items() if isinstance(error, NotReached)}
            if written and any(isinstance(error, Stalled) for error in failed.values()):
                # The edge may take fewer connections; if one at a time is no better, it is the string.
                self._at_once = self._at_once // 2 or CONNECTIONS
            self._watchdog.note(
                written={name: values[name] is not None for name in written},
                unknown=failed.keys() - untouched - set(refused),
                refused=refused,
            )
        return {n: error if isinstance(error, LinkError) else self._late() for n, error in failed.items()}

    @staticmethod
    def _raise(failures: Mapping[str, LinkError]) -> None:
        if failures:
            reason = next(iter(failures.values()))
            raise LinkError(f"set-points of {', '.join(failures)} not written: {reason}")

    async def _components(self) -> dict[str, _Channels]:
        """Return the values of all channels of the components that may be strings, and their units."""
        pattern = "ess.*" if all(name.startswith("ess") for name in self._names) else ".*"
        if self._meter:
            pattern = f"({pattern}|{self._meter})"
        answer = await self._call("GET", f"/rest/channel/{pattern}/.*")
        try:
            rows = json.loads(answer)
            components: dict[str, _Channels] = {}
            for row in rows if isinstance(rows, list) else [rows]:  # one channel comes without a list
                name, _, channel = row["address"].partition("/")
                components.setdefault(name, {})[channel] = row.get("value")
                self._check_unit(name, channel, row.get("unit"))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise LinkError(
                f"{self._url}: does not answer as the REST interface of OpenEMS does "
                f"({type(error).__name__}: {error})"
            ) from error
        return components

    def _check_unit(self, name: str, channel: str, unit: object) -> None:
        if (
            channel in _UNITS
            and unit not in _UNITS[channel]
            and (name in (*self._names, self._meter) or not self._names)
        ):
            self._units_are_known = False
            raise LinkError(
                f"{self._url}: {name}/{channel} is in {unit!r}, expected {' or '.join(_UNITS[channel])}; "
                "nothing is read or written until this is put right"
            )

    def _check_units(self, strings: Sequence[_Channels]) -> None:
        """The edge must name the unit of what is to be written, of the strings that are there."""
        mute = [
            name for name, s in zip(self._names, strings, strict=True) if s and not {_SET, "Soc"} <= s.keys()
        ]
        if mute:
            raise LinkError(f"{self._url}: {', '.join(mute)} has no {_SET} or no Soc; name others with ?ess=")
        self._units_are_known = True

    def _found(self, components: Mapping[str, _Channels]) -> list[str]:
        names = [
            name
            for name, s in components.items()
            if re.fullmatch(r"ess\d+", name) and {_SET, "Soc"} <= s.keys()
        ]
        names.sort(key=lambda name: int(name[3:]))
        if len(names) != self.n_strings:
            raise LinkError(
                f"{self._url}: has {', '.join(names) or 'no battery'}, the study {self.n_strings} strings; "
                "name those to drive with ?ess=ess1,ess2 (a cluster is an ess too)"
            )
        return names

    async def _call(self, method: str, path: str, body: object = None) -> bytes:
        where = f"{self._url}{path}"
        answer = bytearray()
        try:
            async with self._client.stream(method, path, json=body) as response:
                async for chunk in response.aiter_raw():
                    answer += chunk
                    if len(answer) > _LONGEST_ANSWER:
                        raise LinkError(f"{where}: an answer of more than {_LONGEST_ANSWER} bytes")
                status = response.status_code
        except (httpx.HTTPError, OSError) as error:
            raise LinkError(f"{where}: cannot be reached ({error or type(error).__name__})") from error
        if status != httpx.codes.OK:
            raise _RefusedError(f"{where}: {_refusal(status, bytes(answer))}")
        return bytes(answer)


def _refusal(status: int, answer: bytes) -> str:
    if status in (401, 403) or b"uthentication" in answer:
        return (
            f"refuses user and password (status {status}); "
            f"set {PASSWORD}, and {USER} if the edge knows several users"
        )
    if status == httpx.codes.NOT_FOUND:
        return "there is no such channel (status 404)"
    return f"failed (status {status}); the edge's log says why"


def _limit(string: _Channels, channel: str, sign: float) -> float:
    """Return a limit [W], ``>= 0``; infinite where there is no such channel, NaN where it says nothing."""
    return max(sign * number(string.get(channel)), 0.0) if channel in string else math.inf


def _temperature_c(string: _Channels) -> float:
    """Mean of the coldest and the hottest cell."""
    known = [
        t
        for t in (number(string.get("MinCellTemperature")), number(string.get("MaxCellTemperature")))
        if t == t
    ]
    return sum(known) / len(known) if known else math.nan
