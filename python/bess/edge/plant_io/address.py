"""Address of a plant in one text: ``openems=http://10.0.0.5:8084?ess=ess1,ess2``, ``sunspec=10.0.0.5``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl, urlsplit

from bess.errors import InputError

PORTS: Final = {"openems": 8084, "sunspec": 502}
_STRINGS: Final = {"openems": "ess", "sunspec": "unit"}
"""Option that names the strings."""
_EXAMPLES: Final = {"openems": "openems=http://127.0.0.1:8084", "sunspec": "sunspec=127.0.0.1:502"}


@dataclass(frozen=True)
class Address:
    """Address of a plant.

    ``kind`` is ``openems`` or ``sunspec``; ``scheme`` is ``http``, ``https``, or ``tcp`` for Modbus;
    ``strings`` are the plant's names of the strings in their order, or empty to read them from the plant;
    ``meter`` is an OpenEMS meter of all strings.
    """

    kind: str
    scheme: str
    host: str
    port: int
    user: str | None
    password: str | None
    strings: tuple[str, ...]
    meter: str = ""

    @property
    def url(self) -> str:
        """The address for messages, without user and password."""
        return f"{self.scheme}://{socket_name(self.host, self.port)}"

    def __str__(self) -> str:
        return f"{self.kind} at {self.url}"


def socket_name(host: str, port: int) -> str:
    """Host and port as in a URL."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def parse_address(text: str) -> Address:
    """Parse the address of a plant."""
    kind, _, rest = text.partition("=")
    if kind not in PORTS or not rest:
        raise InputError(f"plant {text!r}: expected {' or '.join(_EXAMPLES.values())}")

    def refuse(why: str) -> InputError:
        return InputError(f"plant {_hidden(text)!r}: {why}")

    as_in = f"; write it as in {_EXAMPLES[kind]}"
    schemes = ("http", "https") if kind == "openems" else ("tcp",)
    try:
        parts = urlsplit(rest if "://" in rest else f"{schemes[0]}://{rest}")
        port = parts.port
        (parts.hostname or "").encode("idna")  # as the name server will be asked
    except ValueError as error:
        why = "host and port, or user and password, cannot be read" if "@" in rest else str(error)
        raise refuse(f"{why}{as_in}") from None
    if parts.scheme not in schemes:
        raise refuse(f"{parts.scheme}:// is not among {', '.join(schemes)}{as_in}")
    if kind == "sunspec" and parts.username is not None:
        raise refuse(f"Modbus has no users{as_in}")
    if not parts.hostname or port == 0 or parts.path not in ("", "/") or parts.fragment:
        raise refuse(f"names no host, or something behind it{as_in}")
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    known, meter = _STRINGS[kind], "&meter=M" if kind == "openems" else ""
    strings = tuple(options[known].split(",")) if known in options else ()
    unknown = options.keys() - {known, *(["meter"] if meter else [])}
    if unknown or "" in (*strings, options.get("meter")) or len(set(strings)) < len(strings):
        raise refuse(
            f"behind the question mark only {known}=A,B,...{meter} is allowed, "
            "one name for each string, none twice"
        )
    return Address(
        kind=kind,
        scheme=parts.scheme,
        host=parts.hostname,
        port=port or PORTS[kind],
        user=parts.username,
        password=parts.password,
        strings=strings,
        meter=options.get("meter", ""),
    )


def _hidden(text: str) -> str:
    """Return the text without a password."""
    network, question, options = text.partition("?")
    return re.sub(r"^((?:\w+=)?(?:(?:https?|tcp)://)?[^:@]*).*@", r"\1@", network) + question + options
