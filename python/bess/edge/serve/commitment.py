"""Commitment of inverters, from one control step to the next.

An inverter is switched when the energy that the switching would have saved reaches the cost of a start: the
ski-rental rule [1]_, with savings accumulated by CUSUM [2]_. The commitment is therefore never much worse
than the best one in hindsight, and noise in the demand starts no inverter. Only a demand above the capability
of the running inverters starts another one immediately.

References
----------
.. [1] Karlin, A., Manasse, M., Rudolph, L., Sleator, D.: Competitive snoopy caching. Algorithmica 3 (1988).
.. [2] Page, E. S.: Continuous inspection schemes. Biometrika 41 (1954).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array, Flags
from bess.checkpoints import Checkpointed
from bess.control.objectives import SHORTFALL
from bess.edge.serve.constraints import POWER_TOLERANCE_KW
from bess.study.sections import ServiceSection
from bess.system import State, System

ROTATION: Final = 0.02
"""Additional cost of a start for each start of the string above the smallest number of a string."""
_MIN_CURVATURE: Final = 1e-7
_NO_LOAD: Final = 1e-3  # of a third: small, and above the minimum power of an inverter
_EDGE: Final = 0.02
_STEP_H: Final = 10.0 / 3600.0
_NO_LIMIT_S: Final = 1e9


@dataclass(frozen=True)
class Curves:
    """Loss of each string over its power in one direction, ``idle + slope p + bend p^2`` [kW].

    A parabola through three points of the control model: no load, and a third and two thirds of the maximum
    power by voltage, near which the loss rises faster than a parabola. Derating loss counts ``SHORTFALL``
    times.
    """

    idle_kw: Array
    slope: Array
    bend: Array

    @classmethod
    def of(cls, system: System, state: State, discharge: bool) -> Curves:
        """Curves in a measured state."""
        low, high = system.soc_window
        soc, model = np.clip(state.soc, low + _EDGE, high - _EDGE), system.control_at(state)
        able = model.deliverable_kw(soc, state.temperature_c, discharge, _STEP_H)
        third = np.clip(able, 0.01 * system.nominal_kw, system.nominal_kw) / 3.0
        levels = np.stack([_NO_LOAD * third, third, 2.0 * third])[:, :, None]
        flows = model.rollout(
            soc,
            state.temperature_c,
            np.ascontiguousarray(levels if discharge else -levels),
            np.array([system.reference_temperature_c]),
            _STEP_H,
        )
        loss = flows.inverter_loss_kw + flows.battery_loss_kw
        loss = loss + SHORTFALL * (flows.derating_loss_kw + flows.availability_loss_kw)
        idle, first, second = loss[:, :, 0]
        bend = np.maximum((second - 2.0 * first + idle) / (2.0 * third**2), _MIN_CURVATURE)
        return cls(idle, np.maximum((first - idle) / third - bend * third, 0.0), bend)

    def marginal(self, power_kw: Array) -> Array:
        """Marginal loss [kW/kW]."""
        return self.slope + 2.0 * self.bend * power_kw


@dataclass(frozen=True)
class CommitmentProblem:
    """A demand in one direction (magnitude), with capability and losses of the ``usable`` strings in it.

    ``price`` is the cost of a kW of each string in addition to its loss [kW/kW], from the plan.
    """

    demand_kw: float
    max_kw: Array
    usable: Flags
    curves: Curves
    price: Array

    def best_shares(self, sets: Flags) -> Array:
        """Powers at equal marginal cost within sets ``(n_sets, n_strings)`` or one set ``(n_strings,)``."""
        within, most = np.atleast_2d(sets), self.max_kw
        slope, twice = self.curves.slope + self.price, 2.0 * self.curves.bend
        # A set's power is piecewise linear in the marginal cost, with knots where a string begins or is full.
        knots = np.sort(np.concatenate([slope, slope + twice * most]))
        given = np.minimum(np.maximum((knots[:, None] - slope) / twice, 0.0), most) @ within.T
        asked = np.minimum(self.demand_kw, given[-1])
        after = np.clip((given < asked).sum(axis=0), 1, knots.size - 1)
        column = np.arange(len(within))
        low, high = given[after - 1, column], given[after, column]
        part = (asked - low) / np.maximum(high - low, POWER_TOLERANCE_KW)
        cost = knots[after - 1] + part * (knots[after] - knots[after - 1])
        shares = np.minimum(np.maximum((cost[:, None] - slope) / twice, 0.0), most) * within
        return np.asarray(shares.reshape(sets.shape))

    def cost_kw(self, sets: Flags) -> Array:
        """Cost of the best shares of each set, shape ``(n_sets,)``."""
        shares, curves = self.best_shares(sets), self.curves
        costs = curves.idle_kw * sets + (curves.slope + self.price) * shares + curves.bend * shares**2
        return np.asarray(costs.sum(axis=1))


class Commitment(Checkpointed):
    """Running inverters, the time since their last switching, and their starts.

    ``start_kwh`` of ``service`` is the cost of a start; ``minimum_on_s`` and ``minimum_off_s`` do not delay
    the stop of a string that goes out of service.
    """

    _carried = ("running", "since_s", "starts", "_saved_kwh", "_peaks")

    def __init__(self, n_strings: int, service: ServiceSection) -> None:
        self._service = service
        self.running: Flags = np.zeros(n_strings, dtype=bool)
        self.since_s: Array = np.full(n_strings, _NO_LIMIT_S)
        self.starts: NDArray[np.int64] = np.zeros(n_strings, dtype=np.int64)
        # Accumulated saving of each exchange of a string (row) for another (column); the last means no
        # string.
        self._saved_kwh: Array = np.zeros((n_strings + 1, n_strings + 1))
        # Age [s] and magnitude [kW] of demands above all later ones, within the minimum off time.
        self._peaks: list[tuple[float, float]] = []

    def update(self, problem: CommitmentProblem, *, elapsed_s: float, step_s: float) -> None:
        """Decide for a step of ``step_s``, ``elapsed_s`` after the last decision."""
        self.advance_time(problem.usable, problem.demand_kw, elapsed_s)
        for k in range(2 * self.running.size):
            move = self._move(problem, step_s, adds_up=k == 0)
            if move is None:
                break
            stop, start = (np.arange(self.running.size) == string for string in move)
            self._saved_kwh[:] = 0.0
            self._switch(stop, on=False)
            self._switch(start, on=True)

    def advance_time(self, usable: Flags, demand_kw: float, elapsed_s: float) -> None:
        """Advance to the present demand (magnitude); stop strings that are no longer usable."""
        self.since_s = self.since_s + elapsed_s
        kept = [(age + elapsed_s, peak) for age, peak in self._peaks if peak > demand_kw]
        self._peaks = [(age, peak) for age, peak in kept if age <= self._service.minimum_off_s]
        self._peaks.append((0.0, demand_kw))
        self._switch(self.running & ~usable, on=False)

    def set_commitment(self, wanted: Flags, usable: Flags) -> None:
        """Switch to the wanted inverters, within minimum on and off times."""
        self._switch(self._stoppable() & ~wanted, on=False)
        self._switch(self._startable(usable) & wanted, on=True)
        self._saved_kwh[:] = 0.0

    def _stoppable(self) -> Flags:
        return self.running & (self.since_s >= self._service.minimum_on_s)

    def _startable(self, usable: Flags) -> Flags:
        return ~self.running & usable & (self.since_s >= self._service.minimum_off_s)

    def _switch(self, which: Flags, *, on: bool) -> None:
        if which.any():
            self.running = np.where(which, on, self.running)
            self.since_s = np.where(which, 0.0, self.since_s)
            self.starts = self.starts + (which if on else 0)

    def _move(self, problem: CommitmentProblem, step_s: float, *, adds_up: bool) -> tuple[int, int] | None:
        """Next switching with a net saving: the string that stops, the string that starts, as candidates."""
        n = self.running.size
        from_, to = self._candidates(problem.usable)
        if not from_.size:
            return None
        # Sets of running strings: the present one, then each candidate; the last column means no string.
        sets = np.tile(np.append(self.running, False), (from_.size + 1, 1))
        index = np.arange(1, from_.size + 1)
        sets[index, from_] = False
        sets[index, to] = True
        sets = sets[:, :n]
        loss = problem.cost_kw(sets)
        can = (problem.max_kw * sets).sum(axis=1)
        short = np.maximum(problem.demand_kw - can, 0.0)
        extra = np.append(self._start_worth_kwh(), 0.0)
        if short[0] > POWER_TOLERANCE_KW and (short[1:] < short[0] - POWER_TOLERANCE_KW).any():
            # The capability is too small: the cheapest string starts now, its start cost spread over an hour.
            cost = loss[1:] + SHORTFALL * 100.0 * short[1:] + extra[to]
            cost[from_ != n] = np.inf
            if np.isfinite(cost).any():
                return n, int(to[np.argmin(cost)])
        peak = max(p for _, p in self._peaks)
        allowed = can[1:] >= min(peak, can[0]) - POWER_TOLERANCE_KW
        saving = np.where(allowed, (loss[0] + SHORTFALL * short[0]) - (loss[1:] + SHORTFALL * short[1:]), 0.0)
        before = self._saved_kwh[from_, to] if adds_up else 0.0
        saved = np.maximum(before + saving * step_s / 3600.0, 0.0)
        # A stop costs a later start.
        worth = np.where(to < n, extra[to], extra[from_])
        gain = np.where(allowed & (saving > 0.0), saved - worth, -np.inf)
        best = int(np.argmax(gain))
        if gain[best] > 0.0:
            return int(from_[best]), int(to[best])
        if adds_up:
            self._saved_kwh[:] = 0.0
            self._saved_kwh[from_, to] = saved
        return None

    def _candidates(self, usable: Flags) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Strings that may stop, and strings that may start instead; ``n_strings`` means no string."""
        n = self.running.size
        stop, start = np.flatnonzero(self._stoppable()), np.flatnonzero(self._startable(usable))
        from_, to = (a.ravel() for a in np.meshgrid([*stop, n], [*start, n], indexing="ij"))
        moves = (from_ < n) | (to < n)
        return from_[moves], to[moves]

    def _start_worth_kwh(self) -> Array:
        """Cost of a start, smallest for the string with the fewest starts."""
        above = np.minimum(self.starts - self.starts.min(), 40)
        return np.asarray((self._service.start_kwh + 1e-9) * (1.0 + ROTATION * above))
