"""The HTTP side of a service: routes, who may use them, and errors in one sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from fastapi import Depends, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.security import HTTPBearer
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse

from bess import __version__
from bess.edge.plant_io.openems_solver import answer as openems_answer
from bess.edge.serve.control_loop import ControlLoop
from bess.edge.serve.demands import Demands
from bess.edge.serve.gate import HEALTH, Gate, refusal
from bess.edge.serve.limits import LOCAL, Names
from bess.edge.serve.live import live
from bess.edge.serve.messages import (
    CalibrationMessage,
    DemandMessage,
    SplitMessage,
    measurements_of,
    sentence,
)
from bess.edge.serve.page import PAGE, PAGE_HEADERS, reference_page
from bess.edge.serve.service import Service
from bess.errors import InputError


@dataclass(frozen=True)
class Driven:
    """The plant behind a service that drives or watches it."""

    address: str
    demands: Demands
    cycle: ControlLoop

    def health(self, tells: bool) -> dict[str, Any]:
        """How the plant is doing; its address, and sentences that may hold it, only if ``tells``."""
        cycle = self.cycle
        age_s, period_s = cycle.age_s, cycle.period_s
        stands = age_s > 2.0 * period_s
        still = f"the control cycle, of {period_s:g} s, has stood still for {age_s:.0f} s" if stands else ""
        troubles = [trouble for trouble in (still, cycle.trouble, cycle.journal_trouble) if trouble]
        health: dict[str, Any] = {"cycle_age_s": round(age_s, 3), "cycle_period_s": period_s}
        if troubles:
            health["status"] = "impaired"
        if tells:
            health["plant"] = self.address
        if said := "; ".join(troubles if tells else [still]):
            health["trouble"] = said
        return health

    def source(self, service: Service) -> str:
        """Source of the present demand, as text; empty without a demand."""
        asked = self.demands.at(service.clock(), service.controller.plan.n_steps)
        return "" if asked is None else asked.source


class Refusal(BaseModel):
    """Why a request is refused, in one sentence."""

    detail: str


def build_app(
    service: Service,
    token: str | None = None,
    driven: Driven | None = None,
    names: Names = LOCAL,
) -> FastAPI:
    """Return the application.

    Parameters
    ----------
    service
        What answers.
    token
        Asked of every caller but of ``/v1/health``; None lets everybody in.
    driven
        What is asked of the plant that this service drives or watches; None if it is called instead.
    names
        Under which the service may be called.
    """
    app = FastAPI(
        title="bess serve",
        version=__version__,
        docs_url=None,
        redoc_url=None,
        dependencies=[Depends(HTTPBearer(scheme_name="token", auto_error=False))],
        responses={"4XX": {"model": Refusal, "description": "What is refused, and why, in one sentence."}},
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

    async def is_called() -> None:
        if driven is not None:
            raise HTTPException(409, "this service reads its plant by itself; post the demand to /v1/demand")

    async def plant() -> Driven:
        if driven is None:
            raise HTTPException(409, "this service drives no plant; call /v1/split, or start it with --plant")
        return driven

    to_plant = Depends(plant)

    @app.post("/v1/split", dependencies=[Depends(is_called)], summary="Share a demand among the strings")
    async def split(message: SplitMessage) -> Response:
        measured = measurements_of(message, service.controller.system)
        answer = await service.split(measured, message.now_kw, message.forecast_kw)
        return JSONResponse(answer.document())

    @app.post("/v1/openems-solver", summary="Shares in per cent, as OpenEMS asks a solver for them")
    async def openems_solver(request: Request) -> Response:
        controller = service.controller
        split = controller.at_least_loss
        return JSONResponse(
            await service.call(openems_answer, await request.json(), controller.n_strings, split)
        )

    @app.post("/v1/demand", summary="Ask a driven plant for power")
    async def demand(message: DemandMessage, request: Request, to: Driven = to_plant) -> Response:
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

    @app.get(HEALTH, summary="Whether all is well; needs no token")
    async def health(request: Request) -> Response:
        tells = request.state.holds_token
        return JSONResponse(service.health() | (driven.health(tells) if driven else {}))

    @app.get("/v1/live", summary="What the page shows: plant, demand, strings, and the history of a span")
    async def live_document(span: Literal["2h", "day", "week"] = "day") -> Response:
        shown = live(service, span)
        if driven is not None:
            shown |= {"plant": driven.health(tells=True), "asked_by": driven.source(service)}
        return JSONResponse(shown)

    @app.get("/metrics", summary="Metrics for Prometheus")
    async def metrics() -> Response:
        if driven is not None:
            service.metrics.cycle_age.set(driven.cycle.age_s)
            service.metrics.cycle_period.set(driven.cycle.period_s)
        return Response(service.metrics_text(), media_type="text/plain; version=0.0.4; charset=utf-8")

    @app.get("/", summary="A page that shows the strings live")
    async def page() -> Response:
        return Response(PAGE, headers=PAGE_HEADERS, media_type="text/html")

    @app.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        page, headers = reference_page(app.openapi())
        return Response(page, headers=headers, media_type="text/html")

    return app
