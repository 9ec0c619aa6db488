"""Connections of the service: callers that are silent or slow are cut off, so that others are served."""

from __future__ import annotations

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S: Final = 10.0
"""Time in which the head of a request must be complete."""
KEEP_ALIVE_S: Final = 30
"""Time that a connection may rest between two requests."""
OF_A_PEER: Final = 256
"""Connections of strangers from one address; one more ends the oldest of them."""
IN_ALL: Final = 512
"""Connections of strangers from all addresses."""
BACKLOG: Final = 64
"""Connections that are taken at once: so few that what each has sent is read before its turn to end."""


class Connection(H11Protocol):
    """One connection, a stranger's until a request on it has been let in.

    The application finds it in ``request.state.connection``.
    """

    def __init__(self, config: Any, server_state: Any, app_state: Any, _loop: Any = None) -> None:
        super().__init__(config, server_state, {**app_state, "connection": self}, _loop)
        self._is_stranger = True
        self._serves = False
        self._late: asyncio.TimerHandle | None = None

    def welcome(self) -> None:
        """Take note that the request may pass."""
        self._is_stranger, self._serves = False, True
        self._stop_waiting()

    def connection_made(self, transport: Any) -> None:
        """Wait for a request; end the oldest connection of a stranger where there are too many."""
        super().connection_made(transport)
        self._made_s = self.loop.time()
        self._wait()
        strangers = [one for one in self.connections if isinstance(one, Connection) and one._is_stranger]
        for those, most in (
            ([one for one in strangers if one._peer == self._peer], OF_A_PEER),
            (strangers, IN_ALL),
        ):
            if len(those) > most:
                oldest = min(those, key=lambda one: one._made_s)
                self.connections.discard(oldest)
                oldest.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Read on, for no longer than the head of a request may take."""
        if not self._serves and self._late is None:
            self._wait()
        super().data_received(data)

    def on_response_complete(self) -> None:
        """Rest until the next request."""
        self._serves = False
        self._stop_waiting()
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self._stop_waiting()
        super().connection_lost(exc)

    @property
    def _peer(self) -> str:
        return self.client[0] if self.client else ""

    def _wait(self) -> None:
        self._late = self.loop.call_later(HEAD_S, self.transport.abort)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None
