"""Model predictive control with foresight: the plan of a day or more, its first step applied."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError
from bess.foresight import Planner, PlanPrices
from bess.numbers import Array
from bess.parameters import State
from bess.parameters.terms import Terms
from bess.policies.policy import NO_OPTIMISATION, Decision, Situation, SolverReport
from bess.policies.reactive import shared_at_least_loss
from bess.split.objectives import Objectives
from bess.wear import WearRates

PLANNED: Final = 20
"""Status code of a step that was planned, not certified."""

NO_PRICES: Final = 'policy.objectives.kind = "money": this study has no prices; use "energy"'
"""What is said to objectives in EUR where there are no prices."""

TYPICAL_DEPTH = 0.5
"""Depth of cycle at which wear is priced."""


class PlannedPolicy:
    """Calls one :class:`bess.foresight.Planner` in every step in which something is asked."""

    statuses: Mapping[int, str] = {
        NO_OPTIMISATION: "no optimisation needed",
        PLANNED: "Planned over the foresight; the first plan has bounds, and one every four weeks.",
    }

    def __init__(self, planner: Planner, objectives: Objectives, terms: Terms) -> None:
        if len(objectives.groups) > 1:
            raise InputError(
                "policy.objectives: a plan has one sum, not several priorities; give all objectives the same "
                'priority, or set policy.mode = "certified"'
            )
        self._planner = planner
        self._objectives = objectives
        self._terms = terms
        self._wear = WearRates(planner.system)
        self._ran: NDArray[np.bool_] | None = None

    def __call__(self, situation: Situation) -> Decision:
        """Plan the steps ahead; an idle step needs no plan."""
        started = time.perf_counter()
        if situation.demand_kw[0] == 0.0:
            self._planner.skip(situation.demand_kw)
            request_kw = np.zeros_like(situation.limit_kw)
            return Decision(request_kw, reactive_kvar=self._reactive(situation, request_kw))
        prices = self._prices(situation)
        plan = self._planner(
            situation.state,
            situation.demand_kw,
            prices.following_store() if situation.follows_store else prices,
            ambient_c=situation.ambient_c,
            limit_kw=situation.limit_kw,
            reactive_kvar=situation.reactive_kvar,
        )
        request_kw = plan.request_kw[:, 0].copy()
        reactive_kvar = self._reactive(situation, request_kw)
        report = SolverReport(PLANNED, plan.gap, plan.search_gap, solve_time_s=time.perf_counter() - started)
        return Decision(request_kw, report, reactive_kvar)

    def memory(self) -> dict[str, Any]:
        """What the planner carries along, and which inverters ran for reactive power."""
        return self._planner.memory() | ({} if self._ran is None else {"ran": self._ran})

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Continue with the plan of the checkpoint."""
        self._planner.recall(memory)
        self._ran = memory.get("ran")

    def _reactive(self, situation: Situation, request_kw: Array) -> Array | None:
        """Reactive power of each string, where any is asked for: that which loses least beside active power.

        In EUR, the start of an inverter counts as the loss that its price would buy in this step.
        """
        if situation.reactive_kvar is None:
            return None
        prices = self._prices(situation)
        loss = float(prices.losses[0, 2]) * self._planner.dt_h
        start_kw = np.full(request_kw.size, prices.start / loss if loss > 0.0 else 0.0)
        if self._ran is not None:
            start_kw[self._ran] = 0.0
        shares_kvar = shared_at_least_loss(
            self._planner.system,
            situation.state,
            request_kw,
            float(situation.reactive_kvar[0]),
            situation.limit_kw,
            start_kw,
        )
        self._ran = (request_kw != 0.0) | (shares_kvar != 0.0)
        return shares_kvar

    def _prices(self, situation: Situation) -> PlanPrices:
        if self._objectives.kind != "money":
            n_strings, n_steps = situation.limit_kw.size, situation.demand_kw.size
            return PlanPrices.energy(self._objectives, n_strings, n_steps)
        if situation.price_eur_mwh is None:
            raise InputError(NO_PRICES)
        return PlanPrices.money(
            self._objectives,
            self._terms,
            situation.demand_kw,
            situation.price_eur_mwh,
            self._wear_eur_ah(situation.state),
        )

    def _wear_eur_ah(self, state: State) -> NDArray[np.float64]:
        """Price of an Ah in each string [EUR/Ah], at its temperature."""
        by_string = self._wear.at(state).cycling_eur_ah(TYPICAL_DEPTH, state.temperature_c[:, None])
        return np.ascontiguousarray(by_string[:, 0])
