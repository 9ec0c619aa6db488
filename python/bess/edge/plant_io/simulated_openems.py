"""A simulated OpenEMS edge: the channels of its REST interface, in front of a simulated plant.

It behaves as the edge's source does where a controller can tell the difference: values lapse ``apiTimeout``
after the last write to *any* string, ``null`` takes a set-point back, per cent and powers are whole numbers,
one channel alone comes without a list, a battery that does not answer any more is in fault, and a wrong
password is a failure with status 500.
"""

from __future__ import annotations

import base64
import hmac
import json
import math
import re
import socket
import threading
import time
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final
from urllib.parse import unquote

from bess.edge.plant_io.simulated import Reading, SimulatedPlant
from bess.edge.plant_io.simulated_partner import SimulatedPartner

API_TIMEOUT_S: Final = 60.0
PASSWORD: Final = "owner"
"""That of a real edge as it is delivered; it guards a simulation on the loopback."""

_SET: Final = "SetActivePowerEquals"
_LONGEST_BODY: Final = 65_536


class SimulatedEdge(SimulatedPartner):
    """Serves a plant on the loopback, strings as ``ess0``, ``ess1``, ..., its meter as ``meter0``.

    Parameters
    ----------
    plant
        What is behind it.
    port
        0 for any that is free.
    password
        Of every user.
    api_timeout_s
        Time after the last write of any string until all set-points lapse.
    """

    def __init__(
        self,
        plant: SimulatedPlant,
        *,
        port: int = 0,
        password: str = PASSWORD,
        api_timeout_s: float = API_TIMEOUT_S,
    ) -> None:
        super().__init__(plant, port)
        self.password = password
        self.api_timeout_s = api_timeout_s
        self._server: _Server | None = None

    @property
    def address(self) -> str:
        """What ``--plant`` takes, password included."""
        return f"openems=http://x:{self.password}@127.0.0.1:{self._port}"

    def stop(self) -> None:
        """Vanish as a computer that is switched off: connections break; plant and watchdog live on."""
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server.cut()
            self._server = None

    def channels(self) -> list[dict[str, Any]]:
        """Return all channels of all strings as the edge says them."""
        said = [
            (f"ess{string}/{name}", unit, value)
            for string, reading in self.plant.readings().items()
            for name, unit, value in self._said(reading, string in self.plant.faults.severed)
        ]
        unit, scale = self._unit
        total_kw = sum(reading.power_kw for reading in self.plant.truth())
        return [
            {
                "address": address,
                "type": "INTEGER",
                "accessMode": "WO" if address.endswith(_SET) else "RW",
                "text": "",
                "unit": unit,
                **({} if address.endswith(_SET) else {"value": value}),
            }
            for address, unit, value in (*said, ("meter0/ActivePower", unit, _whole(scale * total_kw)))
        ]

    def write(self, string: int, value: float | None) -> None:
        """Take a value [W]; None takes the set-point back. All others hold anew."""
        lapses_at = self.plant.clock() + self.api_timeout_s
        self.plant.prolong(lapses_at)
        if value is None:
            self.plant.take_back(string)
        else:
            self.plant.ask(string, value / 1000.0, lapses_at)

    def _listen(self, port: int) -> int:
        self._server = server = _Server(("127.0.0.1", port), _Handler)
        server.edge = self
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        return int(server.server_address[1])

    @property
    def _unit(self) -> tuple[str, float]:
        """Unit of powers, and what 1 kW is in it."""
        return ("kW", 1.0) if self.plant.faults.kilowatts else ("W", 1000.0)

    def _said(self, reading: Reading, is_severed: bool) -> list[tuple[str, str, int | None]]:
        unit, scale = self._unit
        # A limit is rounded towards zero.
        return [
            ("Soc", "%", _whole(100.0 * reading.soc)),
            ("ActivePower", unit, _whole(scale * reading.power_kw)),
            ("AllowedChargePower", unit, _whole(-scale * reading.charge_limit_kw, math.ceil)),
            ("AllowedDischargePower", unit, _whole(scale * reading.discharge_limit_kw, math.floor)),
            ("MinCellTemperature", "°C", _whole(reading.coldest_c)),
            ("MaxCellTemperature", "°C", _whole(reading.hottest_c)),
            ("GridMode", "", 1),
            ("State", "", 3 if reading.fault or is_severed else 0),
            (_SET, unit, None),
        ]


def _whole(value: float, to_int: Any = round) -> int | None:
    return None if math.isnan(value) else int(to_int(value))


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    edge: SimulatedEdge

    def __init__(self, *arguments: Any) -> None:
        self._open: set[socket.socket] = set()
        super().__init__(*arguments)

    def get_request(self) -> tuple[socket.socket, Any]:
        connection, address = super().get_request()
        self._open.add(connection)
        return connection, address

    def shutdown_request(self, request: Any) -> None:
        self._open.discard(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of connections that the other end broke."""

    def cut(self) -> None:
        """Break every connection."""
        for connection in list(self._open):
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: _Server

    def do_GET(self) -> None:
        self._answer(self._get)

    def do_POST(self) -> None:
        self._answer(self._post)

    def log_message(self, *arguments: Any) -> None:
        """Keep silent."""

    def _answer(self, respond: Any) -> None:
        edge = self.server.edge
        length = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(min(length, _LONGEST_BODY))
        time.sleep(edge.plant.faults.delay_s)
        if not self._authentic(edge.password):
            status, content = HTTPStatus.INTERNAL_SERVER_ERROR, "Authentication failed"
        else:
            component, _, channel = unquote(self.path).removeprefix("/rest/channel/").partition("/")
            try:
                status, content = respond(edge, component, channel, body)
            except (ValueError, TypeError, KeyError, re.error) as error:
                status, content = HTTPStatus.INTERNAL_SERVER_ERROR, f"REST call failed: {error}"
        encoded = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(encoded)))
        self.end_headers()
        self.wfile.write(encoded)

    def _authentic(self, password: str) -> bool:
        _, _, credentials = (self.headers.get("Authorization") or "").partition(" ")
        with suppress(ValueError):
            said = base64.b64decode(credentials).decode().partition(":")[2]
            return hmac.compare_digest(said.encode(), password.encode())
        return False

    @staticmethod
    def _get(edge: SimulatedEdge, component: str, channel: str, body: bytes) -> tuple[HTTPStatus, Any]:
        rows = []
        for row in edge.channels():
            its_component, _, its_channel = row["address"].partition("/")
            if re.fullmatch(component, its_component) and re.fullmatch(channel, its_channel):
                rows.append(row)
        if not rows:
            return HTTPStatus.NOT_FOUND, {}
        return HTTPStatus.OK, rows[0] if len(rows) == 1 else rows

    @staticmethod
    def _post(edge: SimulatedEdge, component: str, channel: str, body: bytes) -> tuple[HTTPStatus, Any]:
        value = json.loads(body)["value"]
        strings = {f"ess{string}": string for string in edge.plant.readings()}
        if channel != _SET or component not in strings:
            raise ValueError(f"{component}/{channel} is not a Write Channel")
        edge.write(strings[component], None if value is None else float(value))
        return HTTPStatus.OK, {}
