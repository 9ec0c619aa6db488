"""Who may ask, how much, and how often."""

from __future__ import annotations

import hmac
import ipaddress
import time
from collections.abc import Callable
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
        If it cannot be read, or is too short to keep anybody out.
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


def is_allowed(token: str | None, authorization: str | None) -> bool:
    """Whether a header ``Authorization`` carries the token; takes as long whatever it carries."""
    if token is None:
        return True
    given = (authorization or "").encode("utf-8", "replace")
    return hmac.compare_digest(given, f"Bearer {token}".encode())


def check_host(host: str, token: str | None) -> None:
    """Refuse to listen to others than this machine without a token.

    Raises
    ------
    InputError
        With what to do.
    """
    if token is not None or host == "localhost":
        return
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = False
    if not loopback:
        raise InputError(
            f"--host {host}: others than this machine can reach it; give --token-file FILE, or use 127.0.0.1"
        )


class Rate:
    """A bucket that fills at a constant rate: bursts pass, the long run does not exceed it."""

    def __init__(self, per_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._per_s, self._clock = per_s, clock
        self._most = max(1.0, per_s * _BURST_S)
        self._left, self._at_s = self._most, clock()

    def take(self) -> bool:
        """Whether another request passes."""
        now_s = self._clock()
        self._left = min(self._most, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
