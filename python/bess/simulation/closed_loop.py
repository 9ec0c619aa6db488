"""The closed loop of control steps: demand, policy, plant, record."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, cast

import numpy as np

from bess.arrays import Array, Flags, read_only, real_numbers
from bess.control.policies import NO_OPTIMISATION, Decision, Policy, PolicyInput, SolverReport
from bess.control.policies.reactive import share_equally
from bess.control.wear import WearPrices
from bess.errors import BessError, InputError
from bess.plant import Flows, Plant, PlantSnapshot
from bess.simulation.inputs import Inputs
from bess.simulation.record.dataset import FLOWS, OPTIONAL_FLOWS
from bess.simulation.record.store import Record, joined
from bess.study.demands.source import StepInputs
from bess.system import State
from bess.system.state import TEMPERATURE_RANGE_C

SKIPPED_STEPS = 12
"""Steps that a policy is first asked to skip; results do not depend on it."""
_TOLERANCE = 1e-9
"""Relative tolerance between the sum of set-points and the demand, for rounding only."""


_Passed = tuple[Record, list[dict[str, Any]]]
"""Variables of the dataset for consecutive steps, and log lines: one for each step with a solve or with
undelivered energy."""


class ClosedLoop:
    """A policy that controls a plant.

    Attributes
    ----------
    inputs, policy
        Inputs and policy of the run.
    step : int
        Index of the next step.
    policy_s, plant_s : float
        Wall-clock time spent in the policy and in the plant [s]; a controller of the core counts with
        the plant.
    """

    def __init__(
        self, inputs: Inputs, policy: Policy, plant: Plant, *, node_temperatures: bool, policy_name: str
    ) -> None:
        self.inputs = inputs
        self.policy = policy
        self._policy_name = policy_name
        self._plant = plant
        strings = inputs.system.strings
        self._ages = any(string.wear.cell_model for string in strings)
        has = {
            "ageing": self._ages,
            "entropy": any(string.battery.entropy for string in strings),
            "reactive": inputs.reactive is not None,
            "cooling": inputs.system.cooling is not None,
            "nodes": node_temperatures,
        }
        self._flows = [
            *FLOWS,
            *(name for kind, names in OPTIONAL_FLOWS.items() if has[kind] for name in names),
        ]
        self._prices = WearPrices.of(inputs.system)
        # The controller receives the temperature that its strings cool towards.
        self._surroundings_c = inputs.system.surroundings_c(inputs.ambient_c)
        self._delivered_kw = 0.0
        self._skipped_steps = SKIPPED_STEPS
        # Demand and forecast of the next steps as far as known, a row each, and as served; capacities before.
        self._ahead_kw = self._served_kw = np.zeros((0, inputs.horizon_steps))
        self._soh_capacity = np.zeros(0)
        self.step = 0
        self.policy_s = self.plant_s = 0.0

    def advance_part(self, most: int, is_over: Callable[[int], bool] = lambda step: False) -> _Passed:
        """Run up to ``most`` control steps, at least one, until ``is_over(step)``; return record and log."""
        last = min(self.step + most, self.inputs.grid.n_steps)
        in_blocks = self.in_blocks
        passed: list[_Passed] = []
        while not passed or not (is_over(self.step) or self.step == last):
            passed.append(self._pass_block(last - self.step) if in_blocks else self._pass_step())
        return joined([record for record, _ in passed]), [line for _, log in passed for line in log]

    def _pass_step(self) -> _Passed:
        """Run one control step."""
        step, inputs = self.step, self.inputs
        investment_eur = inputs.installations.install(step, self._plant)
        in_service = inputs.installations.in_service(step)
        state = self._plant.state
        announced_kw = _ahead(inputs.announced_kw, step, inputs.horizon_steps)
        # What is not announced is expected to last.
        limit_ahead_kw = np.minimum(announced_kw, np.where(in_service, inputs.unannounced_kw[step], 0.0)).T
        limit_kw = limit_ahead_kw[:, 0]
        if len(self._ahead_kw):
            ahead_kw, served_kw = self._ahead_kw[0], self._served_kw[0]
        else:
            now = StepInputs(state, limit_kw, self._surroundings_c[step:], self._delivered_kw)
            ahead_kw = inputs.demand.ahead(step, inputs.horizon_steps, now)
            served_kw = self._served(ahead_kw, limit_kw)
        asked_kvar = None if inputs.reactive is None else inputs.reactive(step, served_kw)
        price_eur_mwh, horizon_steps = inputs.price_eur_mwh, inputs.horizon_steps
        if inputs.price_ahead is not None:
            price_eur_mwh = _ahead(inputs.price_ahead(step, horizon_steps), 0, horizon_steps)
        elif price_eur_mwh is not None:
            price_eur_mwh = _ahead(price_eur_mwh, step, horizon_steps)
        policy_input = PolicyInput(
            state=state,
            demand_kw=served_kw,
            ambient_c=_ahead(self._surroundings_c, step, inputs.horizon_steps),
            limit_kw=limit_kw,
            price_eur_mwh=price_eur_mwh,
            demand_depends_on_soc=inputs.demand.demand_depends_on_soc,
            reactive_kvar=asked_kvar,
            limit_ahead_kw=limit_ahead_kw,
        )
        began = time.perf_counter()
        decision, request_kw = self._decide(policy_input)
        decided = time.perf_counter()
        shares_kvar = self._reactive(policy_input, decision, request_kw)
        flows = self._plant.run(
            request_kw[None],
            float(inputs.grid.step_s),
            ambient_c=inputs.ambient_c[step : step + 1],
            nodes="node_temperature_c" in self._flows,
            reactive_kvar=None if shares_kvar is None else shares_kvar[None],
        )
        self.policy_s += decided - began
        self.plant_s += time.perf_counter() - decided
        inputs.installations.count_ended(in_service, flows.soh_capacity[0])
        return self._passed(
            flows,
            demand_kw=ahead_kw[:1],
            served_kw=served_kw[:1],
            request_kw=request_kw[None],
            soh_capacity=state.soh_capacity,
            in_service=in_service,
            solver=decision.solver,
            asked_kvar=asked_kvar,
            investment_eur=investment_eur,
        )

    @property
    def in_blocks(self) -> bool:
        """Whether many steps can run in one call: by a controller of the core, or without optimisation."""
        decides = getattr(self.policy, "controller", None) is not None or hasattr(self.policy, "skip")
        return (
            decides
            and self.inputs.reactive is None
            and not self.inputs.installations.any
            and "node_temperature_c" not in self._flows
        )

    def _pass_block(self, most: int) -> _Passed:
        """Run up to ``most`` control steps in one call of the core; only where :attr:`in_blocks`.

        A policy without controller decides step by step; steps that it skips run together.
        """
        inputs, first = self.inputs, self.step
        controller = getattr(self.policy, "controller", None)
        if not len(self._ahead_kw):
            state, limits_kw = self._plant.state, inputs.limit_kw[first : first + most]
            changes = np.append((limits_kw != limits_kw[0]).any(axis=1), True)
            now = StepInputs(state, limits_kw[0], self._surroundings_c[first:], self._delivered_kw)
            self._ahead_kw = inputs.demand.block(first, int(np.argmax(changes)), inputs.horizon_steps, now)
            self._served_kw = self._served(self._ahead_kw, limits_kw[0])
            self._soh_capacity = state.soh_capacity
        n_steps = min(len(self._ahead_kw), most if controller is not None else self._skipped_steps)
        limit_kw, served_kw = inputs.limit_kw[first : first + n_steps], self._served_kw[:n_steps]
        if controller is None:
            began = time.perf_counter()
            request_kw = self._skip(served_kw, limit_kw)
            self.policy_s += time.perf_counter() - began
            # After each skipped block a longer one is likely: fewer calls, and few rows that are not used.
            self._skipped_steps = 2 * n_steps if len(request_kw) == n_steps else SKIPPED_STEPS
            n_steps = len(request_kw)
            if n_steps == 0:
                return self._pass_step()
            served_kw, limit_kw = served_kw[:n_steps], limit_kw[:n_steps]
        ambient_c = inputs.ambient_c[first : first + n_steps]
        step_s = float(inputs.grid.step_s)
        began = time.perf_counter()
        if controller is None:
            flows = self._plant.run(request_kw, step_s, ambient_c=ambient_c)
        else:
            try:
                request_kw, flows = self._plant.run_controller(
                    controller, served_kw, limit_kw, ambient_c, step_s
                )
            except InputError as error:
                raise InputError(f"{self._place}: {error}") from error
            missed_kw = np.abs(request_kw.sum(axis=1) - served_kw[:, 0])
            if (missed_kw > self._slack_kw(limit_kw)).any():
                raise BessError(f"{self._place}: set-points do not sum to the demand; please report this")
        self.plant_s += time.perf_counter() - began
        return self._passed(
            flows,
            demand_kw=self._ahead_kw[:n_steps, 0],
            served_kw=served_kw[:, 0],
            request_kw=request_kw,
            soh_capacity=self._soh_capacity,
            in_service=inputs.installations.in_service(first),
            solver=SolverReport(),
        )

    def _passed(
        self,
        flows: Flows,
        *,
        demand_kw: Array,
        served_kw: Array,
        request_kw: Array,
        soh_capacity: Array,
        in_service: Flags,
        solver: SolverReport,
        asked_kvar: Array | None = None,
        investment_eur: Array | None = None,
    ) -> _Passed:
        """Record the steps of ``flows`` and pass them; the demand measures the starts of later steps.

        ``soh_capacity`` are the capacities before, ``asked_kvar`` and ``investment_eur`` of a single step.
        """
        inputs, n_steps = self.inputs, len(flows.soc)
        hottest_c = max(each.max() for each in (flows.node_max_c, flows.coolant_c) if each is not None)
        if hottest_c > TEMPERATURE_RANGE_C[1]:
            raise InputError(
                f"{self._place}: cells or coolant reach {hottest_c:.0f} degC, above the "
                f"{TEMPERATURE_RANGE_C[1]:g} degC of a plant; check cooling, thermal and losses of the system"
            )
        steps = range(self.step, self.step + n_steps)
        here = slice(steps.start, steps.stop)
        record: Record = {
            "demand_kw": demand_kw,
            "unmet_kw": np.abs(demand_kw - served_kw),
            "ambient_c": inputs.ambient_c[here],
            "request_kw": request_kw,
            "solver_status": np.full(n_steps, solver.status),
            "solver_gap": np.full(n_steps, solver.gap),
            "solver_search_gap": np.full(n_steps, solver.search_gap),
            "solver_nodes": np.full(n_steps, solver.nodes),
            "fallback": np.full(n_steps, int(solver.fallback)),
        }
        if inputs.price_eur_mwh is not None:
            record["price_eur_mwh"] = inputs.price_eur_mwh[here]
        if asked_kvar is not None:
            record["reactive_demand_kvar"] = asked_kvar[:1]
        planned = [inputs.demand.planned(step) for step in steps]
        record |= {name: np.array([row[name] for row in planned]) for name in planned[0]}
        record |= {name: values[here] for name, values in inputs.series.items()}
        record |= {name: getattr(flows, name) for name in self._flows}
        after = flows.soh_capacity
        before = np.concatenate([soh_capacity[None], after[:-1]])
        lost = np.where(in_service, before - after, 0.0)
        discharged_kwh = np.maximum(flows.delivered_kw, 0.0) * inputs.grid.dt_h
        record["wear_eur"] = self._prices.cost_eur(lost, discharged_kwh)
        if self._ages:
            limit = self._prices.end_of_life
            record["end_of_life"] = (in_service & (before > limit) & (after <= limit)).astype(np.int32)
        if investment_eur is not None and inputs.installations.any:
            record["investment_eur"] = investment_eur[None]
        log = list(self._logged(solver, record["unmet_kw"]))
        self.step, self._delivered_kw = steps.stop, float(flows.delivered_kw[-1].sum())
        self._ahead_kw, self._served_kw = self._ahead_kw[n_steps:], self._served_kw[n_steps:]
        self._soh_capacity = after[-1]
        measured = steps if len(self._ahead_kw) else steps[:-1]
        for step, soc, capacity in zip(measured, flows.soc, after, strict=False):
            inputs.demand.measured(step + 1, soc, capacity)
        return record, log

    def _logged(self, solver: SolverReport, unmet_kw: Array) -> Iterator[dict[str, Any]]:
        """Log lines of the next steps."""
        solved = solver.status != NO_OPTIMISATION or solver.solve_time_s > 0.0 or solver.fallback
        for step, lacking_kw in enumerate(unmet_kw.tolist(), self.step):
            if not (solved or lacking_kw > 0.0):
                continue
            start = np.datetime64(self.inputs.grid.start_s + step * self.inputs.grid.step_s, "s")
            yield {
                "step": step,
                "time": f"{start}Z",
                "status": self.policy.statuses[solver.status],
                "gap": solver.gap,
                "search_gap": solver.search_gap,
                "nodes": solver.nodes,
                "fallback": solver.fallback,
                "unmet_kw": lacking_kw,
                "solve_time_s": solver.solve_time_s,
            }

    def checkpoint(self) -> dict[str, Any]:
        """Return the state that the next step depends on."""
        return {
            "step": self.step,
            "plant": vars(self._plant.snapshot()),
            "policy": self.policy.state_dict(),
            "demand": self.inputs.demand.state_dict(),
            "installations": self.inputs.installations.state_dict(),
            "delivered_kw": self._delivered_kw,
        }

    def restore(self, checkpoint: Mapping[str, Any]) -> None:
        """Restore a state returned by :meth:`checkpoint`."""
        self.step = checkpoint["step"]
        self._plant.restore(PlantSnapshot(**checkpoint["plant"]))
        self.policy.load_state_dict(checkpoint["policy"])
        self.inputs.demand.load_state_dict(checkpoint["demand"])
        self.inputs.installations.load_state_dict(checkpoint["installations"])
        self._delivered_kw = checkpoint["delivered_kw"]
        self._ahead_kw = self._ahead_kw[:0]

    def _decide(self, policy_input: PolicyInput) -> tuple[Decision, Array]:
        """Return a checked decision and its set-points, set to 0 below the minimum inverter power."""
        limit_kw = policy_input.limit_kw
        with self._named_errors():
            decision = self.policy(policy_input)
            # A copy for the record: a policy may write every answer into the same array.
            request_kw = real_numbers(decision.request_kw).copy()
        if request_kw.shape != limit_kw.shape:
            raise BessError(
                f"{self._place}: returned set-points of shape {request_kw.shape}, needs "
                f"{limit_kw.shape}, one for each string"
            )
        if (status := decision.solver.status) not in self.policy.statuses:
            raise BessError(f"{self._place}: status {status} is none of {dict(self.policy.statuses)}")
        self._check_requests(request_kw[None], policy_input.demand_kw[:1], limit_kw[None])
        return decision, self._without_small(request_kw[None], limit_kw[None], policy_input.state)[0]

    def _skip(self, served_kw: Array, limit_kw: Array) -> Array:
        """Return the checked set-points of the steps that the policy skips."""
        with self._named_errors():
            skipped = cast(Any, self.policy).skip(read_only(served_kw), read_only(limit_kw))
            request_kw = real_numbers(skipped).copy()
        n_steps, n_strings = limit_kw.shape
        if request_kw.size == 0:
            return np.zeros((0, n_strings))
        if request_kw.ndim != 2 or request_kw.shape[1] != n_strings or len(request_kw) > n_steps:
            raise BessError(
                f"{self._place}: skip returned set-points of shape {request_kw.shape}, needs "
                f"(n, {n_strings}) for the first n of {n_steps} steps"
            )
        limit_kw = limit_kw[: len(request_kw)]
        self._check_requests(request_kw, served_kw[: len(request_kw), 0], limit_kw)
        return self._without_small(request_kw, limit_kw, self._plant.state)

    def _check_requests(self, request_kw: Array, demand_kw: Array, limit_kw: Array) -> None:
        """Raise BessError unless set-points of the next steps, a row each, are within limits and sum up."""
        # Written so that NaN fails as well.
        held = (np.abs(request_kw) <= limit_kw + _rounding_kw(limit_kw)[:, None]).all(axis=1)
        held &= np.abs(request_kw.sum(axis=1) - demand_kw) <= self._slack_kw(limit_kw)
        if not held.all():
            k = int(np.argmin(held))
            raise BessError(
                f"{self._place_of(self.step + k)}: the policy requested {_listed(request_kw[k])} kW for "
                f"{demand_kw[k]:g} kW within {_listed(limit_kw[k])} kW; this is an error of the policy"
            )

    def _without_small(self, request_kw: Array, limit_kw: Array, state: State) -> Array:
        """Set-points, a row for each step, none of them between 0 and the minimum inverter power."""
        system = self.inputs.system
        small = ((request_kw != 0.0) & (np.abs(request_kw) < system.min_power_kw)).any(axis=1)
        if not small.any():
            return request_kw
        model, changed_kw = system.control_at(state), request_kw.copy()
        for k in np.flatnonzero(small):
            charged_kw, discharged_kw = (
                model.set_points(np.maximum(sign * request_kw[k], 0.0), limit_kw[k]) for sign in (-1.0, 1.0)
            )
            changed_kw[k] = discharged_kw - charged_kw
        return changed_kw

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        """Name policy and step in every error of a call of the policy."""
        try:
            yield
        except Exception as error:
            kind = "" if isinstance(error, BessError) else f"{type(error).__name__}: "
            raised = InputError if isinstance(error, InputError) else BessError
            raise raised(f"{self._place}: {kind}{error}") from error

    def _served(self, demand_kw: Array, limit_kw: Array) -> Array:
        """Demand and forecasts ``(..., n_steps)``, limited to the power of the plant; 0 below its minimum.

        The demand of the step is limited to the power in service.
        """
        plant_kw, total_kw = self.inputs.system.nominal_kw.sum(), limit_kw.sum()
        served_kw = np.clip(demand_kw, -plant_kw, plant_kw)
        served_kw[..., 0] = np.clip(served_kw[..., 0], -total_kw, total_kw)
        served_kw[np.abs(served_kw) < self.inputs.system.min_power_kw.min()] = 0.0
        return served_kw

    def _slack_kw(self, limit_kw: Array) -> Array:
        """Tolerance of the sum of set-points: rounding and the minimum powers of the inverters."""
        return _rounding_kw(limit_kw) + float(self.inputs.system.min_power_kw.sum())

    def _reactive(self, policy_input: PolicyInput, decision: Decision, request_kw: Array) -> Array | None:
        """Reactive power of each string, allocated by the policy or, if it does not, in equal parts."""
        if policy_input.reactive_kvar is None:
            return None
        asked_kvar, limit_kva = float(policy_input.reactive_kvar[0]), policy_input.limit_kw
        if decision.reactive_kvar is None:
            return share_equally(request_kw, asked_kvar, limit_kva)
        try:
            shares_kvar = real_numbers(decision.reactive_kvar)
        except ValueError as error:
            raise BessError(f"{self._place}: reactive power: {error}") from error
        slack_kvar = _TOLERANCE * max(1.0, abs(asked_kvar), float(limit_kva.sum()))
        within = shares_kvar.shape == limit_kva.shape and bool(
            (np.hypot(decision.request_kw, shares_kvar) <= limit_kva + slack_kvar).all()
            and (shares_kvar * asked_kvar >= 0.0).all()
            and abs(shares_kvar.sum()) <= abs(asked_kvar) + slack_kvar
        )
        if not within:
            raise BessError(
                f"{self._place}: the policy shares {_listed(np.atleast_1d(shares_kvar))} kvar for "
                f"{asked_kvar:g} kvar beside {_listed(np.atleast_1d(decision.request_kw))} kW within "
                f"{_listed(limit_kva)} kVA; this is an error of the policy"
            )
        return shares_kvar

    @property
    def _place(self) -> str:
        return self._place_of(self.step)

    def _place_of(self, step: int) -> str:
        return f"policy {self._policy_name!r}, step {step}"


def _rounding_kw(limit_kw: Array) -> Array:
    """Tolerance between two powers of strings with these limits that should be equal [kW]."""
    return np.asarray(_TOLERANCE * np.maximum(1.0, limit_kw.sum(axis=-1)))


def _ahead(values: Array, step: int, n_steps: int) -> Array:
    """Values or rows from a step on; the last one is repeated after the end of the run."""
    ahead = values[step : step + n_steps]
    missing = n_steps - len(ahead)
    return np.concatenate([ahead, np.repeat(ahead[-1:], missing, axis=0)]) if missing else ahead


def _listed(values: Array) -> str:
    return "[" + ", ".join(f"{value:g}" for value in values[:8]) + (", ...]" if values.size > 8 else "]")
