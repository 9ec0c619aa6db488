"""The HTTP side of a service: routes, who may use them, and errors in one sentence."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from fastapi import FastAPI, Request, Response
from fastapi.openapi.utils import get_openapi
from starlette.exceptions import HTTPException

from bess import __version__
from bess.errors import InputError
from bess.plants.openems_solver import answer as openems_answer
from bess.serve.cycle import Cycle
from bess.serve.demands import Demands
from bess.serve.limits import LARGEST_BODY, Rate, is_allowed
from bess.serve.messages import (
    CalibrationMessage,
    DemandMessage,
    Message,
    SplitMessage,
    measurements_of,
    read_json,
    read_message,
)
from bess.serve.page import PAGE, PAGE_HEADERS, reference_page
from bess.serve.service import LOG, Service


@dataclass(frozen=True)
class Driven:
    """The plant behind a service that drives or watches it."""

    address: str
    demands: Demands
    cycle: Cycle

    def health(self) -> dict[str, Any]:
        """How the plant is doing."""
        troubles = [trouble for trouble in (self.cycle.trouble, self.cycle.journal_trouble) if trouble]
        if not troubles:
            return {"plant": self.address}
        return {"plant": self.address, "status": "impaired", "trouble": "; ".join(troubles)}


_OPEN: Final = {"/v1/health"}
_READ_S: Final = 10.0
"""Time in which a body must have arrived."""
_HEADERS: Final = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
}


def build_app(service: Service, token: str | None = None, driven: Driven | None = None) -> FastAPI:
    """Return the application.

    Parameters
    ----------
    service
        What answers.
    token
        Asked of every caller but of ``/v1/health``; None lets everybody in.
    driven
        What is asked of the plant that this service drives or watches; None if it is called instead.
    """
    app = FastAPI(title="bess serve", version=__version__, docs_url=None, redoc_url=None, openapi_url=None)
    rate = Rate(service.controller.service.requests_per_s)

    @app.middleware("http")
    async def guarded(request: Request, call: Callable[[Request], Awaitable[Response]]) -> Response:
        began_s = time.perf_counter()
        path = request.url.path
        if path not in _OPEN and not is_allowed(token, request.headers.get("authorization")):
            response = (
                Response(PAGE, 401, dict(PAGE_HEADERS), "text/html")
                if path == "/" and request.method == "GET"
                else _refusal(401, "the header Authorization: Bearer TOKEN is missing or wrong")
            )
            response.headers["WWW-Authenticate"] = "Bearer"
        elif not rate.take():
            response = _refusal(
                429, f"more than {service.controller.service.requests_per_s:g} requests a second"
            )
            response.headers["Retry-After"] = "1"
        else:
            try:
                response = await call(request)
            except Exception:
                LOG.exception("a request failed")
                response = _refusal(503, "the service could not answer; its log says why")
        for name, value in _HEADERS.items():
            response.headers.setdefault(name, value)
        known = path if any(getattr(route, "path", None) == path for route in app.routes) else "other"
        service.metrics.requests.labels(known, str(response.status_code)).inc()
        if response.status_code >= 400:
            fields = {
                "path": path,
                "status": response.status_code,
                "time_s": round(time.perf_counter() - began_s, 6),
            }
            LOG.warning("request refused", extra={"fields": fields})
        return response

    @app.exception_handler(HTTPException)
    async def http_error(request: Request, error: HTTPException) -> Response:
        return _refusal(error.status_code, f"{request.method} {request.url.path}: {error.detail}")

    @app.exception_handler(InputError)
    async def bad_input(request: Request, error: InputError) -> Response:
        return _refusal(422, str(error))

    @app.post("/v1/split", openapi_extra=_takes(SplitMessage), summary="Share a demand among the strings")
    async def split(request: Request) -> Response:
        if driven is not None:
            raise HTTPException(409, "this service reads its plant by itself; post the demand to /v1/demand")
        message = read_message(SplitMessage, await _body(request))
        measured = measurements_of(message, service.controller.system)
        answer = await service.split(measured, message.now_kw, message.forecast_kw)
        return _json(answer.document())

    @app.post("/v1/openems-solver", summary="Shares in per cent, as OpenEMS asks a solver for them")
    async def openems_solver(request: Request) -> Response:
        document = read_json(await _body(request))
        controller = service.controller
        split = controller.at_least_loss
        return _json(await service.call(openems_answer, document, controller.n_strings, split))

    @app.post("/v1/demand", openapi_extra=_takes(DemandMessage), summary="Ask a driven plant for power")
    async def demand(request: Request) -> Response:
        if driven is None:
            raise HTTPException(409, "this service drives no plant; call /v1/split, or start it with --plant")
        message = read_message(DemandMessage, await _body(request))
        driven.demands.post(message.demand_kw, message.valid_for_s, service.clock())
        return _json({"demand_kw": message.demand_kw, "valid_for_s": message.valid_for_s})

    @app.post(
        "/v1/calibration",
        openapi_extra=_takes(CalibrationMessage),
        summary="Charge one string to full while the others carry the load",
    )
    async def calibrate(request: Request) -> Response:
        message = read_message(CalibrationMessage, await _body(request))
        await service.call(service.calibrate, message.string, message.target_soc)
        return _json({"calibrating": message.string, "target_soc": message.target_soc})

    @app.delete("/v1/calibration", summary="End a calibration before it is done")
    async def end_calibration() -> Response:
        await service.call(service.end_calibration)
        return _json({"calibrating": None})

    @app.get("/v1/health", summary="Whether all is well; needs no token")
    async def health() -> Response:
        return _json(service.health() | (driven.health() if driven else {}))

    @app.get("/v1/live", summary="What the page shows: strings, set-points, reasons, the last day")
    async def live() -> Response:
        return _json(service.live() | ({"plant": driven.health()} if driven else {}))

    @app.get("/metrics", summary="Metrics for Prometheus")
    async def metrics() -> Response:
        return Response(service.metrics_text(), media_type="text/plain; version=0.0.4; charset=utf-8")

    @app.get("/", summary="A page that shows the strings live")
    async def page() -> Response:
        return Response(PAGE, headers=dict(PAGE_HEADERS), media_type="text/html")

    def schema() -> dict[str, Any]:
        made = get_openapi(title=app.title, version=app.version, routes=app.routes)
        models: tuple[type[Message], ...] = (SplitMessage, DemandMessage, CalibrationMessage)
        schemas = made.setdefault("components", {}).setdefault("schemas", {})
        for model in models:
            own = model.model_json_schema(ref_template="#/components/schemas/{model}")
            schemas |= own.pop("$defs", {})
            schemas[model.__name__] = own
        made["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        made["security"] = [{"token": []}]
        return made

    @app.get("/openapi.json", include_in_schema=False)
    async def openapi() -> Response:
        return _json(schema())

    @app.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        page, headers = reference_page(schema())
        return Response(page, headers=headers, media_type="text/html")

    return app


def _takes(model: type[Message]) -> dict[str, Any]:
    """What a route takes, for OpenAPI: bodies are read by hand, to refuse them in one sentence."""
    schema = {"$ref": f"#/components/schemas/{model.__name__}"}
    return {"requestBody": {"required": True, "content": {"application/json": {"schema": schema}}}}


async def _body(request: Request) -> bytes:
    """The body, no longer than is allowed."""
    body = b""
    try:
        async with asyncio.timeout(_READ_S):
            async for part in request.stream():
                body += part
                if len(body) > LARGEST_BODY:
                    raise HTTPException(413, f"the body is longer than {LARGEST_BODY} bytes")
    except TimeoutError:
        raise HTTPException(408, f"the body took longer than {_READ_S:g} s") from None
    return body


def _json(document: dict[str, Any], status: int = 200) -> Response:
    return Response(json.dumps(document, allow_nan=False), status, media_type="application/json")


def _refusal(status: int, sentence: str) -> Response:
    return _json({"detail": sentence}, status)
