"""A simulated OpenEMS edge: the channels of its REST interface, for a simulated plant.

It behaves like the edge's source where a controller can observe it: values expire ``apiTimeout`` after the
last write to *any* string, ``null`` clears a set-point, per cent and powers are whole numbers, a single
channel comes without a list, a battery without response is in fault, and a wrong password gives status 500.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import math
import re
import socket
import threading
from typing import Annotated, Any, Final

import uvicorn
from fastapi import Depends, FastAPI, Request
from fastapi.security import HTTPBasic, HTTPBasicCredentials
from starlette.exceptions import HTTPException
from starlette.responses import Response

from bess.edge.plant_io.simulated import SimulatedPartner, SimulatedPlant

API_TIMEOUT_S: Final = 60.0
PASSWORD: Final = "owner"
"""Default password of a real edge."""

_FAILURES: Final = (HTTPException, ValueError, TypeError, KeyError, re.error)
_SET: Final = "SetActivePowerEquals"
_BASIC: Final = HTTPBasic(auto_error=False)


class SimulatedEdge(SimulatedPartner):
    """Serves a plant on the loopback, strings as ``ess0``, ``ess1``, ..., its meter as ``meter0``.

    ``password`` is valid for every user. All set-points expire ``api_timeout_s`` after the last write to any
    string. ``port`` 0 selects any free port.
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
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def address(self) -> str:
        """Address for ``--plant``, with the password."""
        return f"openems=http://x:{self.password}@127.0.0.1:{self._port}"

    def stop(self) -> None:
        """Break all connections, as when it is switched off; plant and watchdog continue."""
        if self._server is not None and self._thread is not None:
            self._server.should_exit = self._server.force_exit = True
            self._thread.join()
            self._server = None

    def channels(self) -> list[dict[str, Any]]:
        """Return all channels of all strings as reported by the edge."""
        unit, scale = ("kW", 1.0) if self.plant.faults.kilowatts else ("W", 1000.0)
        channels: dict[str, tuple[str, int | None]] = {}
        for string, said in self.plant.readings().items():
            ess, fault = f"ess{string}", said.fault or string in self.plant.faults.severed
            # A limit is rounded towards zero.
            channels |= {
                f"{ess}/Soc": ("%", _whole(100.0 * said.soc)),
                f"{ess}/ActivePower": (unit, _whole(scale * said.power_kw)),
                f"{ess}/AllowedChargePower": (unit, _whole(-scale * said.charge_limit_kw, math.ceil)),
                f"{ess}/AllowedDischargePower": (unit, _whole(scale * said.discharge_limit_kw, math.floor)),
                f"{ess}/MinCellTemperature": ("°C", _whole(said.coldest_c)),
                f"{ess}/MaxCellTemperature": ("°C", _whole(said.hottest_c)),
                f"{ess}/GridMode": ("", 1),
                f"{ess}/State": ("", 3 if fault else 0),
                f"{ess}/{_SET}": (unit, None),
            }
        total_kw = sum(reading.power_kw for reading in self.plant.truth())
        channels["meter0/ActivePower"] = (unit, _whole(scale * total_kw))
        return [
            {
                "address": address,
                "type": "INTEGER",
                "accessMode": "WO" if address.endswith(_SET) else "RW",
                "text": "",
                "unit": unit,
                **({} if address.endswith(_SET) else {"value": value}),
            }
            for address, (unit, value) in channels.items()
        ]

    def write(self, string: int, value: float | None) -> None:
        """Set a value [W] or clear the set-point (None), and extend all others."""
        lapses_at = self.plant.clock() + self.api_timeout_s
        self.plant.prolong(lapses_at)
        if value is None:
            self.plant.take_back(string)
        else:
            self.plant.ask(string, value / 1000.0, lapses_at)

    def _listen(self, port: int) -> int:
        listener = socket.create_server(("127.0.0.1", port))
        app = FastAPI(openapi_url=None, exception_handlers=dict.fromkeys(_FAILURES, _failed))
        route = "/rest/channel/{component}/{channel}"
        app.add_api_route(route, self._get, methods=["GET"], dependencies=[Depends(self._admit)])
        app.add_api_route(route, self._post, methods=["POST"], dependencies=[Depends(self._admit)])
        config = uvicorn.Config(app, log_config=None, access_log=False, lifespan="off")
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, args=([listener],), daemon=True)
        self._thread.start()
        return int(listener.getsockname()[1])

    async def _admit(self, given: Annotated[HTTPBasicCredentials | None, Depends(_BASIC)]) -> None:
        """Admit clients with the password."""
        await asyncio.sleep(self.plant.faults.delay_s)
        if given is None or not hmac.compare_digest(given.password.encode(), self.password.encode()):
            raise HTTPException(500, "Authentication failed")

    async def _get(self, component: str, channel: str) -> Response:
        rows = []
        for row in self.channels():
            its_component, _, its_channel = row["address"].partition("/")
            if re.fullmatch(component, its_component) and re.fullmatch(channel, its_channel):
                rows.append(row)
        return _json(rows[0] if len(rows) == 1 else rows or {}, 200 if rows else 404)

    async def _post(self, component: str, channel: str, request: Request) -> Response:
        value = (await request.json())["value"]
        strings = {f"ess{string}": string for string in self.plant.readings()}
        if channel != _SET or component not in strings:
            raise ValueError(f"{component}/{channel} is not a Write Channel")
        self.write(strings[component], None if value is None else float(value))
        return _json({})


def _whole(value: float, to_int: Any = round) -> int | None:
    return None if math.isnan(value) else int(to_int(value))


def _json(content: object, status: int = 200) -> Response:
    return Response(json.dumps(content), status, media_type="application/json")


async def _failed(request: Request, error: Exception) -> Response:
    """Answer every failure with status 500, as the edge does."""
    said = error.detail if isinstance(error, HTTPException) else f"REST call failed: {error}"
    return _json(said, 500)
