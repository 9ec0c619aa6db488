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
EXCHANGED: Final = 16
"""Strings in each role of an exchange, of those whose stop or start alone is the cheapest."""
CHOSEN: Final = 8
"""Strings that start one after the other if more are needed at once."""

Indices = NDArray[np.int64]


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

    def best_shares(self, running: Flags) -> Array:
        """Powers of the running strings at equal marginal cost."""
        knots, given = self._given()
        return np.asarray(self._shares(running[None], knots, (given @ running)[:, None])[0])

    def after(self, running: Flags, from_: Indices, to: Indices) -> tuple[Array, Array]:
        """Cost and capability [kW] of the running strings after each move; the number of strings means none.

        Undelivered power costs ``SHORTFALL`` times.
        """
        sets = np.tile(np.append(running, False), (from_.size, 1))
        index = np.arange(from_.size)
        sets[index, from_] = False
        sets[index, to] = True
        sets = sets[:, :-1]
        # A move changes one or two strings: no sum over all strings of a large plant for each.
        knots, given = self._given()
        given, total = np.pad(given, ((0, 0), (0, 1))), given @ running
        shares = self._shares(sets, knots, total[:, None] - given[:, from_] + given[:, to])
        curves = self.curves
        costs = curves.idle_kw * sets + (curves.slope + self.price) * shares + curves.bend * shares**2
        can = sets @ self.max_kw
        return costs.sum(axis=1) + SHORTFALL * np.maximum(self.demand_kw - can, 0.0), can

    def _given(self) -> tuple[Array, Array]:
        """Marginal costs where a string begins or is full, and the power of each string (column) at them.

        Between these knots, the power of a set is linear in the marginal cost.
        """
        slope = self.curves.slope + self.price
        knots = np.sort(np.concatenate([slope, slope + 2.0 * self.curves.bend * self.max_kw]))
        return knots, self._at(knots)

    def _at(self, marginal_cost: Array) -> Array:
        """Power of each string (column) at marginal costs (rows)."""
        power = (marginal_cost[:, None] - self.curves.slope - self.price) / (2.0 * self.curves.bend)
        return np.minimum(np.maximum(power, 0.0), self.max_kw)

    def _shares(self, sets: Flags, knots: Array, given: Array) -> Array:
        """Best powers within each set (row); ``given`` is the power of each set (column) at the knots."""
        asked = np.minimum(self.demand_kw, given[-1])
        after = np.clip((given < asked).sum(axis=0), 1, knots.size - 1)
        column = np.arange(len(sets))
        low, high = given[after - 1, column], given[after, column]
        part = (asked - low) / np.maximum(high - low, POWER_TOLERANCE_KW)
        return self._at(knots[after - 1] + part * (knots[after] - knots[after - 1])) * sets


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
        # Accumulated saving of each move, "from-to": strings that stop and start.
        self._saved_kwh: dict[str, float] = {}
        # Age [s] and magnitude [kW] of demands above all later ones, within the minimum off time.
        self._peaks: list[tuple[float, float]] = []

    def update(self, problem: CommitmentProblem, *, elapsed_s: float, step_s: float) -> None:
        """Decide for a step of ``step_s``, ``elapsed_s`` after the last decision."""
        self.advance_time(problem.usable, problem.demand_kw, elapsed_s)
        for k in range(2 * self.running.size):
            move = self._move(problem, step_s, adds_up=k == 0)
            if move is None:
                break
            self._saved_kwh = {}
            for strings, on in zip(move, (False, True), strict=True):
                self._switch(np.isin(np.arange(self.running.size), strings), on=on)

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
        self._saved_kwh = {}

    def _stoppable(self) -> Flags:
        return self.running & (self.since_s >= self._service.minimum_on_s)

    def _startable(self, usable: Flags) -> Flags:
        return ~self.running & usable & (self.since_s >= self._service.minimum_off_s)

    def _switch(self, which: Flags, *, on: bool) -> None:
        if which.any():
            self.running = np.where(which, on, self.running)
            self.since_s = np.where(which, 0.0, self.since_s)
            self.starts = self.starts + (which if on else 0)

    def _move(self, problem: CommitmentProblem, step_s: float, *, adds_up: bool) -> list[Indices] | None:
        """Next switching with a net saving: strings that stop, and strings that start instead."""
        n = self.running.size
        stops, starts = np.flatnonzero(self._stoppable()), np.flatnonzero(self._startable(problem.usable))
        # The first move changes nothing.
        from_ = np.concatenate([[n], stops, np.full(starts.size, n)])
        to = np.concatenate([np.full(1 + stops.size, n), starts])
        cost, can = problem.after(self.running, from_, to)
        short = np.maximum(problem.demand_kw - can, 0.0)
        extra, ends = np.append(self._start_worth_kwh(), 0.0), 1 + stops.size
        if short[0] > POWER_TOLERANCE_KW and (short[ends:] < short[0] - POWER_TOLERANCE_KW).any():
            # The capability is too small: the cheapest strings start now, their start cost spread over an
            # hour; in a large plant, all but a few of those that are needed in any case at once.
            urgent = np.argsort((cost + SHORTFALL * 99.0 * short + extra[to])[ends:], kind="stable")
            needed = int(short[0] / problem.max_kw[starts].max())
            return [stops[:0], starts[urgent[: max(1, needed - CHOSEN)]]]
        cheapest = ((stops, cost[1:ends]), (starts, cost[ends:]))
        pairs = np.meshgrid(*(s[np.argsort(alone, kind="stable")[:EXCHANGED]] for s, alone in cheapest))
        paired = *pairs, *problem.after(self.running, *(strings.ravel() for strings in pairs))
        from_, to, cost, can = map(np.append, (from_, to, cost, can), paired)
        if from_.size == 1:
            return None
        allowed = can >= min(max(p for _, p in self._peaks), can[0]) - POWER_TOLERANCE_KW
        saving = np.where(allowed, cost[0] - cost, 0.0)
        moves = [f"{one}-{two}" for one, two in zip(from_, to, strict=True)]
        before = np.array([self._saved_kwh.get(move, 0.0) for move in moves]) if adds_up else 0.0
        saved = np.maximum(before + saving * step_s / 3600.0, 0.0)
        # A stop costs a later start.
        worth = np.where(to < n, extra[to], extra[from_])
        gain = np.where(allowed & (saving > 0.0), saved - worth, -np.inf)
        best = int(np.argmax(gain))
        if gain[best] > 0.0:
            return [strings[best : best + 1] for strings in (from_, to)]
        if adds_up:
            self._saved_kwh = {move: float(kwh) for move, kwh in zip(moves, saved, strict=True) if kwh > 0.0}
        return None

    def _start_worth_kwh(self) -> Array:
        """Cost of a start, smallest for the string with the fewest starts."""
        above = np.minimum(self.starts - self.starts.min(), 40)
        return np.asarray((self._service.start_kwh + 1e-9) * (1.0 + ROTATION * above))
