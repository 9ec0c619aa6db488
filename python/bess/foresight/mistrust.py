"""How far what was foreseen came true."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bess.numbers import Array

MEMORY_H = 24.0
"""Time over which errors of the forecast are averaged, and in which unforeseen limits are forgotten."""


class Mistrust:
    """Compares demand and limits of each step with what the call before foresaw (docs/foresight.md).

    Parameters
    ----------
    nominal_kw : ndarray, shape (n_strings,)
        Nominal power of the inverters.
    dt_h : float
        Length of a step [h].

    Attributes
    ----------
    limit_kw : ndarray, shape (n_strings,), or None
        Limits of the last call; None before the first.
    """

    def __init__(self, nominal_kw: Array, dt_h: float) -> None:
        self.limit_kw: Array | None = None
        self._nominal_kw = nominal_kw
        self._new = min(1.0, dt_h / MEMORY_H)
        self._foreseen_kw: float | None = None
        self._error_kw = self._level_kw = self._surprise = 0.0

    @property
    def share(self) -> float:
        """How little what is foreseen is to be trusted, from 0 to 1.

        Relative error of the forecasts of the next step, and share of the inverters' power that was lost or
        found again unforeseen, of the last day or so.
        """
        error = self._error_kw / self._level_kw if self._level_kw > 0.0 else 0.0
        return min(error + self._surprise, 1.0)

    def compare(self, demand_kw: Array, limit_kw: Array | None = None) -> bool:
        """Take note of a step: demand [kW] of it and of those ahead, and its limits where they are known.

        Returns
        -------
        bool
            Whether the limits are other than they were.
        """
        known = self.limit_kw if limit_kw is None else limit_kw
        # What is above the inverters in service was never going to be shared.
        most_kw = float((self._nominal_kw if known is None else known).sum())
        now = min(max(float(demand_kw[0]), -most_kw), most_kw)
        if self._foreseen_kw is not None:
            foreseen = min(max(self._foreseen_kw, -most_kw), most_kw)
            self._error_kw += self._new * (abs(now - foreseen) - self._error_kw)
            self._level_kw += self._new * (abs(now) - self._level_kw)
        self._foreseen_kw = float(demand_kw[1]) if demand_kw.size > 1 else None
        self._surprise *= 1.0 - self._new
        changed = False
        if known is not None and self.limit_kw is not None:
            change_kw = float(np.abs(known - self.limit_kw).sum())
            self._surprise += change_kw / float(self._nominal_kw.sum())
            changed = change_kw > 0.0
        self.limit_kw = known
        return changed

    def memory(self) -> dict[str, Any]:
        """What the next comparison depends on."""
        return {
            "limit_kw": self.limit_kw,
            "foreseen_kw": self._foreseen_kw,
            "error_kw": self._error_kw,
            "level_kw": self._level_kw,
            "surprise": self._surprise,
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
        self.limit_kw, self._foreseen_kw = memory["limit_kw"], memory["foreseen_kw"]
        self._error_kw, self._level_kw = float(memory["error_kw"]), float(memory["level_kw"])
        self._surprise = float(memory["surprise"])
