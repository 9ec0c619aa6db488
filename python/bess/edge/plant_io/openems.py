"""Link to an OpenEMS edge through the channels of its REST interface (``Controller.Api.Rest.ReadWrite``).

It relies on these facts of the edge's source:

- ``ActivePower`` and ``SetActivePowerEquals`` are in W, positive = discharge; ``Soc`` is in whole per cent.
- The edge writes a value anew in every cycle until ``apiTimeout`` (60 s) after the *last* value it received,
  for any string. A string that is no longer written thus keeps its set-point for as long as others are
  written. The value ``null`` clears it at once; if that does not arrive, nothing is written to any string
  until all set-points have expired (:class:`SharedWatchdog`).
- It detects by itself that a battery does not respond any more and reports this in ``State``; it has no
  heartbeat.
- A wrong password gives status 500, like every other failure.
"""

from __future__ import annotations

import asyncio
import math
import os
import re
import ssl
from collections.abc import Coroutine, Iterable, Mapping
from functools import partial
from typing import Any, Final

import httpx

from bess.edge.plant_io import calls
from bess.edge.plant_io.address import Address
from bess.edge.plant_io.calls import CLOSING_TIME_S, NotReached, Rounds, Stalled
from bess.edge.plant_io.link import (
    REFRESH_S,
    LinkError,
    Measurements,
    StringLink,
    StringReadings,
    mean_temperature_c,
    measurements,
    number,
)
from bess.errors import InputError
from bess.files import parse_json

USER, PASSWORD = "BESS_PLANT_USER", "BESS_PLANT_PASSWORD"
"""Environment variables for an address without user or password."""

SETPOINT_TIMEOUT_S: Final = 65.0
"""Slightly more than the default of ``apiTimeout``."""
CONNECTIONS: Final = 4
"""An edge accepts five (``connectionlimit``), and one may be that of another client."""
IDLE_S: Final = 20.0
"""Lifetime of idle connections: an edge accepts ten new ones in 5 s, and closes idle ones after 30 s."""

_SET: Final = "SetActivePowerEquals"
_REQUIRED: Final = {_SET, "Soc"}
"""Channels that each string has."""
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
_MAX_ANSWER: Final = 8 * 2**20
"""Bytes; the answer of an edge with dozens of batteries has about 100 kB."""

_Channels = dict[str, Any]


class SharedWatchdog:
    """Strings that may hold a set-point that cannot be changed, at a plant with one watchdog for all writes.

    Writes to other strings would refresh such a set-point for ever. Once a string has refused writes for
    :data:`REFRESH_S` while others accepted them, nothing is written for :data:`SETPOINT_TIMEOUT_S`, after
    which the watchdog must have acted. Then the others continue without it.
    """

    def __init__(self) -> None:
        self._may_hold: set[str] | None = None
        self._refuses_since: dict[str, float] = {}
        self._fed_at_s = calls.CLOCK()

    def may_hold(self, name: str) -> bool:
        """Whether the plant may hold a set-point of this string; true for all before the first writes."""
        return self._may_hold is None or name in self._may_hold

    def wait_s(self) -> tuple[list[str], float]:
        """Return the strings that refuse, and the time for which nothing may be written because of them."""
        now = calls.CLOCK()
        if now - self._fed_at_s >= SETPOINT_TIMEOUT_S:
            self._may_hold, self._refuses_since = set(), {}
        stuck = [name for name, since in self._refuses_since.items() if now - since >= REFRESH_S]
        return stuck, self._fed_at_s + SETPOINT_TIMEOUT_S - now if stuck else 0.0

    def note(self, written: Mapping[str, bool], unknown: Iterable[str], refused: Iterable[str]) -> None:
        """Record one round of writes: whether written strings now have a set-point, and failed ones."""
        failed = {name for name in refused if self.may_hold(name)} | set(unknown)
        kept = set() if self._may_hold is None else self._may_hold - written.keys()
        self._may_hold = kept | failed | {name for name, holds in written.items() if holds}
        for name in written:
            self._refuses_since.pop(name, None)
        if written:
            self._fed_at_s = calls.CLOCK()
            for name in failed:
                self._refuses_since.setdefault(name, self._fed_at_s)


class _RefusedError(LinkError):
    """The edge answered with a refusal."""


