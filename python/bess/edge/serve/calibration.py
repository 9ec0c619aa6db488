"""SOC calibration: one string at a time is charged to full while the others supply the load.

A calibration begins on request, or automatically once per ``service.calibration_days``: at the time of lowest
cost (:func:`place`) within the last day before it is due. A string that was full in this period needs none.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np

from bess.arrays import Array, Flags
from bess.checkpoints import Checkpointed
from bess.control.objectives import SHORTFALL
from bess.control.policies.rule import water_fill
from bess.control.rollout import rollout
from bess.edge.serve.constraints import PowerCapability, SocLimits
from bess.edge.serve.measurement_validator import ValidState
from bess.edge.serve.plan import Background
from bess.errors import InputError
from bess.study.sections import ServiceSection
from bess.system import System

QUARTER: Final = 0.25
"""Default power of a calibration, as a share of nominal power."""
STARTS: Final = 24
"""Candidate times within the day."""
SLACK: Final = 1.2
"""Maximum duration of a calibration, relative to that of its energy at its power."""
_FULL: Final = 0.005
"""SOC below the target that counts as the target."""
_DAY_S: Final = 86_400.0


@dataclass(frozen=True)
class PlannedCalibration:
    """The next string, the start by the controller's clock, and the expected cost."""

    string: int
    start_s: float
    cost_kwh: float


