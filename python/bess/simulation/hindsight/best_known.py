"""``bess.hindsight``: undelivered energy and losses of a run and its best known schedule; lower bound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from bess.arrays import Array
from bess.control.objectives import Objectives
from bess.control.planning import PlanPrices
from bess.control.planning.planner import MAX_STEPS
from bess.control.planning.power_plan import planner_of_known_demand
from bess.control.policies import PolicyInput
from bess.control.policies.adapters import Function, FunctionPolicy
from bess.control.wear import WearPrices
from bess.display import amount
from bess.errors import InputError
from bess.simulation.analysis.kpis import kpis
from bess.simulation.analysis.services import is_reserve, is_site, unprovable
from bess.simulation.hindsight.bound import LossWeights, lower_bound
from bess.simulation.hindsight.replay import Replay
from bess.simulation.record.result import Result, record_of
from bess.system import System
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import xarray as xr

Effort = Literal["quick", "thorough"]

_SEARCH: dict[Effort, tuple[float, int]] = {"quick": (7 * 24.0, 20), "thorough": (14 * 24.0, 100)}
"""Length of a plan [h], at most the run, and iterations of its shadow prices."""
_FOLLOWED = 6.0 / 7.0
"""Share of a plan that is followed before the next plan starts."""


@dataclass(frozen=True)
class Hindsight:
    """Undelivered energy and losses of a run, compared with the best known schedule and a lower bound.

    The measure in kWh is undelivered energy (availability and derating loss) plus losses of inverters and
    batteries. Unmet demand, above the power in service, is excluded. The measure in EUR, for runs that trade,
    is the difference from the net income of a plant without losses, wear, starts and auxiliaries.

    Attributes
    ----------
    lost_kwh, lost_eur : float
        Values of this run. EUR is None without prices, and for services, which are not paid per kWh.
    found_kwh, found_eur : float
        Values of the best known schedule, simulated with the plant. The schedules in kWh and EUR may differ.
    bound_kwh, bound_eur : float
        Lower bounds over all splits of this demand.
    found_by : str
        Origin of the schedule of ``found_kwh``: a policy, or ``"this run"``.
    """

    lost_kwh: float
    found_kwh: float
    bound_kwh: float
    found_by: str
    lost_eur: float | None = None
    found_eur: float | None = None
    bound_eur: float | None = None

    def __str__(self) -> str:
        """One sentence."""
        parts = 10.0 if self.bound_kwh < 100.0 else 1.0
        bound_kwh = math.floor(parts * max(self.bound_kwh, 0.0)) / parts
        text = (
            f"Undelivered energy and losses: {amount(self.lost_kwh)} kWh; best known: "
            f"{amount(self.found_kwh)} kWh ({self.found_by}); lower bound: {amount(bound_kwh)} kWh."
        )
        if self.lost_eur is None or self.found_eur is None or self.bound_eur is None:
            return text
        return (
            f"{text} Net income below a lossless plant: {self.lost_eur:,.2f} EUR; "
            f"best known: {self.found_eur:,.2f} EUR; "
            f"lower bound: {math.floor(100.0 * self.bound_eur + 1e-6) / 100.0:,.2f} EUR."
        )


def hindsight(result: Result | xr.Dataset, effort: Effort = "quick") -> Hindsight:
    """Compare a finished run with the best known schedule and a lower bound over all splits.

    The best known schedule is the best of all rules, of a plan with perfect forecast, and of the run itself,
    each simulated with the plant. The page on hindsight of the documentation discusses the bound.

    Parameters
    ----------
    result
        Result of :func:`bess.run`, or its record.
    effort
        "quick": seconds for a week; "thorough": a longer search, and a tighter bound for plants with many
        kinds of strings.

    Returns
    -------
    Hindsight

    Raises
    ------
    InputError
        The record does not contain its study or the start of its run, or, without a result, the run had
        another system than its study names.
    """
    if effort not in ("quick", "thorough"):
        raise InputError(f'hindsight: effort = {effort!r}: must be "quick" or "thorough"')
    record = record_of(result, "hindsight")
    return benchmark(Replay.of(record, getattr(result, "system", None)), effort)


def benchmark(replay: Replay, effort: Effort = "quick") -> Hindsight:
    """As :func:`hindsight`, for a replay, which may have simulated the rules already."""
    record = replay.record
    if reason := unprovable(record, replay.system):
        raise InputError(f"hindsight: {reason}")
    inputs = replay.inputs
    bound = partial(
        lower_bound,
        replay.system,
        replay.system.initial_state(),
        replay.served_kw,
        inputs.limit_kw,
        inputs.ambient_c,
        step_s=inputs.grid.step_s,
        law=replay.study.run.derating_law,
        fine=True if effort == "thorough" else None,
    )
    bound_kwh = bound()
    dt_h = inputs.grid.dt_h
    hours, passes = _SEARCH[effort]
    steps = max(1, min(round(hours / dt_h), inputs.grid.n_steps, MAX_STEPS))
    plans = FunctionPolicy(_plans(replay.system, steps, dt_h, passes))
    figures = {"this run": kpis(record), **replay.rules}
    name = f"a plan of {steps * dt_h:g} h"
    figures[name] = kpis(replay.under(plans, name, steps))
    found_by = min(figures, key=lambda name: figures[name]["lost_kwh"])
    money = {}
    price = inputs.price_eur_mwh
    if price is not None and not (is_reserve(record) or is_site(record)):
        ideal_eur, wear_eur, worth = _value(replay, price)
        money = {
            "lost_eur": ideal_eur - figures["this run"]["net_eur"],
            "found_eur": ideal_eur - max(each["net_eur"] for each in figures.values()),
            "bound_eur": wear_eur + bound(worth=worth),
        }
    return Hindsight(
        lost_kwh=figures["this run"]["lost_kwh"],
        found_kwh=figures[found_by]["lost_kwh"],
        bound_kwh=bound_kwh,
        found_by=found_by,
        **money,
    )


def _plans(system: System, n_steps: int, dt_h: float, price_passes: int) -> Function:
    """Return a policy: plans of a known demand without a warm start, each followed for most of its length."""
    make = partial(planner_of_known_demand, system, n_steps, dt_h, price_passes, proof_cells=None)
    goals = Objectives.energy(shortfall=1.0, start_kwh=0.0)
    prices = PlanPrices.energy(goals, system.n_strings, n_steps)
    requests_kw: list[Array] = []

    def next_request_kw(inputs: PolicyInput) -> Array:
        if not requests_kw:
            known = {"ambient_c": inputs.ambient_c, "limit_kw": inputs.expected_limit_kw}
            plan = make()(inputs.state, inputs.demand_kw, prices, **known)
            requests_kw.extend(plan.request_kw.T[: max(1, int(_FOLLOWED * n_steps))])
        return requests_kw.pop(0).copy()

    return next_request_kw


def _value(replay: Replay, price: Array) -> tuple[float, float, LossWeights]:
    """Return the net income of a plant that delivers all demand within its power without losses [EUR].

    Also its wear cost at a price per MWh discharged, and the costs of any difference from this delivery, by
    the settlement terms; without starts and the wear of cell models, which never reduce the cost.
    """
    terms, served_kw = replay.study.settlement, replay.served_kw
    asked_kw: Array = replay.record["demand_kw"].values
    mwh_per_kw = replay.inputs.grid.dt_h / KWH_PER_MWH
    discharged = np.maximum(served_kw, 0.0) * mwh_per_kw
    charged = np.maximum(-served_kw, 0.0) * mwh_per_kw
    unmet = (np.abs(asked_kw) - np.abs(served_kw)) * mwh_per_kw
    sells, buys = terms.discharge_price_eur_mwh(price), terms.charge_price_eur_mwh(price)
    short = terms.shortfall_price_eur_mwh(price)
    # A string without a throughput price could deliver all demand.
    wear = float(WearPrices.of(replay.system).eur_per_kwh_discharged.min()) * KWH_PER_MWH
    ideal_eur = float((discharged * sells - charged * buys - unmet * short).sum())
    missing = short + np.where(served_kw > 0.0, sells - wear, -buys)
    worth = LossWeights(missing / KWH_PER_MWH, np.zeros(price.size), buys / KWH_PER_MWH)
    return ideal_eur, float(discharged.sum()) * wear, worth
