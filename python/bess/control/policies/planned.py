"""Model predictive control with plans: it applies the first step of a plan over a day or more."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bess.arrays import Array
from bess.checkpoints import Checkpointed
from bess.control.objectives import Objectives
from bess.control.planning import Planner, PlanPrices
from bess.control.policies.policy import NO_OPTIMISATION, Decision, PolicyInput, SolverReport
from bess.control.wear import WearRates
from bess.errors import InputError
from bess.system import State
from bess.system.terms import SettlementTerms

PLANNED: Final = 20
"""Status code of a planned step without certificate."""

NO_PRICES: Final = 'policy.objectives.kind = "money": this study has no prices; use "energy"'
"""Error message for objectives in EUR without prices."""

FULL_POWER_TOLERANCE: Final = 1e-9
"""Relative tolerance of a demand at the power of all inverters, for rounding only."""

TYPICAL_DEPTH = 0.5
"""Cycle depth at which wear is priced."""


class PlannedPolicy(Checkpointed):
    """Calls one :class:`bess.control.planning.Planner` in every step that leaves a choice."""

    statuses: Mapping[int, str] = {
        NO_OPTIMISATION: "no optimisation needed",
        PLANNED: "Planned over the prediction horizon; bounds in the first step and every four weeks.",
    }

    _carried = ("_planner", "_ran")

    def __init__(self, planner: Planner, objectives: Objectives, terms: SettlementTerms) -> None:
        if len(objectives.groups) > 1:
            raise InputError(
                "policy.objectives: a plan has one sum, not several priorities; give all objectives the same "
                'priority, or set policy.mode = "certified"'
            )
        self._planner = planner
        self._objectives = objectives.for_inverters(planner.system.nominal_kw)
        self._terms = terms
        self._wear = WearRates(planner.system)
        self._ran: NDArray[np.bool_] | None = None
        # Last capacities, and the wear prices for them.
        self._wear_cache = np.zeros(0), np.zeros(0)

    def __call__(self, inputs: PolicyInput) -> Decision:
        """Plan the prediction horizon, unless this step leaves no choice."""
        started = time.perf_counter()
        skipped_kw = self.skip(inputs.demand_kw[None], inputs.limit_kw[None])
        if skipped_kw.size:
            reactive_kvar = self._reactive(inputs, skipped_kw[0])
            return Decision(skipped_kw[0], reactive_kvar=reactive_kvar, plan_kw=self._planner.plan_kw)
        prices = self._prices(inputs)
        plan = self._planner(
            inputs.state,
            inputs.demand_kw,
            prices.for_soc_dependent_demand() if inputs.demand_depends_on_soc else prices,
            ambient_c=inputs.ambient_c,
            limit_kw=inputs.expected_limit_kw,
            reactive_kvar=inputs.reactive_kvar,
        )
        request_kw = plan.request_kw[:, 0].copy()
        reactive_kvar = self._reactive(inputs, request_kw)
        report = SolverReport(PLANNED, plan.gap, plan.search_gap, solve_time_s=time.perf_counter() - started)
        return Decision(request_kw, report, reactive_kvar, plan.request_kw)

    def skip(self, demand_kw: Array, limit_kw: Array) -> Array:
        """Pass steps that leave no choice, see :class:`bess.control.policies.Policy`.

        There is no demand, or it takes the power of all inverters in service.
        """
        first_kw, max_kw = abs(float(demand_kw[0, 0])), float(limit_kw[0].sum())
        if 0.0 < first_kw < (1.0 - FULL_POWER_TOLERANCE) * max_kw:
            return limit_kw[:0]
        total_kw = limit_kw.sum(axis=1)
        share = np.divide(demand_kw[:, 0], total_kw, out=np.zeros_like(total_kw), where=total_kw > 0.0)
        leaves_a_choice = (share != 0.0) & (np.abs(share) < 1.0 - FULL_POWER_TOLERANCE)
        n_steps = int(np.argmax(np.append(leaves_a_choice, True)))
        request_kw: Array = share[:n_steps, None] * limit_kw[:n_steps] + 0.0  # no -0
        if n_steps:
            self._planner.advance(demand_kw[:n_steps], request_kw)
        return request_kw

    def _reactive(self, inputs: PolicyInput, request_kw: Array) -> Array | None:
        """Return the reactive power of each string at minimum loss (docs/equations.md, R3), if requested.

        In EUR, the price of an inverter start is converted to losses at the price of this step.
        """
        if inputs.reactive_kvar is None:
            return None
        prices = self._prices(inputs)
        loss = float(prices.losses[0, 2]) * self._planner.dt_h
        start_kw = np.full(request_kw.size, prices.start / loss if loss > 0.0 else 0.0)
        if self._ran is not None:
            start_kw[self._ran] = 0.0
        model = self._planner.system.control_at(inputs.state)
        total_kvar = float(inputs.reactive_kvar[0])
        shares_kvar = model.share_reactive(request_kw, total_kvar, inputs.limit_kw, start_kw)
        self._ran = (request_kw != 0.0) | (shares_kvar != 0.0)
        return shares_kvar

    def _prices(self, inputs: PolicyInput) -> PlanPrices:
        if self._objectives.kind != "money":
            n_strings, n_steps = inputs.limit_kw.size, inputs.demand_kw.size
            return PlanPrices.energy(self._objectives, n_strings, n_steps)
        if inputs.price_eur_mwh is None:
            raise InputError(NO_PRICES)
        return PlanPrices.money(
            self._objectives,
            self._terms,
            inputs.demand_kw,
            inputs.price_eur_mwh,
            self._wear_eur_ah(inputs.state),
        )

    def _wear_eur_ah(self, state: State) -> NDArray[np.float64]:
        """Wear price of charge throughput in each string [EUR/Ah], at its temperature."""
        if self._wear.depend_on_state or not np.array_equal(self._wear_cache[0], state.soh_capacity):
            by_string = self._wear.at(state).cycling_eur_ah(TYPICAL_DEPTH, state.temperature_c[:, None])
            self._wear_cache = state.soh_capacity, np.ascontiguousarray(by_string[:, 0])
        return self._wear_cache[1]
