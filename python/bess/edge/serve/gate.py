"""Access control of the service: host names, token, request rates, bodies, and slow connections."""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import os
import re
import socket
import stat
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from bess.edge.serve import LOG
from bess.edge.serve.page import PAGE, PAGE_HEADERS
from bess.edge.serve.service import Service
from bess.errors import InputError
from bess.files import RepeatedKeyError, parse_json

REFUSALS: Final = LOG.getChild("requests")
HEALTH: Final = "/v1/health"
"""The one path that needs no token."""
_PAGES: Final = {"/", "/docs"}
MAX_BODY: Final = 256 * 1024
"""Maximum size of a request body [bytes]: all readings of 1,000 strings and a forecast of two days."""
_READ_S: Final = 10.0
"""Time limit for receiving a body."""
_OPEN_PER_S: Final = 100.0
"""Rate of requests without the token; those with it have their own rate."""
_BURST_S: Final = 2.0
_MIN_TOKEN_LENGTH: Final = 16
_MAX_TOKEN_LENGTH: Final = 4096
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
}
_CLOSE: Final = {"Connection": "close"}
"""For an incomplete body."""

HEADER_TIMEOUT_S: Final = 10.0
"""Time limit for receiving the head of a request."""
KEEP_ALIVE_S: Final = 30
"""Maximum idle time of a connection between two requests."""
MAX_UNADMITTED_PER_ADDRESS: Final = 256
"""Maximum connections of one address without an admitted request; one more ends the oldest of them."""
MAX_UNADMITTED: Final = 512
"""Maximum of such connections of all addresses."""
BACKLOG: Final = 64
"""Connections accepted at once: few enough that their data are read before they can be ended."""


def read_token(path: Path) -> str:
    """Return the token of a file: its only line."""
    try:
        with path.open("rb") as file:
            token = file.read(_MAX_TOKEN_LENGTH + 1).decode("ascii").strip()
    except (OSError, ValueError) as error:
        raise InputError(f"--token-file {path}: cannot be read ({error})") from error
    if not _MIN_TOKEN_LENGTH <= len(token) <= _MAX_TOKEN_LENGTH or not token.isprintable() or " " in token:
        raise InputError(
            f"--token-file {path}: needs one line of {_MIN_TOKEN_LENGTH} to {_MAX_TOKEN_LENGTH} characters "
            "without spaces; openssl rand -hex 32 makes one"
        )
    return token


def exposure(path: Path) -> str:
    """Return a warning if every user of this machine can read or write a token file, otherwise ""."""
    # On Windows, these bits say nothing about other users.
    if os.name == "nt" or not path.stat().st_mode & (stat.S_IROTH | stat.S_IWOTH):
        return ""
    return f"--token-file {path}: every user of this machine can read or write it; run chmod 600 {path}"


def is_allowed(token: str, authorization: str | None) -> bool:
    """Whether a header ``Authorization`` contains the token, compared in constant time."""
    given = (authorization or "").encode("utf-8", "replace")
    return hmac.compare_digest(given, f"Bearer {token}".encode())


def check_token(host: str, token: str | None, drives: bool) -> None:
    """Require a token to control a plant, or to listen to other machines."""
    if token is not None:
        return
    if drives:
        raise InputError(
            "--plant: every caller of this service controls the plant; give --token-file FILE "
            "(openssl rand -hex 32 makes a token), or use --shadow to observe only"
        )
    if not _is_loopback(host):
        raise InputError(
            f"--host {host}: other machines can reach the service; give --token-file FILE, or use 127.0.0.1"
        )


Authority = tuple[str, str]
"""A normalised host (lower case, no trailing dot, canonical address), and its port or ""."""

_AUTHORITY: Final = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([0-9A-Za-z._-]+))(?::([0-9]{1,5}))?")
_LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")
_OWN_PAGES: Final = {"same-origin", "none"}