class Link(StringLink[str]):
    """A plant behind an OpenEMS edge; one ``ess`` component for each string.

    Without names in the address, strings are all ``essN`` that accept set-points, in the order of their
    numbers. Without user and password, these are taken from ``BESS_PLANT_USER`` and ``BESS_PLANT_PASSWORD``.
    Methods are those of :class:`bess.edge.plant_io.PlantLink`.
    """

    refresh_s = REFRESH_S

    def __init__(self, address: Address, n_strings: int) -> None:
        named = [name for name in (*address.strings, address.meter) if name]
        odd = not all(re.fullmatch(r"[A-Za-z0-9_]+", name) for name in named)
        if odd or len(address.strings) not in (0, n_strings):
            raise InputError(
                f"plant {address.url}: ?ess= and ?meter= name {', '.join(named)}; expected {n_strings} "
                "components, one for each string, and a meter if there is one, of letters and digits"
            )
        super().__init__(address.strings, n_strings, place=address.url)
        self._url = address.url
        self._meter = address.meter
        user = address.user or os.environ.get(USER) or "x"  # the edge identifies users by password only
        password = address.password or os.environ.get(PASSWORD)
        self._rounds: Rounds[str, bytes] = Rounds(LinkError)
        self._at_once = CONNECTIONS
        self._new_client = partial(
            httpx.AsyncClient,
            base_url=address.url,
            auth=(user, password) if password else None,
            headers={"Accept-Encoding": "identity"},
            timeout=None,  # each call has a total deadline
            limits=httpx.Limits(max_connections=CONNECTIONS, keepalive_expiry=IDLE_S),
            trust_env=False,  # no proxy between controller and plant
            verify=ssl.create_default_context() if address.scheme == "https" else False,
        )
        self._client = self._new_client()
        self._units_are_known = False
        self._watchdog = SharedWatchdog()

    def read(self) -> Measurements:
        """Return the present measurements."""
        return self._within(self._read(), calls.DEADLINE_S)

    async def _read(self) -> Measurements:
        components = await self._components()
        if not self._strings:
            self._strings = self._found(components)
        strings = [components.get(name, {}) for name in self._strings]
        if not any(strings):
            raise LinkError(f"{self._url}: has none of {', '.join(self._strings)}")
        mute = [
            name for name, s in zip(self._strings, strings, strict=True) if s and not s.keys() >= _REQUIRED
        ]
        if mute:
            raise LinkError(f"{self._url}: {', '.join(mute)} has no {_SET} or no Soc; name others with ?ess=")
        if self._meter and not self._units_are_known and "ActivePower" not in components.get(self._meter, {}):
            raise LinkError(f"{self._url}: {self._meter} has no ActivePower; correct or omit ?meter=")
        self._units_are_known = True
        plant_kw = number(components.get(self._meter, {}).get("ActivePower")) / 1000.0
        return measurements(list(map(_readings, self._strings, strings)), plant_kw)

    def _may_write(self) -> None:
        """Read the units first; wait for a string whose set-point must expire (:class:`SharedWatchdog`)."""
        if not self._units_are_known:
            self.read()
        stuck, wait_s = self._watchdog.wait_s()
        if wait_s > 0.0:
            raise LinkError(
                f"{self._url}: {', '.join(stuck)} may still have a set-point that cannot be changed; "
                f"nothing is written for another {wait_s:.0f} s, so that it expires"
            )

    def _may_hold(self, string: str) -> bool:
        return self._watchdog.may_hold(string)

    async def _disconnect(self) -> None:
        await self._client.aclose()

    def _set(self, power_w: Mapping[str, int | None]) -> dict[str, LinkError]:
        def post(name: str) -> Coroutine[Any, Any, bytes]:
            return self._call("POST", f"/rest/channel/{name}/{_SET}", {"value": power_w[name]})

        turn = asyncio.Semaphore(self._at_once)
        written: dict[str, bytes] = {}
        failed: Mapping[str, Exception] = dict.fromkeys(power_w, TimeoutError())
        try:
            written, failed = self._within(
                self._rounds(list(power_w), post, lambda name: turn, lambda n: power_w[n] is None),
                calls.DEADLINE_S + CLOSING_TIME_S,
            )
        finally:
            refused = [name for name, error in failed.items() if isinstance(error, _RefusedError)]
            untouched = {name for name, error in failed.items() if isinstance(error, NotReached)}
            if written and any(isinstance(error, Stalled) for error in failed.values()):
                # The edge may accept fewer connections; if one at a time does not help, the string stalls.
                self._at_once = self._at_once // 2 or CONNECTIONS
            self._watchdog.note(
                written={name: power_w[name] is not None for name in written},
                unknown=failed.keys() - untouched - set(refused),
                refused=refused,
            )
        return {n: error if isinstance(error, LinkError) else self._late() for n, error in failed.items()}

    async def _components(self) -> dict[str, _Channels]:
        """Return the values of all channels of possible strings; check their units."""
        pattern = "ess.*" if all(name.startswith("ess") for name in self._strings) else ".*"
        if self._meter:
            pattern = f"({pattern}|{self._meter})"
        answer = await self._call("GET", f"/rest/channel/{pattern}/.*")
        components: dict[str, _Channels] = {}
        try:
            rows = parse_json(answer)
            for row in rows if isinstance(rows, list) else [rows]:  # one channel comes without a list
                name, _, channel = row["address"].partition("/")
                components.setdefault(name, {})[channel] = row.get("value")
                unit, is_used = row.get("unit"), not self._strings or name in (*self._strings, self._meter)
                if is_used and unit not in _UNITS.get(channel, (unit,)):
                    self._units_are_known = False
                    raise LinkError(
                        f"{self._url}: {name}/{channel} is in {unit!r}, expected "
                        f"{' or '.join(_UNITS[channel])}; nothing is read or written until this is corrected"
                    )
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise LinkError(
                f"{self._url}: does not answer as the REST interface of OpenEMS does "
                f"({type(error).__name__}: {error})"
            ) from error
        return components

    def _found(self, components: Mapping[str, _Channels]) -> list[str]:
        names = [
            name for name, s in components.items() if re.fullmatch(r"ess\d+", name) and s.keys() >= _REQUIRED
        ]
        names.sort(key=lambda name: int(name[3:]))
        if len(names) != self.n_strings:
            raise LinkError(
                f"{self._url}: has {', '.join(names) or 'no battery'}, the study {self.n_strings} strings; "
                "name the strings with ?ess=ess1,ess2 (a cluster is an ess too)"
            )
        return names

    async def _call(self, method: str, path: str, body: object = None) -> bytes:
        where = f"{self._url}{path}"
        answer = bytearray()
        client = self._client
        try:
            async with client.stream(method, path, json=body) as response:
                async for chunk in response.aiter_raw():
                    answer += chunk
                    if len(answer) > _MAX_ANSWER:
                        raise LinkError(f"{where}: an answer of more than {_MAX_ANSWER} bytes")
                status = response.status_code
        except asyncio.CancelledError:
            # The pool may never take back the connection of a cancelled call (encode/httpcore issue 830).
            if client is self._client:
                self._client = self._new_client()
            await client.aclose()
            raise
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
    return f"failed (status {status}); see the log of the edge"


