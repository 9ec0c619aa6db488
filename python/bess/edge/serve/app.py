"""The HTTP interface of the service: routes, and errors in one sentence."""

from __future__ import annotations

from typing import Literal

from fastapi import Depends, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.security import HTTPBearer
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse

from bess import __version__
from bess.edge.plant_io.openems_solver import answer as openems_answer
from bess.edge.serve.answer import Demand
from bess.edge.serve.control_loop import ControlLoop
from bess.edge.serve.gate import HEALTH, LOCAL, Gate, Names, refusal
from bess.edge.serve.messages import (
    CalibrationMessage,
    DemandMessage,
    SplitMessage,
    measurements_of,
    sentence,
)
from bess.edge.serve.page import PAGE, PAGE_HEADERS, live, reference_page
from bess.edge.serve.service import Service
from bess.errors import InputError


class Refusal(BaseModel):
    """Reason for a refused request, in one sentence."""

    detail: str


def build_app(
    service: Service, token: str | None = None, loop: ControlLoop | None = None, names: Names = LOCAL
) -> FastAPI:
    """Return the application; ``loop`` is None if clients send the measurements.

    Every route except ``/v1/health`` requires the ``token``; None permits all clients.
    """
    app = FastAPI(
        title="bess serve",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        dependencies=[Depends(HTTPBearer(scheme_name="token", auto_error=False))],
        responses={"4XX": {"model": Refusal, "description": "Reason for the refusal, in one sentence."}},
    )
    app.add_middleware(Gate, service=service, token=token, names=names)

    @app.exception_handler(HTTPException)
    async def http_error(request: Request, error: HTTPException) -> Response:
        where = "" if error.status_code == 422 else f"{request.method} {request.scope['path']}: "
        return refusal(error.status_code, where + error.detail, error.headers)

    @app.exception_handler(RequestValidationError)
    async def bad_message(request: Request, error: RequestValidationError) -> Response:
        return refusal(422, sentence(error.errors(), request.scope["path"]))

    @app.exception_handler(InputError)
    async def bad_input(request: Request, error: InputError) -> Response:
        return refusal(422, str(error))

    async def without_plant() -> None:
        if loop is not None:
            raise HTTPException(409, "this service reads its plant itself; post the demand to /v1/demand")

    async def with_plant() -> ControlLoop:
        if loop is None:
            raise HTTPException(409, "this service controls no plant; call /v1/split, or start with --plant")
        return loop

    to_plant = Depends(with_plant)

    @app.post("/v1/split", dependencies=[Depends(without_plant)], summary="Allocate a demand to the strings")
    async def split(message: SplitMessage) -> Response:
        measured = measurements_of(message, service.controller.system)
        answer = await service.split(measured, Demand.of(message.demand_kw))
        return JSONResponse(answer.document())

    @app.post("/v1/openems-solver", summary="Shares in per cent, for the solver interface of OpenEMS")
    async def openems_solver(request: Request) -> Response:
        controller, body = service.controller, await request.json()
        split = controller.at_least_loss
        return JSONResponse(await service.call(openems_answer, body, controller.n_strings, split))

    @app.post("/v1/demand", summary="Set the demand of a controlled plant")
    async def demand(message: DemandMessage, request: Request, to: ControlLoop = to_plant) -> Response:
        by = "" if request.client is None else request.client.host
        to.demands.post(message.demand_kw, message.valid_for_s, service.clock(), by)
        return JSONResponse({"demand_kw": message.demand_kw, "valid_for_s": message.valid_for_s})

    @app.post("/v1/calibration", summary="Charge one string to full while the others carry the load")
    async def calibrate(message: CalibrationMessage) -> Response:
        await service.call(service.calibrate, message.string, message.target_soc)
        return JSONResponse({"calibrating": message.string, "target_soc": message.target_soc})

    @app.delete("/v1/calibration", summary="End a calibration before it is done")
    async def end_calibration() -> Response:
        await service.call(service.end_calibration)
        return JSONResponse({"calibrating": None})

    @app.get(HEALTH, summary="Health of the service; needs no token", openapi_extra={"security": [{}]})
    async def health(request: Request) -> Response:
        of_plant = {} if loop is None else loop.health(request.state.holds_token)
        return JSONResponse(service.health() | of_plant)

    @app.get("/v1/live", summary="Data of the live page: plant, demand, strings, and the history of a span")
    async def live_document(span: Literal["2h", "day", "week"] = "day") -> Response:
        shown = live(service, span)
        if loop is not None:
            active = loop.active_demand()
            source = "" if active is None else active.source
            shown |= {"plant": loop.health(with_details=True), "asked_by": source}
        return JSONResponse(shown)

    @app.get("/metrics", summary="Metrics for Prometheus", response_class=PlainTextResponse)
    async def metrics() -> Response:
        text = service.metrics.text(service.last, service.controller)
        return Response(text, media_type="text/plain; version=0.0.4; charset=utf-8")

    @app.get("/", summary="A page that shows the strings live", response_class=HTMLResponse)
    async def page() -> Response:
        return Response(PAGE, headers=PAGE_HEADERS, media_type="text/html")

    @app.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        page, headers = reference_page(app.openapi())
        return Response(page, headers=headers, media_type="text/html")

    return app