class Calibration(Checkpointed):
    """Charges one string at a time, and plans the next calibration.

    A thread of ``pool`` searches for start times; without a pool, the caller waits.

    Attributes
    ----------
    string : int or None
        String that is being charged to ``target_soc``.
    planned : PlannedCalibration or None
        The next calibration, once its time is found.
    full_s : ndarray, shape (n_strings,)
        Time when each string was last full; initially spread over the period.
    """

    _carried = ("string", "target_soc", "planned", "full_s")
    _classes: ClassVar = {"planned": PlannedCalibration}

    def __init__(
        self,
        system: System,
        service: ServiceSection,
        limits: SocLimits,
        pool: ThreadPoolExecutor | None = None,
    ) -> None:
        self._system, self._service, self._limits = system, service, limits
        self._power_kw = QUARTER * system.nominal_kw
        if service.calibration_kw is not None:
            self._power_kw = np.minimum(service.calibration_kw, system.nominal_kw)
        self._plan_s = system.control.step_s
        self._period_s = np.inf if service.calibration_days is None else _DAY_S * service.calibration_days
        if self._period_s < np.inf and system.n_strings == 1:
            raise InputError("service.calibration_days: there is no other string to carry the load")
        self.string: int | None = None
        self.target_soc = 1.0
        self.planned: PlannedCalibration | None = None
        self.full_s: Array = np.full(system.n_strings, np.nan)
        self.search = Background[tuple[int, float]](pool, "the search for the next calibration")
        # String and begin of the last search.
        self._searched: tuple[int, float] | None = None

    def due_s(self) -> Array | None:
        """Time when each string must be full again; None without a period."""
        return self.full_s + self._period_s if self._period_s < np.inf else None

    def begin(self, string: int, target_soc: float = 1.0) -> None:
        """Charge a string to a SOC while the others supply the load."""
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

    def update(self, now_s: float, valid: ValidState, day_kw: Array) -> None:
        """End a complete calibration, begin one that is planned for now, or plan the next.

        ``day_kw`` is the demand of the next day in steps of the plan.
        """
        if self.is_done(valid):
            self.string = None
        if self._period_s == np.inf:
            self.planned = None  # that of settings with a period
            return
        n = self._system.n_strings
        spread_s = self._period_s * (np.arange(1, n + 1) / n - 1.0)
        self.full_s = np.where(np.isnan(self.full_s), now_s + spread_s, self.full_s)
        if (self.full_s > now_s).any():  # the clock was wrong then
            self.full_s, self.planned = np.minimum(self.full_s, now_s), None
        is_full = valid.in_service & (valid.soc_low >= self._limits.full - _FULL)
        self.full_s = np.where(is_full, now_s, self.full_s)
        if self.planned is not None and is_full[self.planned.string]:
            self.planned = None
        if self.string is not None and valid.in_service[self.string]:
            return  # one that is out of service waits, and loses its turn to the next one that is due
        if self.planned is not None:
            if now_s >= self.planned.start_s:
                string, self.planned = self.planned.string, None
                if valid.in_service[string]:
                    self.string, self.target_soc = string, float(self._limits.full[string])
        elif self._searched is not None and (found := self.search.collect()) is not None:
            string, began_s = self._searched
            self.planned = PlannedCalibration(string, began_s + found[0] * self._plan_s, found[1])
        elif not self.search.is_busy:
            self._look_ahead(now_s, valid, day_kw)

    def is_done(self, valid: ValidState) -> bool:
        """Whether the string in calibration is full by both of its possible values."""
        return self.string is not None and bool(valid.soc_low[self.string] >= self.target_soc - _FULL)

    def request(
        self, valid: ValidState, able: PowerCapability, demand_kw: float, dt_h: float
    ) -> tuple[Array, Flags]:
        """Set-points of the calibration over ``dt_h``, ``<= 0``, and the strings that share all other power.

        The load has precedence: the charge is limited to the remaining power of the others. If there is none,
        the calibration pauses, and its string shares the load. Charge demand that the others cannot take is
        added.
        """
        i, n = self.string, self._system.n_strings
        request, others = np.zeros(n), np.arange(n) != i
        if i is None or not valid.in_service[i]:
            return request, np.ones(n, dtype=bool)
        rest = able.only(others)
        spare_kw = rest.discharge_kw.sum() - demand_kw
        if spare_kw < 0.0:
            return request, np.ones(n, dtype=bool)
        wanted_kw = max(self._power_kw[i], -demand_kw - rest.charge_kw.sum())
        room_kwh = (self.target_soc - valid.soc_high[i]) * valid.energy_kwh[i]
        can_kw = min(wanted_kw, valid.charge_kw[i], room_kwh / dt_h, spare_kw)
        request[i] = -can_kw if can_kw >= self._limits.minimum_kw[i] else 0.0
        return request, others

    def _look_ahead(self, now_s: float, valid: ValidState, day_kw: Array) -> None:
        """Begin the search for a time if a string is due within the day; once in a step of the plan."""
        due_s = np.where(valid.in_service, self.full_s + self._period_s, np.inf)
        i = int(np.argmin(due_s))
        missing_kwh = (self._limits.full[i] - valid.soc_low[i]) * valid.energy_kwh[i]
        ahead_s = max(min(_DAY_S, self._period_s / 2.0), 3600.0 * SLACK * missing_kwh / self._power_kw[i])
        if now_s < due_s[i] - ahead_s:
            return
        searched, self._searched = self._searched, (i, now_s // self._plan_s * self._plan_s)
        if searched == self._searched:
            return
        left = int((due_s[i] - now_s) // self._plan_s)
        task = (self._system, self._service, valid, day_kw, self._plan_s / 3600.0, i, left)
        self.search.begin(place, *task)


def place(
    system: System,
    service: ServiceSection,
    valid: ValidState,
    demand_kw: Array,
    dt_h: float,
    string: int,
    due: int,
) -> tuple[int, float]:
    """Return the step at which a calibration that ends by ``due`` has the lowest cost, and this cost [kWh].

    If none ends by then, it begins before ``due`` and, if possible, ends within both days.

    For each candidate, the control model simulates this day and the next, with the same demand, from a valid
    state, with steps of ``dt_h``; the demand minus the calibration is shared by stored energy or headroom.
    The cost is ``SHORTFALL`` times undelivered energy, plus losses [kWh]; the cost of a calibration is the
    difference from days without it.
    """
    limits = SocLimits(system, service, 3600.0 * dt_h)
    starts = range(0, max(1, min(due, demand_kw.size)), max(1, demand_kw.size // STARTS))
    demand_kw = np.tile(demand_kw, 2)

    def days(start: int) -> tuple[float, int]:
        """Cost of both days, and the step at which the string is full."""
        state, cost_kwh, full = valid.state, 0.0, demand_kw.size + 1
        calibration = Calibration(system, service, limits)
        for k, asked_kw in enumerate(demand_kw):
            now = replace(valid, state=state, soc_low=state.soc, soc_high=state.soc)
            able = limits.able(now)
            if k == start:
                calibration.begin(string, float(limits.full[string]))
            elif calibration.is_done(now):
                calibration.string, full = None, min(full, k)
            own_kw, others = calibration.request(now, able, float(asked_kw), dt_h)
            rest_kw = float(asked_kw - own_kw.sum())
            discharge = rest_kw > 0.0
            left_kwh = limits.left_kwh(state.soc, valid.energy_kwh, discharge)
            power_kw = water_fill(abs(rest_kw), left_kwh, able.only(others).towards(discharge))
            undelivered_kw = abs(rest_kw) - power_kw.sum()
            # The control model accepts requests of one sign: calibration and demand, one after the other.
            for request_kw in (power_kw if discharge else -power_kw, own_kw):
                roll = rollout(system, state, request_kw[:, None], dt_h)
                cost_kwh += float(roll.inverter_loss_kw.sum() + roll.battery_loss_kw.sum()) * dt_h
                undelivered_kw += float(roll.availability_loss_kw.sum() + roll.derating_loss_kw.sum())
                acts = request_kw != 0.0
                soc = np.where(acts, roll.soc[:, 0], state.soc)
                temperature_c = np.where(acts, roll.temperature_c[:, 0], state.temperature_c)
                state = replace(state, soc=soc, temperature_c=temperature_c)
            cost_kwh += SHORTFALL * undelivered_kw * dt_h
        return cost_kwh, full

    costs = {start: days(start) for start in starts}
    full_by = [[start for start in starts if costs[start][1] <= step] for step in (due, demand_kw.size)]
    best = min(full_by[0] or full_by[1] or starts, key=lambda start: costs[start][0])
    return best, costs[best][0] - days(demand_kw.size)[0]