class Names:
    """Host names of a service, against pages of other origins in an operator's browser.

    They are those of ``host``, on which it listens, and the further ``allowed`` ones. With DNS rebinding, the
    owner of a foreign domain points it at this service, so that a browser treats the foreign page as "same
    origin". ``Host`` must therefore be a name of the service, or a numeric address.
    """

    def __init__(self, host: str, allowed: Iterable[str] = ()) -> None:
        # Further authorities of the service's own pages, behind a proxy.
        self._proxies: set[Authority] = set()
        for text in allowed:
            authority = _authority(text)
            if authority is None:
                raise InputError(f"--allowed-host {text}: needs NAME or NAME:PORT, such as plant.example")
            self._proxies.add(authority)
        # A machine that is reached from outside is reached by any numeric address.
        self._any_address = not _is_loopback(host)
        machine = (host, socket.gethostname()) if self._any_address else (host,)
        self._own = {_normalised(name) for name in (*_LOOPBACK, *machine)}
        self._own |= {name for name, _ in self._proxies}

    def answers(self, host: str | None) -> bool:
        """Whether a ``Host`` header names this service; the port is ignored, because tunnels change it."""
        authority = _authority(host or "")
        if authority is None:
            return False
        return authority[0] in self._own or (self._any_address and _address(authority[0]) is not None)

    def is_own_page(self, host: str | None, origins: Iterable[str], sites: Iterable[str]) -> bool:
        """Whether ``Origin`` and ``Sec-Fetch-Site`` are of a page of the service, or of no page."""
        here = {_authority(host or ""), *self._proxies} - {None}
        pages = {_authority(origin.partition("://")[2]) for origin in origins}
        return pages <= here and _OWN_PAGES.issuperset(sites)


def _authority(text: str) -> Authority | None:
    found = _AUTHORITY.fullmatch(text)
    if found is None:
        return None
    name, port = _normalised(found[1] or found[2]), found[3] or ""
    return name, "" if port in ("80", "443") else port


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _normalised(name: str) -> str:
    return str(_address(name) or name.lower().removesuffix("."))


def _is_loopback(host: str) -> bool:
    address = _address(host)
    return host == "localhost" if address is None else address.is_loopback


LOCAL: Final = Names("127.0.0.1")
"""Names of a service that only this machine can reach."""


