"""What goes out for one control step, and what all of it adds up to."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from bess.arrays import Array, Flags
from bess.edge.serve.persistent import Persistent


@dataclass(frozen=True)
class Answer:
    """Set-points for one control step; powers kW, positive = discharge.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings,)
        Set-points; their sum, that of ``flowing_kw`` and ``unmet_kw`` are the demand.
    plan_kw : ndarray, shape (n_strings, n_steps)
        The set-points, then those of the plan for the next steps of the forecast.
    status : str
        A sentence.
    gap : float or None
        Relative distance to a proven bound, where these are the set-points of a certified split, or the first
        of a plan that has one; else None: for other plans, between two plans, and for the fallback.
    fallback : bool
        Whether these are the shares by energy, because the controller had no answer in time.
    unmet_kw : float
        Magnitude of what the set-points fall short of the demand (or, where a ramp holds them up, exceed it).
    valid_for_s : float
        How long they hold.
    solve_time_s : float
        What it took.
    running : ndarray of bool, shape (n_strings,)
        Inverters that run, idle ones included.
    in_service : ndarray of bool, shape (n_strings,)
        Strings that could run.
    flowing_kw : ndarray, shape (n_strings,)
        Power that strings out of service still give, as far as is known; the set-points make up for it.
    reasons : tuple of str
        For each string, why it does what it does.
    """

    request_kw: Array
    plan_kw: Array
    status: str
    gap: float | None
    fallback: bool
    unmet_kw: float
    valid_for_s: float
    solve_time_s: float
    running: Flags
    in_service: Flags
    flowing_kw: Array
    reasons: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """The JSON of ``POST /v1/split``."""
        entries = {name: getattr(self, name) for name in (entry.name for entry in fields(self))}
        entries["solve_time_s"] = round(self.solve_time_s, 6)
        return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in entries.items()}


def unmet(demand_kw: float, request_kw: Array) -> float:
    """Magnitude of what set-points are off the demand [kW]; 0 where that is rounding."""
    off_kw = abs(demand_kw - float(request_kw.sum()))
    return 0.0 if off_kw <= 1e-9 * max(1.0, abs(demand_kw)) else off_kw


class Counters(Persistent):
    """What a service has done since its state began.

    Attributes
    ----------
    answers, fallbacks : int
        Given, and how many of them were shared by the energy left.
    unmet_kwh : float
        Demand that no set-point met.
    charged_kwh, discharged_kwh : ndarray, shape (n_strings,)
        Energy that was asked of each string, ``>= 0``.
    """

    kept = ("answers", "fallbacks", "unmet_kwh", "charged_kwh", "discharged_kwh")

    def __init__(self, n_strings: int) -> None:
        self.answers = self.fallbacks = 0
        self.unmet_kwh = 0.0
        self.charged_kwh: Array = np.zeros(n_strings)
        self.discharged_kwh: Array = np.zeros(n_strings)

    def carry(self, request_kw: Array, held_s: float) -> None:
        """Count the energy of set-points that held for so long."""
        hours = held_s / 3600.0
        self.charged_kwh = self.charged_kwh + np.maximum(-request_kw, 0.0) * hours
        self.discharged_kwh = self.discharged_kwh + np.maximum(request_kw, 0.0) * hours
