"""The gate in front of the routes: who is let in, with what body, and what is counted and said of it."""

from __future__ import annotations

import asyncio
import time
from typing import Any, Final

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bess.edge.serve.limits import LARGEST_BODY, Names, Rate, is_allowed
from bess.edge.serve.messages import read_json
from bess.edge.serve.page import PAGE, PAGE_HEADERS
from bess.edge.serve.service import LOG, Service
from bess.errors import InputError

REFUSALS: Final = LOG.getChild("requests")
"""Where refused requests are noted."""
HEALTH: Final = "/v1/health"
"""The one path that needs no token."""
_PAGES: Final = {"/", "/docs"}
_READ_S: Final = 10.0
"""Time in which a body must have arrived."""
_OPEN_PER_S: Final = 100.0
"""Requests that are answered without the token; those of its holder are counted by themselves."""
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
}
_CLOSE: Final = {"Connection": "close"}
"""For a body of which more may come."""


class Gate:
    """Lets a request through to the routes, or refuses it in one sentence.

    Parameters
    ----------
    app
        The routes.
    service
        Its metrics count requests, its settings limit them.
    token
        What every caller but of health must send; None lets everybody in.
    names
        What ``Host`` and ``Origin`` may hold.
    """

    def __init__(self, app: ASGIApp, service: Service, token: str | None, names: Names) -> None:
        self._app, self._token, self._names = app, token, names
        self._requests = service.metrics.requests
        self._rate = Rate(service.controller.service.requests_per_s)
        self._open_rate = Rate(_OPEN_PER_S)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
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
            await refusal(503, "the service could not answer; its log says why")(scope, receive, sending)
        is_known = any(getattr(route, "path", None) == path for route in scope["app"].routes)
        self._requests.labels(path if is_known else "other", str(status)).inc()
        if status >= 400:
            fields = {"path": path, "status": status, "time_s": round(time.perf_counter() - began_s, 6)}
            REFUSALS.warning("request refused", extra={"fields": fields})

    def _admit(self, request: Request) -> None:
        """Refuse what may not pass."""
        headers, path = request.headers, request.scope["path"]
        host = headers.get("host")
        if not self._names.answers(host):
            raise HTTPException(
                421,
                f"the header Host holds {(host or '')[:80]!r}, which is no name of this service; if it is to "
                "be one, start the service with --allowed-host NAME",
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
            connection.welcome()
        kind = ",".join(headers.getlist("content-type")).partition(";")[0]
        if request.method == "POST" and kind.strip().lower() != "application/json":
            raise HTTPException(415, "the body must be sent with the header Content-Type: application/json")


def refusal(status: int, sentence: str, headers: Any = None) -> Response:
    """One sentence on why a request is refused."""
    return JSONResponse({"detail": sentence}, status, headers)


def _opens_page(request: Request) -> bool:
    """Whether somebody follows a link to one of the pages, which shows it to that person alone."""
    headers = request.headers
    goes = headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
    return goes and request.method == "GET" and request.scope["path"] in _PAGES and "origin" not in headers


def _refused(request: Request, error: HTTPException) -> Response:
    """A refusal; without the token the page comes with it, for it has the field to enter one."""
    if error.status_code == 401 and request.method == "GET" and request.scope["path"] == "/":
        return Response(PAGE, 401, {**PAGE_HEADERS, **(error.headers or {})}, "text/html")
    return refusal(error.status_code, error.detail, error.headers)


def _limited(request: Request) -> Receive:
    """Receive a body at once: no longer than is allowed, in no more time, and in JSON."""
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
                    if len(body) > LARGEST_BODY:
                        raise HTTPException(413, f"the body is longer than {LARGEST_BODY} bytes", _CLOSE)
            read_json(body)
        except ClientDisconnect:
            raise HTTPException(400, "the caller has gone before the body was complete") from None
        except TimeoutError:
            raise HTTPException(408, f"the body took longer than {_READ_S:g} s", _CLOSE) from None
        except InputError as error:
            raise HTTPException(422, str(error)) from None
        return {"type": "http.request", "body": body, "more_body": False}

    return received
