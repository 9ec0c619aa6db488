"""The live page with its document, and the reference page of the routes, without external resources."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Sequence
from importlib import resources
from itertools import chain, zip_longest
from typing import Any, Final

import numpy as np

from bess.arrays import Flags
from bess.edge.serve.service import Service


def _headers(page: str) -> dict[str, str]:
    """Content security policy: only scripts of the page run (by hash), with data from this service only."""

    def sources(kind: str) -> str:
        texts = re.findall(rf"<{kind}>(.*?)</{kind}>", page, re.DOTALL)
        digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts)
        return " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'"

    return {
        "Content-Security-Policy": (
            f"default-src 'none'; script-src {sources('script')}; style-src {sources('style')}; "
            "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
    }


PAGE: Final = (resources.files("bess.edge.serve") / "page.html").read_text("utf-8")
PAGE_HEADERS: Final = _headers(PAGE)

_REFERENCE: Final = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>bess serve: routes</title>
<style>body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 900px; margin: 0 auto; padding: 16px; }}
pre {{ background: #8881; padding: 10px; overflow: auto; font-size: 13px; }}
code {{ font-size: 14px; }}</style>
</head><body><h1>Routes of bess serve</h1>
<p>JSON over HTTP, sent as <code>Content-Type: application/json</code>; powers in kW, positive = discharge.
If the service was started with a token, every route except /v1/health requires
<code>Authorization: Bearer TOKEN</code>. Invalid values return status 422 and one sentence in
<code>detail</code>. Machine-readable: <a href="openapi.json">openapi.json</a>.</p>
{routes}</body></html>
"""


def reference_page(schema: dict[str, Any]) -> tuple[str, dict[str, str]]:
    """Return the reference page of an OpenAPI document, and its headers."""
    blocks = []
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            blocks.append(f"<h2><code>{method.upper()} {html.escape(path)}</code></h2>")
            blocks.append(f"<p>{html.escape(operation.get('summary', ''))}</p>")
            body = operation.get("requestBody")
            if body:
                name = body["content"]["application/json"]["schema"]["$ref"].rpartition("/")[2]
                text = json.dumps(schema["components"]["schemas"][name], indent=1, ensure_ascii=False)
                blocks.append(f"<pre>{html.escape(text)}</pre>")
    page = _REFERENCE.format(routes="\n".join(blocks))
    return page, _headers(page)


_SHOWN: Final = (
    "request_kw", "unmet_kw", "status", "fallback", "flowing_kw", "running", "in_service", "reasons",
)  # fmt: skip
"""Entries of an answer on the live page."""
_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")


def live(service: Service, span: str) -> dict[str, Any]:
    """Plant, demand and strings of the last answer, and the history of one of :data:`.monitoring.SPANS`."""
    controller, calibration = service.controller, service.controller.calibration
    planned, due_s = calibration.planned, calibration.due_s()
    errors = (service.memory.error, controller.plan.making.error, calibration.search.error)
    return {
        "study": service.name,
        "time_s": service.clock(),
        "n_strings": controller.n_strings,
        "nominal_kw": controller.system.nominal_kw.tolist(),
        "derating_c": min(string.derating.start_c for string in controller.system.strings),
        "starts": controller.commitment.starts.tolist(),
        "answers": controller.answers,
        "fallbacks": controller.fallbacks,
        "notes": [note for note in (*service.notes, *errors) if note],
        "calibration": {
            "string": calibration.string,
            "next": None if planned is None else vars(planned),
            "due_s": None if due_s is None or np.isnan(due_s).any() else due_s.tolist(),
        },
        "history": service.history.document(span),
        "status": "no demand yet" if service.last is None else service.last[2].status,
        "last": _last(service),
    }


def _last(service: Service) -> dict[str, Any] | None:
    """The last answer, capability of the strings and demand ahead; None before the first one."""
    controller, valid, plan = service.controller, service.controller.valid, service.controller.plan
    if service.last is None or valid is None:
        return None
    at_s, request, answer = service.last
    in_service, state = answer.in_service, valid.state

    def left_kwh(discharge: bool) -> float:
        each_kwh = controller.soc_limits.left_kwh(valid.worse(discharge).soc, valid.energy_kwh, discharge)
        return float(each_kwh[in_service].sum())

    said = answer.document()
    return {
        **{name: said[name] for name in _SHOWN},
        "time_s": at_s,
        "demand_kw": request.demand.now_kw,
        "measured_kw": None if np.isnan(request.measured_kw) else request.measured_kw,
        "because": grouped(answer.reasons, in_service),
        "soc": state.soc.tolist(),
        "temperature_c": state.temperature_c.tolist(),
        "plant_soc": float(np.average(state.soc, weights=valid.energy_kwh)),
        "discharge_kwh": left_kwh(True),
        "charge_kwh": left_kwh(False),
        "discharge_kw": float(controller.able.discharge_kw.sum()),
        "charge_kw": float(controller.able.charge_kw.sum()),
        "ahead_kw": controller.ahead_kw.tolist(),
        "ahead_step_s": plan.step_s,
        "ahead_start_s": plan.slot(at_s) * plan.step_s,
        "ahead_told": request.demand.forecast_kw is not None,
        "gap": None if plan.current is None else plan.current.gap,
    }


def grouped(sentences: Sequence[str], in_service: Flags) -> list[dict[str, Any]]:
    """Group strings by reason: strings out of service first, then the rarest reason.

    A group has its ``text``, with the range of a number that differs, its ``strings``, and ``in_service``.
    """
    groups: dict[tuple[str, ...], dict[int, list[str]]] = {}
    for i, sentence in enumerate(sentences):
        text = sentence.removeprefix(f"string {i} ")
        groups.setdefault(tuple(_NUMBER.split(text)), {})[i] = _NUMBER.findall(text)
    found = []
    for words, numbers in groups.items():
        ranges = map(_range, zip(*numbers.values(), strict=True))
        text = "".join(chain(*zip_longest(words, ranges, fillvalue="")))
        strings = list(numbers)
        found.append({"text": text, "strings": strings, "in_service": bool(in_service[strings].any())})
    return sorted(found, key=lambda group: (group["in_service"], len(group["strings"])))


def _range(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"
