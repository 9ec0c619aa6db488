"""SOC calibration: one string at a time is charged to full while the others carry the load.

A calibration begins on request, or by itself once in every ``service.calibration_days``: at the time at which
it costs least by the plan (:func:`place`), within the last day before the string is due. A string that
has been full anyway needs none.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from bess.arrays import Array
from bess.control.planning.planner import Planner
from bess.control.planning.prices import PlanPrices
from bess.control.split.objectives import SHORTFALL, Objectives
from bess.control.split.rollout import rollout
from bess.edge.serve.persistent import Persistent
from bess.edge.serve.soc_limits import PowerCapability, SocLimits
from bess.edge.serve.valid_state import ValidState
from bess.errors import InputError
from bess.study.sections import ServiceSection
from bess.system import State, System

QUARTER: Final = 0.25
"""Share of nominal power at which a string is calibrated unless the settings say otherwise."""
STARTS: Final = 24
"""Candidate times within the day."""
SLACK: Final = 1.2
"""Time that a calibration may take over that of its energy at its power."""
_FULL: Final = 0.005
"""State of charge below the target that counts as the target."""
_DAY_S: Final = 86_400.0


@dataclass(frozen=True)
class Placement:
    """Cheapest time of a calibration: step at which it starts, and its cost [kWh]."""

    start: int
    cost_kwh: float


class Calibration(Persistent):
    """The string that is being calibrated, and those that come next.

    Parameters
    ----------
    system
        The plant's parameters.
    service
        ``calibration_days``, ``calibration_kw``.
    limits
        SOC window of each string.
    background
        Find times in a thread of its own.

    Attributes
    ----------
    string : int or None
        String that is being charged to ``target_soc``.
    planned : list or None
        String to be calibrated next, start [s of the controller's clock] and cost [kWh].
    full_s : ndarray, shape (n_strings,)
        When each string was last full; before the first time, the strings are spread over the period.

    Raises
    ------
    InputError
        If there is a period, and no other string to carry the load.
    """

    kept = ("string", "target_soc", "planned", "full_s")

    def __init__(
        self, system: System, service: ServiceSection, limits: SocLimits, *, background: bool
    ) -> None:
        self._system, self._limits, self._background = system, limits, background
        self._power_kw = QUARTER * system.nominal_kw
        if service.calibration_kw is not None:
            self._power_kw = np.minimum(service.calibration_kw, system.nominal_kw)
        self._period_s = None if service.calibration_days is None else _DAY_S * service.calibration_days
        if self._period_s is not None and system.n_strings == 1:
            raise InputError("service.calibration_days: there is no other string to carry the load")
        self.string: int | None = None
        self.target_soc = 1.0
        self.planned: list[float] | None = None
        self.full_s: Array = np.full(system.n_strings, np.nan)
        self._pending: tuple[int, float, Future[Placement]] | None = None

    def due_s(self) -> Array | None:
        """When each string must be full again; None without a period."""
        return None if self._period_s is None else self.full_s + self._period_s

    def begin(self, string: int, target_soc: float) -> None:
        """Charge a string to a state of charge.

        Raises
        ------
        InputError
            If there is no such string, no other one, or the target is outside its window.
        """
        n = self._system.n_strings
        if not 0 <= string < n:
            raise InputError(f"string = {string}: the plant has strings 0 to {n - 1}")
        low, high = self._limits.floor[string], self._limits.full[string]
        if not low < target_soc <= high:
            raise InputError(
                f"target_soc = {target_soc:g}: must be in ({low:g}, {high:g}] of string {string}"
            )
        if n == 1:
            raise InputError("calibration: there is no other string to carry the load")
        self.string, self.target_soc = string, target_soc

    def update(self, now_s: float, trusted: ValidState, day_kw: Array, plan_s: float) -> None:
        """End what is done, and begin what is planned for now; plan the next one as soon as it is in sight.

        Parameters
        ----------
        now_s
            Time of the controller's clock.
        trusted
            State of the strings.
        day_kw : ndarray, shape (n_steps,)
            Demand of the next day, by steps of the plan.
        plan_s
            Step of the plan [s].
        """
        i = self.string
        if i is not None and trusted.soc_low[i] >= self.target_soc - _FULL:
            self.string = None
        if self._period_s is None:
            return
        n = self._system.n_strings
        spread_s = self._period_s * (np.arange(1, n + 1) / n - 1.0)
        self.full_s = np.where(np.isnan(self.full_s), now_s + spread_s, self.full_s)
        is_full = trusted.in_service & (trusted.soc_low >= self._limits.full - _FULL)
        self.full_s = np.where(is_full, now_s, self.full_s)
        if self.planned is not None and is_full[int(self.planned[0])]:
            self.planned = None
        if self.string is not None:
            return
        if self.planned is not None:
            if now_s >= self.planned[1] and trusted.in_service[int(self.planned[0])]:
                self.string = int(self.planned[0])
                self.target_soc, self.planned = float(self._limits.full[self.string]), None
        elif self._pending is None:
            self._look_ahead(now_s, trusted, day_kw, plan_s, self._period_s)
        elif self._pending[2].done():
            string, began_s, placed = self._pending[0], self._pending[1], self._pending[2].result()
            self.planned = [string, began_s + placed.start * plan_s, placed.cost_kwh]
            self._pending = None

    def charge_kw(
        self, trusted: ValidState, able: PowerCapability, demand_kw: float, dt_h: float
    ) -> Array | None:
        """Magnitude at which each string is charged over the next ``dt_h`` hours, zero but for one.

        The load comes first. The others carry it and the charge; where they cannot, the charge is less, and
        where they cannot carry the load alone, no string is calibrated now (None). Charge that the others
        cannot take comes on top.
        """
        i = self.string
        if i is None or not trusted.in_service[i]:
            return None
        others = able.only(np.arange(self._system.n_strings) != i)
        spare_kw = others.discharge_kw.sum() - demand_kw
        if spare_kw < 0.0:
            return None
        wanted_kw = max(self._power_kw[i], -demand_kw - others.charge_kw.sum())
        room_kwh = (self.target_soc - trusted.soc_high[i]) * self._system.nominal_energy_kwh[i]
        can_kw = min(wanted_kw, trusted.charge_kw[i], room_kwh / dt_h, spare_kw)
        charge = np.zeros(self._system.n_strings)
        charge[i] = can_kw if can_kw >= self._limits.minimum_kw[i] else 0.0
        return charge

    def _look_ahead(
        self, now_s: float, trusted: ValidState, day_kw: Array, plan_s: float, period_s: float
    ) -> None:
        """Begin to look for a time if a string is due within the day."""
        due_s = np.where(trusted.in_service, self.full_s + period_s, np.inf)
        i = int(np.argmin(due_s))
        missing_kwh = (self._limits.full[i] - trusted.soc_low[i]) * self._system.nominal_energy_kwh[i]
        ahead_s = max(min(_DAY_S, period_s / 2.0), 3600.0 * SLACK * missing_kwh / self._power_kw[i])
        if now_s < due_s[i] - ahead_s:
            return
        left = int((due_s[i] - now_s) // plan_s)
        task = (
            self._system,
            trusted,
            day_kw,
            plan_s / 3600.0,
            i,
            self._power_kw[i],
            self._limits.full[i],
            left,
        )
        future: Future[Placement] = Future()
        if self._background:
            pool = ThreadPoolExecutor(1, "calibration")
            future = pool.submit(place, *task)
            pool.shutdown(wait=False)
        else:
            future.set_result(place(*task))
        began_s = now_s // plan_s * plan_s
        self._pending = (i, began_s, future)


def place(
    system: System,
    trusted: ValidState,
    demand_kw: Array,
    dt_h: float,
    string: int,
    charge_kw: float,
    target_soc: float,
    due: int,
) -> Placement:
    """Find the start of a calibration at which the plan of the plant costs least.

    The cost of a schedule is ``SHORTFALL`` times undelivered energy, and losses, in the control model [kWh].
    Until the start the strings follow the plan without a calibration; then the string is charged while the
    others are planned for the demand and the charge; after that all strings are planned again. The cost of
    the calibration is what this sum exceeds the cost of the plan without it.

    Parameters
    ----------
    system, trusted
        The plant, and its state at the first step.
    demand_kw : ndarray, shape (n_steps,)
        Demand of each step, positive = discharge.
    dt_h
        Length of a step [h].
    string, charge_kw, target_soc
        Charge this string at this power (magnitude) to this state of charge.
    due
        Step by which it is to be charged; if that cannot be, it starts at once.
    """
    limit, n_steps = trusted.limit_kw, demand_kw.size
    helpers = limit * (np.arange(limit.size) != string)
    charge = np.zeros((limit.size, n_steps))
    charge[string] = -np.clip(helpers.sum() - demand_kw, 0.0, charge_kw)  # the load comes first

    def follow(
        state: State, request_kw: Array, asked_kw: Array, shortfall: float = SHORTFALL
    ) -> tuple[Array, list[State]]:
        """Cost of each step [kWh], and the state after it."""
        roll = rollout(system, state, request_kw, dt_h)
        undelivered = roll.availability_loss_kw + roll.derating_loss_kw
        losses = (roll.inverter_loss_kw + roll.battery_loss_kw + shortfall * undelivered).sum(axis=0)
        unmet = np.abs(asked_kw - request_kw.sum(axis=0))
        after = [
            State(soc, temperature, state.soh_capacity, state.soh_resistance)
            for soc, temperature in zip(roll.soc.T, roll.temperature_c.T, strict=True)
        ]
        return (losses + shortfall * unmet) * dt_h, after

    def plan(state: State, asked_kw: Array, limit_kw: Array) -> tuple[Array, list[State]]:
        if not asked_kw.size:
            return np.zeros(0), []
        planner = Planner(system, asked_kw.size, dt_h, balance=0.0, bound_passes=0, known=True)
        prices = PlanPrices.energy(Objectives.energy(), limit.size, asked_kw.size)
        served_kw = np.clip(asked_kw, -limit_kw.sum(), limit_kw.sum())
        return follow(state, planner(state, served_kw, prices, limit_kw=limit_kw).request_kw, asked_kw)

    base, states = plan(trusted.state, demand_kw, limit)
    states = [trusted.state, *states]
    costs: dict[int, float] = {}
    for start in range(0, n_steps, max(1, n_steps // STARTS)):
        before = states[start]
        if start:
            soc = np.full(limit.size, np.average(before.soc, weights=system.nominal_energy_kwh))
            before = State(soc, before.temperature_c, before.soh_capacity, before.soh_resistance)
        alone, charged = follow(before, charge[:, start:], charge[string, start:], 0.0)
        full = [state.soc[string] >= target_soc - _FULL for state in charged]
        steps = full.index(True) + 1 if any(full) else len(full)
        if costs and (start + steps > due or not any(full)):
            break  # it does not end in time, nor does any later one
        during, end = slice(start, start + steps), charged[steps - 1]
        helped, others = plan(before, demand_kw[during] - charge[string, during], helpers)
        own = np.arange(limit.size) == string
        after = State(
            np.where(own, end.soc, others[-1].soc),
            np.where(own, end.temperature_c, others[-1].temperature_c),
            end.soh_capacity,
            end.soh_resistance,
        )
        rest, _ = plan(after, demand_kw[start + steps :], limit)
        costs[start] = base[:start].sum() + alone[:steps].sum() + helped.sum() + rest.sum()
    best = min(costs, key=lambda start: costs[start])
    return Placement(best, float(costs[best] - base.sum()))
