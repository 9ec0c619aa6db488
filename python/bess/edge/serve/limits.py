"""Access control and rate limits of the service."""

from __future__ import annotations

import hmac
import ipaddress
import re
import socket
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bess.errors import InputError

LARGEST_BODY: Final = 64 * 1024
"""Bytes of a request."""
_SHORTEST_TOKEN: Final = 16
_LONGEST_TOKEN: Final = 4096
_BURST_S: Final = 2.0


def read_token(path: Path) -> str:
    """Return the token of a file: its only line.

    Raises
    ------
    InputError
        If it cannot be read, or is too short to be secure.
    """
    try:
        with path.open("rb") as file:
            token = file.read(_LONGEST_TOKEN + 1).decode("ascii").strip()
    except (OSError, ValueError) as error:
        raise InputError(f"--token-file {path}: cannot be read ({error})") from error
    if not _SHORTEST_TOKEN <= len(token) <= _LONGEST_TOKEN or not token.isprintable() or " " in token:
        raise InputError(
            f"--token-file {path}: needs one line of {_SHORTEST_TOKEN} to {_LONGEST_TOKEN} characters "
            "without spaces; openssl rand -hex 32 makes one"
        )
    return token


def is_allowed(token: str, authorization: str | None) -> bool:
    """Whether a header ``Authorization`` carries the token; takes as long whatever it carries."""
    given = (authorization or "").encode("utf-8", "replace")
    return hmac.compare_digest(given, f"Bearer {token}".encode())


def check_token(host: str, token: str | None, drives: bool) -> None:
    """Refuse to drive a plant, or to listen to others than this machine, without a token.

    Raises
    ------
    InputError
        With the option that is missing.
    """
    if token is not None:
        return
    if drives:
        raise InputError(
            "--plant: whoever calls this service moves the plant; give --token-file FILE "
            "(openssl rand -hex 32 makes a token), or only watch with --shadow"
        )
    if not _is_loopback(host):
        raise InputError(
            f"--host {host}: others than this machine can reach it; give --token-file FILE, or use 127.0.0.1"
        )


Authority = tuple[str, str]
"""A host as it is compared (lower case, no trailing dot, addresses in one spelling), and its port or ""."""

_AUTHORITY: Final = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([0-9A-Za-z._-]+))(?::([0-9]{1,5}))?")
_LOOPBACK: Final = ("localhost", "127.0.0.1", "::1")
_OWN_PAGES: Final = {"same-origin", "none"}


@dataclass(frozen=True)
class Names:
    """Names under which a service may be called, against pages of others in the browser of an operator.

    A page can be made "same origin" by a name that its owner points here for a moment (DNS rebinding), so
    ``Host`` must be a name of the service. An address in digits cannot be pointed elsewhere.

    Attributes
    ----------
    own : frozenset of str
        Names that ``Host`` may hold.
    proxies : frozenset of Authority
        What pages of the service itself are reached under besides ``Host``, behind a proxy.
    any_address : bool
        Whether ``Host`` may be any address in digits: the machine has several, seen from outside.
    """

    own: frozenset[str]
    proxies: frozenset[Authority]
    any_address: bool

    @classmethod
    def of(cls, host: str, allowed: Iterable[str] = ()) -> Names:
        """Names of a service that listens on ``host``, and those that were allowed besides.

        Raises
        ------
        InputError
            For an allowed name that is none.
        """
        given = {text: _authority(text) for text in allowed}
        for text, authority in given.items():
            if authority is None:
                raise InputError(f"--allowed-host {text}: needs NAME or NAME:PORT, such as plant.example")
        proxies = frozenset(authority for authority in given.values() if authority is not None)
        far = not _is_loopback(host)
        machine = (host, socket.gethostname()) if far else (host,)
        own = {_spelled(name) for name in (*_LOOPBACK, *machine)} | {name for name, _ in proxies}
        return cls(frozenset(own), proxies, far)

    def answers(self, host: str | None) -> bool:
        """Whether a header ``Host`` holds a name of the service; any port, for tunnels change it."""
        authority = _authority(host or "")
        if authority is None:
            return False
        return authority[0] in self.own or (self.any_address and _address(authority[0]) is not None)

    def is_own_page(self, host: str | None, origins: Iterable[str], sites: Iterable[str]) -> bool:
        """Whether a request is of a page of the service or of none: ``Origin``, ``Sec-Fetch-Site``."""
        here = {_authority(host or ""), *self.proxies} - {None}
        pages = {_authority(origin.partition("://")[2]) for origin in origins}
        return pages <= here and _OWN_PAGES.issuperset(sites)


def _authority(text: str) -> Authority | None:
    """A name and a port; None if the text is neither."""
    found = _AUTHORITY.fullmatch(text)
    if found is None:
        return None
    name, port = _spelled(found[1] or found[2]), found[3] or ""
    return name, "" if port in ("80", "443") else port


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _spelled(name: str) -> str:
    """A name as it is compared."""
    return str(_address(name) or name.lower().removesuffix("."))


def _is_loopback(host: str) -> bool:
    address = _address(host)
    return host == "localhost" if address is None else address.is_loopback


LOCAL: Final = Names.of("127.0.0.1")
"""Names of a service that this machine alone can reach."""


class Rate:
    """A bucket that fills at a constant rate: bursts pass, the long run does not exceed it."""

    def __init__(self, per_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.per_s, self._clock = per_s, clock
        self._most = max(1.0, per_s * _BURST_S)
        self._left, self._at_s = self._most, clock()

    def take(self) -> bool:
        """Whether another request passes."""
        now_s = self._clock()
        self._left = min(self._most, self._left + (now_s - self._at_s) * self.per_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
