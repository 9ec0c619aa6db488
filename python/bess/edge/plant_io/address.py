"""Where a plant is, as one text: ``openems=http://10.0.0.5:8084?ess=ess1,ess2``, ``sunspec=10.0.0.5``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import SplitResult, parse_qsl, urlsplit

from bess.errors import InputError

_STRINGS: Final = {"openems": "ess", "sunspec": "unit"}
"""Option behind the question mark that names the strings, for each kind of plant."""
PORTS: Final = {"openems": 8084, "sunspec": 502}


@dataclass(frozen=True)
class Address:
    """Where a plant is.

    Parameters
    ----------
    kind
        ``openems`` or ``sunspec``.
    scheme
        ``http``, ``https``, or ``tcp`` for Modbus.
    host, port
        Of the plant.
    user, password
        None where the text names none.
    strings
        What the plant calls the strings, in their order; empty to ask the plant.
    meter
        What an OpenEMS edge calls the meter of all strings; empty if there is none.
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
        """The address without user and password, fit for messages."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def parse_address(text: str) -> Address:
    """Take a plant's address apart.

    Raises
    ------
    InputError
        For a kind, a scheme, a port or an option that there is not.
    """
    kind, equals, rest = text.partition("=")
    if not equals or kind not in _STRINGS or not rest:
        raise InputError(f"plant {text!r}: expected {' or '.join(_EXAMPLES)}")
    schemes = ("http", "https") if kind == "openems" else ("tcp",)
    whole = rest if "://" in rest else f"{schemes[0]}://{rest}"
    try:
        parts = urlsplit(whole)
        port = parts.port
    except ValueError as error:
        raise InputError(f"plant {_hidden(text)!r}: {error}; write it as in {_example(kind)}") from None
    if parts.scheme not in schemes:
        raise InputError(
            f"plant {_hidden(text)!r}: {parts.scheme}:// is not among {', '.join(schemes)}; "
            f"write it as in {_example(kind)}"
        )
    if not parts.hostname or port == 0 or parts.path not in ("", "/") or parts.fragment:
        raise InputError(
            f"plant {_hidden(text)!r}: names no host, or something behind it; write it as in {_example(kind)}"
        )
    strings, meter = _options(kind, text, parts)
    return Address(
        kind=kind,
        scheme=parts.scheme,
        host=parts.hostname,
        port=port or PORTS[kind],
        user=parts.username,
        password=parts.password,
        strings=strings,
        meter=meter,
    )


_EXAMPLES: Final = ("openems=http://127.0.0.1:8084", "sunspec=127.0.0.1:502")


def _example(kind: str) -> str:
    return next(example for example in _EXAMPLES if example.startswith(kind))


def _options(kind: str, text: str, parts: SplitResult) -> tuple[tuple[str, ...], str]:
    """Names of the strings, and of the meter."""
    options: Mapping[str, str] = dict(parse_qsl(parts.query, keep_blank_values=True))
    known = _STRINGS[kind]
    meter = "&meter=M" if kind == "openems" else ""
    unknown = options.keys() - {known, *(["meter"] if meter else [])}
    names = tuple(options[known].split(",")) if known in options else ()
    if unknown or "" in (*names, options.get("meter")) or len(set(names)) < len(names):
        raise InputError(
            f"plant {_hidden(text)!r}: behind the question mark only {known}=A,B,...{meter} is allowed, "
            f"one name for each string, none twice"
        )
    return names, options.get("meter", "")


def _hidden(text: str) -> str:
    """Return the text without a password."""
    network, question, options = text.partition("?")
    before, at, after = network.rpartition("@")
    head, slashes, user = before.rpartition("//")
    return f"{head}{slashes}{user.partition(':')[0]}@{after}{question}{options}" if at else text