def _readings(name: str, string: _Channels) -> StringReadings:
    soc, power_kw = number(string.get("Soc")) / 100.0, number(string.get("ActivePower")) / 1000.0
    charge_kw = _limit(string, "AllowedChargePower", -1.0) / 1000.0
    discharge_kw = _limit(string, "AllowedDischargePower", 1.0) / 1000.0
    known = {"Soc": soc, "ActivePower": power_kw}
    known |= {"AllowedChargePower": charge_kw, "AllowedDischargePower": discharge_kw}
    missing = [f"{name}/{channel}" for channel, reading in known.items() if math.isnan(reading)]
    return StringReadings(
        soc,
        mean_temperature_c(*(number(string.get(f"{end}CellTemperature")) for end in ("Min", "Max"))),
        power_kw,
        0.0 if math.isnan(charge_kw) else charge_kw,
        0.0 if math.isnan(discharge_kw) else discharge_kw,
        number(string.get(_SET)) / 1000.0,
        not missing and string.get("State") != _FAULT and string.get("GridMode") not in _OFF_GRID,
        f"the edge reports no value of {', '.join(missing)}" if missing else "",
    )


def _limit(string: _Channels, channel: str, sign: float) -> float:
    """Return a limit [W], ``>= 0``; infinite without the channel, NaN without a value."""
    return max(sign * number(string.get(channel)), 0.0) if channel in string else math.inf
