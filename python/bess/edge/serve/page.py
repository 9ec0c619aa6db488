"""The two pages: strings live, and the reference of the routes. Nothing in them comes from elsewhere."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from importlib import resources
from typing import Any, Final


def _hash(text: str) -> str:
    return "'sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() + "'"


def _headers(page: str) -> dict[str, str]:
    """Only what stands in the page itself may run, by its hash; data come from this service alone."""
    parts = {
        kind: " ".join(_hash(text) for text in re.findall(rf"<{kind}>(.*?)</{kind}>", page, re.DOTALL))
        for kind in ("script", "style")
    }
    return {
        "Content-Security-Policy": (
            f"default-src 'none'; script-src {parts['script'] or chr(39) + 'none' + chr(39)}; "
            f"style-src {parts['style']}; connect-src 'self'; base-uri 'none'; form-action 'none'; "
            "frame-ancestors 'none'"
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
Every route but /v1/health asks for <code>Authorization: Bearer TOKEN</code> if the service was started with a
token. Bad values are answered
with status 422 and one sentence in <code>detail</code>. The same for machines:
<a href="openapi.json">openapi.json</a>.</p>
{routes}</body></html>
"""


def reference_page(schema: dict[str, Any]) -> tuple[str, dict[str, str]]:
    """Return the page on the routes of an OpenAPI document, and its headers."""
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
