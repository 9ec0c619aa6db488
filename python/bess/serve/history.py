"""The last day, thinned out: what the page draws."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np

from bess.numbers import Array
from bess.serve.answer import Answer

SPAN_S: Final = 86_400.0
EVERY_S: Final = 60.0
_DIGITS: Final = 4


class History:
    """Means over a minute each, for one day; what is held in memory has an end."""

    def __init__(self) -> None:
        self._points: deque[dict[str, Any]] = deque(maxlen=round(SPAN_S / EVERY_S))
        self._open: list[tuple[float, Array, Array, Array]] = []
        self._minute = -1

    def add(self, now_s: float, demand_kw: float, answer: Answer, soc: Array, temperature_c: Array) -> None:
        """Take down one step."""
        minute = int(now_s // EVERY_S)
        if minute != self._minute:
            self._close()
            self._minute = minute
        if len(self._open) < 600:
            self._open.append((demand_kw, answer.request_kw, soc, temperature_c))

    def points(self) -> list[dict[str, Any]]:
        """Time [s since 1970], demand [kW]; set-points [kW], SOC, temperature [degC] of each string."""
        made = [*self._points, self._mean()] if self._open else [*self._points]
        return [point for point in made if point["time_s"] > (self._minute * EVERY_S - SPAN_S)]

    def _close(self) -> None:
        if self._open:
            self._points.append(self._mean())
        self._open = []

    def _mean(self) -> dict[str, Any]:
        demand, request, soc, temperature = zip(*self._open, strict=True)
        return {
            "time_s": self._minute * EVERY_S,
            "demand_kw": round(float(np.mean(demand)), _DIGITS),
            "request_kw": np.mean(request, axis=0).round(_DIGITS).tolist(),
            "soc": soc[-1].round(_DIGITS).tolist(),
            "temperature_c": temperature[-1].round(2).tolist(),
        }
