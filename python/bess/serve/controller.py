"""The live controller: measured strings and a demand in, set-points and their reasons out.

Beneath it a policy keeps its plan at the control step of the system, a quarter of an hour as a rule. At each
control step of a second or more the set of running inverters follows from that plan and from what switching
costs (:mod:`bess.serve.commitment`), the shares follow the demand exactly, and whatever set-points must hold
to is in :mod:`bess.serve.constraints`. Nothing here waits for a plan longer than it is told to.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError
from bess.parameters import State, System
from bess.plants import Measurements
from bess.policies import Policy
from bess.policies.rule import water_fill
from bess.serve.ageing import Ageing
from bess.serve.carried_plan import CarriedPlan
from bess.serve.commitment import Commitment, Curves, best_shares
from bess.serve.constraints import CRUMBS_KW, envelope, share
from bess.serve.guard import Guard, Trusted
from bess.study.sections import ServiceChoice

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NOT_PLANNED: Final = 0.005
"""What a kWh through a string that the plan leaves out counts more, in kWh lost."""
NEAR: Final = 0.1
"""Relative distance from the demand of the plan within which the shares are the plan's."""
NEAR_S: Final = 60.0
"""How long the demand must have been that near."""
SMOOTH_S: Final = 300.0
"""Time over which a demand that fluctuates is smoothed for the plan."""
STEEPEST: Final = 0.02
"""Largest difference of marginal losses that is read out of a plan."""
QUARTER: Final = 0.25
"""Share of nominal power at which a string is calibrated unless the settings say otherwise."""
_FULL: Final = 0.005


