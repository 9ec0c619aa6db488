"""What was, thinned out, for the page: two hours, a day and a week, each at a step of its own."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np

from bess.arrays import Array

SPANS: Final = {"2h": (60.0, 120), "day": (300.0, 288), "week": (1800.0, 336)}
"""Of each span: length of a step [s], and how many are kept."""
QUANTILES: Final = (0.0, 0.1, 0.5, 0.9, 1.0)
MOST_LINES: Final = 8
"""Plants of up to so many strings are kept string by string; larger ones by the quantiles alone."""
_PLANT: Final = ("time_s", "demand_kw", "request_kw", "measured_kw", "foreseen_kw", "starts", "hottest_c")
_DIGITS: Final = 4


class History:
    """Means over the steps of each span; what is held in memory has an end."""

    def __init__(self) -> None:
        self._spans = {name: _Span(every_s, most) for name, (every_s, most) in SPANS.items()}
        self._began_s = self._now_s = np.nan

    def add(self, plant: dict[str, float], soc: Array, request_kw: Array) -> None:
        """Take down one control step: values of the plant (NaN where unknown), SOC and set-points [kW]."""
        each = (soc, request_kw) if soc.size <= MOST_LINES else ()
        self._now_s = plant["time_s"]
        self._began_s = self._now_s if np.isnan(self._began_s) else self._began_s
        row = np.concatenate([[plant[name] for name in _PLANT], np.quantile(soc, QUANTILES), *each])
        for span in self._spans.values():
            span.add(row)

    def document(self, name: str) -> dict[str, Any]:
        """Columns of a span: those of the plant, ``soc`` (quantiles), and of each string of a small plant.

        As long as a shorter span holds all that was, its finer steps stand in.
        """
        age_s = self._now_s - self._began_s
        finest = next((finer for finer, (every_s, most) in SPANS.items() if age_s < every_s * most), name)
        span = self._spans[min(finest, name, key=list(SPANS).index)]
        columns = [[None if np.isnan(v) else round(v, _DIGITS) for v in column] for column in span.columns()]
        known, rest = dict(zip(_PLANT, columns, strict=False)), columns[len(_PLANT) :]
        n = (len(rest) - len(QUANTILES)) // 2
        soc, each = rest[: len(QUANTILES)], rest[len(QUANTILES) :]
        return {"every_s": span.every_s, **known, "soc": soc, "string_soc": each[:n], "string_kw": each[n:]}


class _Span:
    """Rows of one span, the first value of each its time; read from one thread, written from another."""

    def __init__(self, every_s: float, most: int) -> None:
        self.every_s, self._most = every_s, most
        self._rows: deque[Array] = deque(maxlen=most)
        # Of the step that goes on: its number, sums of the values that are known, how many these are.
        self._open: tuple[int, Array, Array] | None = None

    def add(self, row: Array) -> None:
        step = int(row[0] // self.every_s)
        known, values = np.isfinite(row).astype(np.float64), np.nan_to_num(row)
        if self._open is not None and self._open[0] == step:
            known, values = known + self._open[2], values + self._open[1]
        elif self._open is not None:
            self._rows.append(_mean(*self._open[1:]))
        self._open = (step, values, known)

    def columns(self) -> list[list[float]]:
        if (going_on := self._open) is None:
            return [[] for _ in (*_PLANT, *QUANTILES)]
        rows = [*self._rows, _mean(*going_on[1:])]
        first_s = rows[-1][0] - self._most * self.every_s
        kept: list[list[float]] = np.transpose([row for row in rows if row[0] > first_s]).tolist()
        return kept


def _mean(total: Array, count: Array) -> Array:
    return np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan)