class Rate:
    """A token bucket: short bursts pass, the long-term rate is limited."""

    def __init__(self, per_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.per_s, self._clock = per_s, clock
        self._max_tokens = max(1.0, per_s * _BURST_S)
        self._tokens, self._at_s = self._max_tokens, clock()

    def take(self) -> bool:
        """Whether another request passes."""
        now_s = self._clock()
        self._tokens = min(self._max_tokens, self._tokens + (now_s - self._at_s) * self.per_s)
        self._at_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


class Gate:
    """Middleware that admits a request to the routes or refuses it in one sentence, counts it and logs it.

    Without a ``token`` every client is admitted; with one, every request except health must contain it.
    """

    def __init__(self, app: ASGIApp, service: Service, token: str | None, names: Names) -> None:
        self._app, self._token, self._names = app, token, names
        self._requests = service.metrics.requests
        self._rate = Rate(service.controller.service.requests_per_s)
        self._open_rate = Rate(_OPEN_PER_S)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            return await self._app(scope, receive, send)
        request = Request(scope, receive)
        path, began_s, status = scope["path"], time.perf_counter(), 0

        async def sending(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            self._admit(request)
            await self._app(scope, _limited(request), sending)
        except HTTPException as error:
            await _refused(request, error)(scope, receive, sending)
        except Exception:
            LOG.exception("a request failed")
            if status:
                raise
            await refusal(503, "the service failed to answer; see its log")(scope, receive, sending)
        is_known = any(getattr(route, "path", None) == path for route in scope["app"].routes)
        self._requests.labels(path if is_known else "other", str(status)).inc()
        if status >= 400:
            fields = {"path": path, "status": status, "time_s": round(time.perf_counter() - began_s, 6)}
            REFUSALS.warning("request refused", extra={"fields": fields})

    def _admit(self, request: Request) -> None:
        headers, path = request.headers, request.scope["path"]
        host = headers.get("host")
        if not self._names.answers(host):
            raise HTTPException(
                421,
                f"the header Host is {(host or '')[:80]!r}, not a name of this service; to add a name, "
                "start the service with --allowed-host NAME",
            )
        origins, sites = headers.getlist("origin"), headers.getlist("sec-fetch-site")
        if not self._names.is_own_page(host, origins, sites) and not _opens_page(request):
            raise HTTPException(
                403,
                "a page of another origin may not call this service; if it is this service's own page behind "
                "a proxy, start the service with --allowed-host NAME, the name of the proxy",
            )
        holds_token = self._token is not None and is_allowed(self._token, headers.get("authorization"))
        if not holds_token and self._token is not None and path != HEALTH:
            raise HTTPException(
                401,
                "the header Authorization: Bearer TOKEN is missing or wrong",
                {"WWW-Authenticate": "Bearer"},
            )
        is_open = path == HEALTH and not holds_token
        rate = self._open_rate if is_open else self._rate
        if not rate.take():
            raise HTTPException(429, f"more than {rate.per_s:g} requests a second", {"Retry-After": "1"})
        request.state.holds_token = holds_token
        if not is_open and (connection := getattr(request.state, "connection", None)):
            connection.admit()
        kind = ",".join(headers.getlist("content-type")).partition(";")[0]
        if request.method == "POST" and kind.strip().lower() != "application/json":
            raise HTTPException(415, "the body must be sent with the header Content-Type: application/json")


def refusal(status: int, sentence: str, headers: Any = None) -> Response:
    """Response with the reason for a refusal, in one sentence."""
    return JSONResponse({"detail": sentence}, status, headers)


def _opens_page(request: Request) -> bool:
    """Whether a person follows a link to one of the pages, which no script can read."""
    headers = request.headers
    goes = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    return goes and request.method == "GET" and request.scope["path"] in _PAGES and "origin" not in headers


def _refused(request: Request, error: HTTPException) -> Response:
    """A refusal; without the token it comes with the live page, which has a field for the token."""
    if error.status_code == 401 and request.method == "GET" and request.scope["path"] == "/":
        return Response(PAGE, 401, {**PAGE_HEADERS, **(error.headers or {})}, "text/html")
    return refusal(error.status_code, error.detail, error.headers)


def _limited(request: Request) -> Receive:
    """Receive a body as a whole, with limits of size and time, and check that it is JSON."""
    is_read = False

    async def received() -> Message:
        nonlocal is_read
        if is_read:
            return await request.receive()
        is_read, body = True, b""
        try:
            async with asyncio.timeout(_READ_S):
                async for part in request.stream():
                    body += part
                    if len(body) > MAX_BODY:
                        raise HTTPException(413, f"the body is longer than {MAX_BODY} bytes", _CLOSE)
            parse_json(body)
        except ClientDisconnect:
            raise HTTPException(400, "the client disconnected before the body was complete") from None
        except TimeoutError:
            raise HTTPException(408, f"the body took longer than {_READ_S:g} s", _CLOSE) from None
        except RepeatedKeyError as error:
            raise HTTPException(422, str(error)) from None
        except ValueError as error:
            raise HTTPException(422, f"the body is not JSON ({error})") from None
        return {"type": "http.request", "body": body, "more_body": False}

    return received


class Connection(H11Protocol):
    """A connection with time limits, which counts as unadmitted until a request on it is admitted.

    The application finds it in ``request.state.connection``.
    """

    def __init__(self, config: Any, server_state: Any, app_state: Any, _loop: Any = None) -> None:
        super().__init__(config, server_state, {**app_state, "connection": self}, _loop)
        self._is_unadmitted = True
        self._is_answering = False
        self._timeout: asyncio.TimerHandle | None = None

    def admit(self) -> None:
        """End the time limit of the head: the request is admitted."""
        self._is_unadmitted, self._is_answering = False, True
        self._stop_waiting()

    def connection_made(self, transport: Any) -> None:
        """Wait for a request; close the oldest of too many unadmitted connections."""
        super().connection_made(transport)
        self._peer = self.client[0] if self.client else ""
        self._made_s = self.loop.time()
        self._wait()
        ours = [each for each in self.connections if isinstance(each, Connection)]
        unadmitted = [each for each in ours if each._is_unadmitted]
        of_peer = [each for each in unadmitted if each._peer == self._peer]
        for connections, most in ((of_peer, MAX_UNADMITTED_PER_ADDRESS), (unadmitted, MAX_UNADMITTED)):
            if len(connections) > most:
                oldest = min(connections, key=lambda each: each._made_s)
                self.connections.discard(oldest)
                oldest.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Start the time limit of the head with its first data."""
        if not self._is_answering and self._timeout is None:
            self._wait()
        super().data_received(data)

    def on_response_complete(self) -> None:
        """Wait for the next request without a time limit."""
        self._is_answering = False
        self._stop_waiting()
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timer."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._timeout = self.loop.call_later(HEADER_TIMEOUT_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._timeout is not None:
            self._timeout.cancel()
            self._timeout = None