@dataclass(frozen=True)
class Answer:
    """Set-points for one control step; powers kW, positive = discharge.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings,)
        Set-points; their sum and ``unmet_kw`` are the demand.
    plan_kw : ndarray, shape (n_strings, n_steps)
        The set-points, then those of the plan for the next steps of the forecast.
    status : str
        A sentence.
    gap : float or None
        Relative distance to a proven bound, where the policy knows one.
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
    reasons: tuple[str, ...]


@dataclass
class Counters:
    """What a service has done since its state began; arrays of shape ``(n_strings,)``."""

    answers: int = 0
    fallbacks: int = 0
    unmet_kwh: float = 0.0
    charged_kwh: Array = field(default_factory=lambda: np.zeros(0))
    discharged_kwh: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Calibration:
    """One string is being charged to full while the others carry the load."""

    string: int
    target_soc: float


class Controller:
    """One plant's controller; it is called from one thread at a time.

    Parameters
    ----------
    system
        The plant's parameters.
    policy
        Makes the plan; any policy of the closed loop.
    service
        Settings.
    plan_steps
        Steps that the policy looks ahead.
    background
        Make plans in a thread of its own. Without it every call is as good as it can be, repeats to the
        last bit, and may take as long as a plan takes: for simulations.

    Attributes
    ----------
    drives : bool
        Whether the set-points reach the plant; strings are then expected to follow them.
    """

    def __init__(
        self,
        system: System,
        policy: Policy,
        service: ServiceChoice,
        plan_steps: int,
        *,
        background: bool = True,
    ) -> None:
        n = system.n_strings
        plan_s = system.control.step_min * 60.0
        self.system, self.service = system, service
        self.step_s = plan_s if service.control_step_s is None else service.control_step_s
        if self.step_s > plan_s:
            raise InputError(
                f"service.control_step_s = {self.step_s:g} s: must not exceed the plan's step, {plan_s:g} s"
            )
        self.plan = CarriedPlan(system, policy, plan_s, plan_steps, background=background)
        self._minimum_kw = _each("service.minimum_power_kw", service.minimum_power_kw, n)
        window = np.array([(s.battery.soc_min, s.battery.soc_max) for s in system.strings])
        self._floor = np.maximum(_each("service.soc_floor", service.soc_floor, n), window[:, 0])
        self._ceiling = np.minimum(_each("service.soc_ceiling", service.soc_ceiling, n), window[:, 1])
        self._full = window[:, 1]
        self._check_settings()
        self.ageing = Ageing(system)
        self._guard = Guard(system, service, self.step_s, self.ageing)
        self.commitment = Commitment(
            n,
            start_kwh=service.start_kwh,
            minimum_on_s=service.minimum_on_s,
            minimum_off_s=service.minimum_off_s,
        )
        self.counters = Counters(charged_kwh=np.zeros(n), discharged_kwh=np.zeros(n))
        self.drives = True
        self.calibration: Calibration | None = None
        self.last_kw: Array = np.zeros(n)
        self.trusted: Trusted | None = None
        self._last_s: float | None = None
        # Mean demand of each step of the day, as it was when it last came.
        self._day_kw: Array = np.full(max(1, round(86_400.0 / plan_s)), np.nan)
        self._mean: tuple[int, float, float] = (-1, 0.0, 0.0)
        self._near_s = 0.0
        self._smooth_kw: float | None = None

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return self.system.n_strings

    def step(
        self,
        measured: Measurements,
        demand_kw: float,
        now_s: float,
        *,
        forecast_kw: Sequence[float] | Array | None = None,
        wait_s: float = 0.0,
    ) -> Answer:
        """Decide for the control step that begins.

        Parameters
        ----------
        measured
            What the plant says.
        demand_kw
            Demand now, finite.
        now_s
            Time of a clock that never goes back; a multiple of the plan's step is where the plan has steps.
        forecast_kw : array_like, shape (n,), optional
            Mean demand of the present step of the plan and those after it; by default what it was at the same
            time of the day before.
        wait_s
            How long to wait for a plan that is due.
        """
        began = time.perf_counter()
        elapsed_s = self.step_s if self._last_s is None else max(0.0, now_s - self._last_s)
        self._count(elapsed_s)
        # A plant that is only watched follows somebody else.
        asked_kw = self.last_kw if self.drives else np.nan_to_num(measured.power_kw)
        trusted = self._guard(measured, asked_kw, elapsed_s)
        self.ageing.gather(trusted.state, asked_kw, elapsed_s, min(elapsed_s, self.step_s))
        forecast = self._forecast(demand_kw, now_s, elapsed_s, forecast_kw)
        self._last_s = now_s
        in_service = np.where(trusted.in_service, np.maximum(trusted.charge_kw, trusted.discharge_kw), 0.0)
        self.plan.update(now_s, trusted.state, forecast, in_service, wait_s=wait_s)

        charge, discharge = self._capability(trusted)
        request, helped = self._calibrating(trusted, charge, discharge, demand_kw)
        rest_kw = demand_kw - float(request.sum())
        sharing = trusted.in_service & ~helped
        is_discharge = rest_kw > 0.0 or (rest_kw == 0.0 and demand_kw >= 0.0)
        worse = State(
            trusted.soc_low if is_discharge else trusted.soc_high,
            trusted.state.temperature_c,
            trusted.state.soh_capacity,
            trusted.state.soh_resistance,
        )
        curves = Curves.of(self.system, worse, is_discharge)
        most = np.where(sharing, discharge if is_discharge else charge, 0.0)
        most = np.where(most >= np.maximum(self._minimum_kw, CRUMBS_KW), most, 0.0)
        wanted = self._decide(curves, most, sharing, abs(rest_kw), now_s, elapsed_s, is_discharge)
        limits = envelope(
            np.where(sharing, charge, 0.0),
            np.where(sharing, discharge, 0.0),
            np.where(sharing, self.last_kw, 0.0),
            None if self.service.ramp_kw_per_s is None else self.service.ramp_kw_per_s * self.step_s,
        )
        running = self.commitment.running & sharing
        request = request + share(
            rest_kw if is_discharge else min(rest_kw, -0.0), wanted, running, limits, self._minimum_kw
        )
        unmet_kw = abs(demand_kw - float(request.sum()))
        unmet_kw = 0.0 if unmet_kw <= 1e-9 * max(1.0, abs(demand_kw)) else unmet_kw
        self.last_kw = request
        self.trusted = trusted
        self.counters.answers += 1
        self.counters.unmet_kwh += unmet_kw * self.step_s / 3600.0
        return Answer(
            request_kw=request,
            plan_kw=self._plan_ahead(request, forecast_kw, now_s, in_service),
            status=self._status(unmet_kw, demand_kw, now_s),
            gap=self._gap(request, now_s),
            fallback=False,
            unmet_kw=unmet_kw,
            valid_for_s=self.step_s,
            solve_time_s=time.perf_counter() - began,
            running=self.commitment.running.copy(),
            reasons=self._reasons(trusted, request, charge, discharge),
        )

    def fallback(self, measured: Measurements, demand_kw: float, why: str, n_steps: int = 1) -> Answer:
        """Share by the energy left, from the measurements alone; see :meth:`applied`."""
        began = time.perf_counter()
        known = measured.available & (measured.soc >= 0.0) & (measured.soc <= 1.0)
        soc = np.where(known, measured.soc, 0.5)
        nominal, energy = self.system.nominal_kw, self.system.nominal_energy_kwh
        discharge = demand_kw >= 0.0
        limit = measured.discharge_limit_kw if discharge else measured.charge_limit_kw
        left = np.maximum(soc - self._floor if discharge else self._ceiling - soc, 0.0) * energy
        most = np.where(known, np.minimum(np.minimum(limit, nominal), left * 3600.0 / self.step_s), 0.0)
        power = water_fill(abs(demand_kw), left, np.maximum(np.nan_to_num(most), 0.0))
        request = power if discharge else -power
        unmet_kw = abs(demand_kw - float(request.sum()))
        unmet_kw = 0.0 if unmet_kw <= 1e-9 * max(1.0, abs(demand_kw)) else unmet_kw
        reasons = tuple(
            f"string {i} {'runs' if p else 'rests'}: shared by the energy left" for i, p in enumerate(power)
        )
        return Answer(
            request, np.repeat(request[:, None], n_steps, axis=1), why, None, True, unmet_kw, self.step_s,
            time.perf_counter() - began, power > 0.0, reasons,
        )  # fmt: skip

    def at_least_loss(self, demand_kw: float, soc: Array) -> Array:
        """Set-points [kW] of the least loss at these states of charge; nothing is remembered.

        Temperatures are those measured last. For callers who know no more than that; see :meth:`step`.
        """
        discharge = demand_kw >= 0.0
        last = self.system.initial_state() if self.trusted is None else self.trusted.state
        low, high = np.array([(s.battery.soc_min, s.battery.soc_max) for s in self.system.strings]).T
        state = State(np.clip(soc, low, high), last.temperature_c, last.soh_capacity, last.soh_resistance)
        free = np.ones(self.n_strings, dtype=bool)
        nominal = self.system.nominal_kw
        trusted = Trusted(state, state.soc, state.soc, nominal, nominal, free, ("",) * self.n_strings)
        charge, discharging = self._capability(trusted)
        most = discharging if discharge else charge
        curves, price = Curves.of(self.system, state, discharge), np.zeros(self.n_strings)
        chosen = Commitment(self.n_strings, start_kwh=0.0)
        step_s = self.plan.step_s
        chosen.update(curves, price, abs(demand_kw), most, most > 0.0, elapsed_s=0.0, step_s=step_s)
        wanted = best_shares(curves, price, most, abs(demand_kw), chosen.running[None, :])[0]
        limits = envelope(charge, discharging, self.last_kw, None)
        return share(demand_kw, wanted, chosen.running, limits, self._minimum_kw)

    def applied(self, answer: Answer) -> None:
        """Take note that this answer went out in place of the last of :meth:`step`."""
        self.last_kw = answer.request_kw
        self.commitment.adopt(answer.running, np.ones(self.n_strings, dtype=bool))
        self.counters.fallbacks += 1

    def calibrate(self, string: int, target_soc: float = 1.0) -> None:
        """Begin to charge one string to full while the others carry the load.

        Raises
        ------
        InputError
            If there is no such string, or the target is outside its window.
        """
        if not 0 <= string < self.n_strings:
            raise InputError(f"string = {string}: the plant has strings 0 to {self.n_strings - 1}")
        low, high = self._floor[string], self._full[string]
        if not low < target_soc <= high:
            raise InputError(
                f"target_soc = {target_soc:g}: must be in ({low:g}, {high:g}] of string {string}"
            )
        if self.n_strings == 1:
            raise InputError("calibration: there is no other string to carry the load")
        self.calibration = Calibration(string, target_soc)

    def memory(self) -> dict[str, Any]:
        """What the next step depends on, but for the plan."""
        calibration = self.calibration
        return {
            "last_s": self._last_s,
            "last_kw": self.last_kw.tolist(),
            "commitment": self.commitment.memory(),
            "guard": self._guard.memory(),
            "ageing": self.ageing.memory(),
            "calibration": None if calibration is None else [calibration.string, calibration.target_soc],
            "day_kw": [None if np.isnan(v) else v for v in self._day_kw.tolist()],
            "mean": list(self._mean),
            "near_s": self._near_s,
            "smooth_kw": self._smooth_kw,
            "counters": {
                "answers": self.counters.answers,
                "fallbacks": self.counters.fallbacks,
                "unmet_kwh": self.counters.unmet_kwh,
                "charged_kwh": self.counters.charged_kwh.tolist(),
                "discharged_kwh": self.counters.discharged_kwh.tolist(),
            },
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with what :meth:`memory` returned."""
        n = self.n_strings
        last = np.array(memory["last_kw"], dtype=np.float64)
        counts = memory["counters"]
        counters = Counters(
            int(counts["answers"]),
            int(counts["fallbacks"]),
            float(counts["unmet_kwh"]),
            np.array(counts["charged_kwh"], dtype=np.float64),
            np.array(counts["discharged_kwh"], dtype=np.float64),
        )
        if not last.shape == counters.charged_kwh.shape == counters.discharged_kwh.shape == (n,):
            raise ValueError(f"is of {last.size} strings, not {n}")
        self.commitment.recall(memory["commitment"])
        self._guard.recall(memory["guard"])
        self.ageing.recall(memory["ageing"])
        self.last_kw, self.counters = last, counters
        self._last_s = None if memory["last_s"] is None else float(memory["last_s"])
        begun = memory["calibration"]
        self.calibration = None if begun is None else Calibration(int(begun[0]), float(begun[1]))
        self._day_kw = np.array([np.nan if v is None else v for v in memory["day_kw"]], dtype=np.float64)
        slot, mean, weight = memory["mean"]
        self._mean = (int(slot), float(mean), float(weight))
        self._near_s = float(memory["near_s"])
        smooth_kw = memory["smooth_kw"]
        self._smooth_kw = None if smooth_kw is None else float(smooth_kw)

    def close(self) -> None:
        """End the thread that plans."""
        self.plan.close()

    def _check_settings(self) -> None:
        for i in range(self.n_strings):
            if self._floor[i] >= self._ceiling[i]:
                raise InputError(
                    f"service.soc_floor = {self._floor[i]:g}: must be below soc_ceiling = "
                    f"{self._ceiling[i]:g} of string {i}"
                )
            if self._minimum_kw[i] > self.system.nominal_kw[i]:
                raise InputError(
                    f"service.minimum_power_kw = {self._minimum_kw[i]:g} kW: string {i} has "
                    f"{self.system.nominal_kw[i]:g} kW"
                )

    def _count(self, elapsed_s: float) -> None:
        """Energy that the last set-points moved; they held no longer than they were valid."""
        hours = min(elapsed_s, self.step_s) / 3600.0
        self.counters.charged_kwh = self.counters.charged_kwh + np.maximum(-self.last_kw, 0.0) * hours
        self.counters.discharged_kwh = self.counters.discharged_kwh + np.maximum(self.last_kw, 0.0) * hours

    def _forecast(
        self, demand_kw: float, now_s: float, elapsed_s: float, given: Sequence[float] | Array | None
    ) -> Array:
        """Demand of the plan's steps, the present one first."""
        n, slot = self.plan.n_steps, self.plan.slot(now_s)
        known, mean, weight_s = self._mean
        if slot != known:
            if known >= 0:
                self._day_kw[known % self._day_kw.size] = mean
            mean, weight_s = 0.0, 0.0
        span_s = max(min(elapsed_s, self.step_s), 1e-3)
        mean = (mean * weight_s + demand_kw * span_s) / (weight_s + span_s)
        self._mean = (slot, mean, weight_s + span_s)
        if given is not None:
            ahead = np.asarray(given, dtype=np.float64)[:n]
            return np.concatenate([ahead, np.zeros(n - ahead.size)])
        ahead = np.nan_to_num(self._day_kw[(slot + np.arange(n)) % self._day_kw.size])
        weight = 1.0 if self._smooth_kw is None else min(1.0, self.step_s / SMOOTH_S)
        self._smooth_kw = (1.0 - weight) * (self._smooth_kw or 0.0) + weight * demand_kw
        ahead[0] = self._smooth_kw
        return ahead

    def _capability(self, trusted: Trusted) -> tuple[Array, Array]:
        """Largest magnitudes of charge and discharge over the control step, reserves kept."""
        dt_h = self.step_s / 3600.0
        state = trusted.state
        model = self.system.control_at(state)
        energy_kwh = self.system.nominal_energy_kwh * state.soh_capacity
        found = []
        for soc, room, limit, discharge in (
            (trusted.soc_high, self._ceiling - trusted.soc_high, trusted.charge_kw, False),
            (trusted.soc_low, trusted.soc_low - self._floor, trusted.discharge_kw, True),
        ):
            able = model.max_power_kw(np.ascontiguousarray(soc), state.temperature_c, discharge, dt_h)
            reserve = np.maximum(room, 0.0) * energy_kwh / dt_h
            found.append(np.maximum(np.minimum(np.minimum(able, reserve), limit), 0.0))
        return found[0], found[1]

    def _calibrating(
        self, trusted: Trusted, charge: Array, discharge: Array, demand_kw: float
    ) -> tuple[Array, Flags]:
        """Set-point of the string that is calibrated, and which one that is."""
        request, which = np.zeros(self.n_strings), np.zeros(self.n_strings, dtype=bool)
        if self.calibration is None:
            return request, which
        i = self.calibration.string
        if trusted.soc_low[i] >= self.calibration.target_soc - _FULL:
            self.calibration = None
            return request, which
        if not trusted.in_service[i]:
            return request, which
        wanted = self.service.calibration_kw or QUARTER * self.system.nominal_kw[i]
        dt_h = self.step_s / 3600.0
        room = (self.calibration.target_soc - trusted.soc_high[i]) * self.system.nominal_energy_kwh[i]
        able = min(wanted, float(trusted.charge_kw[i]), max(room, 0.0) / dt_h)
        # The others carry the load and the charge; where they cannot, the charge is less.
        others = np.arange(self.n_strings) != i
        spare = float(discharge[others & trusted.in_service].sum()) - demand_kw
        power = max(0.0, min(able, spare))
        if power < self._minimum_kw[i]:
            power = 0.0
        which[i] = True
        request[i] = -power
        return request, which

    def _decide(
        self,
        curves: Curves,
        most: Array,
        usable: Flags,
        demand_kw: float,
        now_s: float,
        elapsed_s: float,
        is_discharge: bool,
    ) -> Array:
        """Choose what runs; return the magnitudes wanted of each string."""
        planned = self._planned(now_s)
        price = self._price(curves, planned, is_discharge)
        followed = self._followed(planned, demand_kw if is_discharge else -demand_kw, most, elapsed_s)
        if followed is not None:
            self.commitment.pass_time(usable, elapsed_s)
            self.commitment.adopt(followed > 0.0, usable & (most > 0.0))
            return followed
        self.commitment.update(
            curves, price, demand_kw, most, usable, elapsed_s=elapsed_s, step_s=self.step_s
        )
        running = self.commitment.running[None, :]
        return np.asarray(best_shares(curves, price, most, demand_kw, running)[0])

    def _followed(
        self, planned: Array | None, demand_kw: float, most: Array, elapsed_s: float
    ) -> Array | None:
        """Magnitudes in the proportions of the plan, while the demand stays near that of the plan.

        A demand that only passes there must not switch anything, so it has to stay for a while.
        """
        planned_kw = 0.0 if planned is None else float(planned.sum())
        is_near = abs(demand_kw - planned_kw) <= NEAR * abs(planned_kw)
        self._near_s = self._near_s + elapsed_s if is_near else 0.0
        if planned is None or not is_near or self._near_s + self.step_s < min(NEAR_S, self.plan.step_s):
            return None
        wanted = np.abs(planned) * (abs(demand_kw) / abs(planned_kw) if planned_kw else 0.0)
        # Where it does not fit any more, the least loss decides.
        return wanted if (wanted <= most * (1.0 + 1e-9)).all() else None

    def _planned(self, now_s: float) -> Array | None:
        """Set-points of the plan for now."""
        column = self.plan.column(now_s)
        if self.plan.current is None or column is None:
            return None
        return np.asarray(self.plan.current.request_kw[:, column])

    def _gap(self, request: Array, now_s: float) -> float | None:
        """That of the plan, where it is the answer."""
        planned, plan = self._planned(now_s), self.plan.current
        if plan is None or planned is None or plan.slot != self.plan.slot(now_s):
            return None
        return plan.gap if np.allclose(request, planned, rtol=1e-6, atol=1e-6) else None

    def _price(self, curves: Curves, planned: Array | None, is_discharge: bool) -> Array:
        """What makes the plan's shares those of equal marginal cost; what it leaves out costs more."""
        if planned is None or not planned.any():
            return np.zeros(self.n_strings)
        power = np.abs(planned)
        chosen = power > 0.0
        marginal = curves.marginal(power)
        mean = float((marginal * power).sum() / power.sum())
        price = np.clip(mean - marginal, -STEEPEST, STEEPEST)
        if (float(planned.sum()) > 0.0) != is_discharge:
            price = -price  # who should give more should take less
        return np.where(chosen, price, NOT_PLANNED)

    def _plan_ahead(
        self, request: Array, forecast: Sequence[float] | Array | None, now_s: float, limit: Array
    ) -> Array:
        """The set-points, and shares like the plan's of what is foreseen."""
        if forecast is None or len(forecast) < 2:
            return request[:, None]
        ahead = np.asarray(forecast, dtype=np.float64)
        planned = np.zeros((self.n_strings, ahead.size))
        column, current = self.plan.column(now_s), self.plan.current
        if column is not None and current is not None:
            known = np.minimum(np.abs(current.request_kw[:, column : column + ahead.size]), limit[:, None])
            planned[:, : known.shape[1]] = known
        wanted, most = np.abs(ahead), limit[:, None]
        power = np.where(planned.any(axis=0), planned, most)
        power = power * np.minimum(1.0, wanted / np.maximum(power.sum(axis=0), 1e-12))
        # What the plan leaves open goes where there is room.
        room = most - power
        rest = np.maximum(wanted - power.sum(axis=0), 0.0)
        power = power + room * np.minimum(1.0, rest / np.maximum(room.sum(axis=0), 1e-12))
        plan = np.asarray(np.copysign(power, ahead))
        plan[:, 0] = request
        return plan

    def _status(self, unmet_kw: float, demand_kw: float, now_s: float) -> str:
        if unmet_kw > 0.0:
            return f"{unmet_kw:.4g} kW of {demand_kw:.4g} kW cannot be met; see the reasons of the strings."
        if self.plan.column(now_s) is None:
            why = f" ({self.plan.error})" if self.plan.error else ""
            return f"Shared at the least loss of this step; there is no plan yet{why}."
        return "Shared within the plan."

    def _reasons(self, trusted: Trusted, request: Array, charge: Array, discharge: Array) -> tuple[str, ...]:
        """A sentence for each string."""
        sentences = []
        for i, doubt in enumerate(trusted.reasons):
            running = bool(self.commitment.running[i]) or request[i] != 0.0
            verb = "runs" if request[i] != 0.0 else ("idles" if running else "rests")
            why = doubt or self._why(i, trusted, request, charge, discharge, verb)
            sentences.append(f"string {i} {verb}: {why}")
        return tuple(sentences)

    def _why(
        self, i: int, trusted: Trusted, request: Array, charge: Array, discharge: Array, verb: str
    ) -> str:
        if self.calibration is not None and self.calibration.string == i:
            return f"it is charged to {100.0 * self.calibration.target_soc:g} % for calibration"
        temperature = trusted.state.temperature_c[i]
        derating = self.system.strings[i].derating
        hot = temperature > derating.start_c
        if verb == "runs":
            return f"hot, {temperature:.1f} °C" if hot else "it has its share of the demand"
        if verb == "idles":
            return "a start later would cost more than the standby now"
        if hot:
            return f"hot, {temperature:.1f} °C"
        if discharge[i] <= CRUMBS_KW and request.sum() >= 0.0:
            return f"at its lowest state of charge, {100.0 * trusted.soc_low[i]:.1f} %"
        if charge[i] <= CRUMBS_KW and request.sum() <= 0.0:
            return f"at its highest state of charge, {100.0 * trusted.soc_high[i]:.1f} %"
        return "it is not needed"


def _each(name: str, value: float | tuple[float, ...], n_strings: int) -> Array:
    """One value for each string."""
    values = np.atleast_1d(np.array(value, dtype=np.float64))
    if values.size not in (1, n_strings):
        raise InputError(f"{name}: {values.size} values for {n_strings} strings")
    return np.array(np.broadcast_to(values, (n_strings,)))
