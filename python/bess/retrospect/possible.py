"""``bess.hindsight``: what a run lost, what was possible, and what is proven impossible."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bess.analysis.kpis import kpis
from bess.analysis.services import is_reserve, is_site
from bess.errors import InputError
from bess.foresight.planner import ROLLOUTS
from bess.numbers import Array
from bess.policies import POLICIES, Policy, Settings, build_policy
from bess.policies.rule import RulePolicy
from bess.retrospect.bound import Worth, lower_bound
from bess.retrospect.replay import Replay
from bess.split.objectives import Objectives
from bess.split.settings import SplitSettings
from bess.wear import WearPrices

if TYPE_CHECKING:
    import xarray as xr

    from bess.record import Result

Effort = Literal["quick", "thorough"]

_KWH_PER_MWH = 1000.0
_SEARCH: dict[Effort, tuple[float, int]] = {"quick": (24.0, ROLLOUTS), "thorough": (48.0, 10 * ROLLOUTS)}
"""Hours that the plan looks ahead, and roll-outs for each of its steps."""


@dataclass(frozen=True)
class Hindsight:
    """What a run lost, beside the least that was found and the least that is not proven impossible.

    Lost is what was asked for and not delivered (availability and derating), and what inverters and cells
    lost, in kWh; demand above the power in service (unmet) is nobody's loss. In EUR, for runs that trade, it
    is what is missing to the net income of a plant without losses, wear, starts and auxiliaries.

    Attributes
    ----------
    lost_kwh, lost_eur : float
        Of this run; EUR is None without prices, and for services, which are not paid for each kWh.
    found_kwh, found_eur : float
        Of the best schedule found, run through the plant. Each is the best of its own kind.
    bound_kwh, bound_eur : float
        No split of this demand loses less.
    found_by : str
        Where the schedule of ``found_kwh`` comes from: a policy, or ``"this run"``.
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
        text = (
            f"Lost {self.lost_kwh:,.0f} kWh; {self.found_kwh:,.0f} kWh was possible ({self.found_by}); "
            f"less than {math.floor(max(self.bound_kwh, 0.0)):,d} kWh is proven impossible."
        )
        if self.lost_eur is None or self.found_eur is None or self.bound_eur is None:
            return text
        return (
            f"{text} In money, wear and auxiliaries included: lost {self.lost_eur:,.2f} EUR; "
            f"{self.found_eur:,.2f} EUR was possible; "
            f"less than {math.floor(100.0 * self.bound_eur + 1e-6) / 100.0:,.2f} EUR is proven impossible."
        )


def hindsight(result: Result | xr.Dataset, effort: Effort = "quick") -> Hindsight:
    """Tell what a finished run lost, what was possible, and what no split could have reached.

    Possible is the best of schedules run through the plant: those of every rule, of a plan that is told all
    demand, and the run itself. Proven is a lower bound over all splits; the page on hindsight of the
    documentation says what it is worth.

    Parameters
    ----------
    result
        Result of :func:`bess.run`, or its record.
    effort
        "quick": seconds for a week; "thorough": a longer search, and a closer bound for plants of many kinds
        of strings.

    Returns
    -------
    Hindsight

    Raises
    ------
    InputError
        The record does not say what study it is of.
    """
    if effort not in ("quick", "thorough"):
        raise InputError(f'hindsight: effort = {effort!r}: must be "quick" or "thorough"')
    record: Any = getattr(result, "dataset", result)
    if not hasattr(record, "data_vars"):
        raise InputError(
            "hindsight needs what bess.run or bess.open_result gives, a result or its dataset, not "
            f"{type(result).__name__}"
        )
    replay = Replay.of(record)
    fine = True if effort == "thorough" else None
    # First, because it refuses what nothing can be proven about.
    bound_kwh = _bound(replay, None, fine)
    figures = {"this run": kpis(record)}
    for name, policy, horizon_steps in _others(replay, effort):
        figures[name] = kpis(replay.under(policy, horizon_steps))
    found_by = min(figures, key=lambda name: figures[name]["lost_kwh"])
    money = {}
    if replay.inputs.price_eur_mwh is not None and not (is_reserve(record) or is_site(record)):
        value = _Value(replay)
        money = {
            "lost_eur": value.ideal_eur - figures["this run"]["net_eur"],
            "found_eur": value.ideal_eur - max(each["net_eur"] for each in figures.values()),
            "bound_eur": value.wear_eur + _bound(replay, value.worth, fine),
        }
    return Hindsight(
        lost_kwh=figures["this run"]["lost_kwh"],
        found_kwh=figures[found_by]["lost_kwh"],
        bound_kwh=bound_kwh,
        found_by=found_by,
        **money,
    )


def _others(replay: Replay, effort: Effort) -> Iterator[tuple[str, Policy, int]]:
    """Every rule, and the plan that minimises what is lost, told all that will be asked."""
    dt_h = replay.inputs.grid.dt_h
    for name in POLICIES:
        if name not in ("mpc", "distilled"):
            policy = build_policy(name, replay.system, Settings(dt_h=dt_h, horizon_steps=1))
            if isinstance(policy, RulePolicy):
                yield name, policy, 1
    hours, rollouts = _SEARCH[effort]
    steps = max(1, round(hours / dt_h))
    goals = SplitSettings(objectives=Objectives.energy(shortfall=1.0))
    settings = Settings(dt_h=dt_h, horizon_steps=steps, split=goals, plans=True, rollouts=rollouts)
    yield f"a plan of {hours:g} h", build_policy("mpc", replay.system, settings), steps


def _bound(replay: Replay, worth: Worth | None, fine: bool | None) -> float:
    inputs = replay.inputs
    return lower_bound(
        replay.system,
        replay.system.initial_state(),
        replay.served_kw,
        inputs.limit_kw,
        inputs.ambient_c,
        step_s=inputs.grid.step_s,
        law=replay.study.run.derating_law,
        worth=worth,
        fine=fine,
    )


class _Value:
    """What energy is worth in each step of a run with prices, by the terms of its ledger.

    Attributes
    ----------
    ideal_eur : float
        Net income of a plant that delivers all it is asked for within its power, at no loss.
    wear_eur : float
        What delivering all of it wears at a price for each MWh discharged.
    worth : Worth
        Cost of what is missing to that; wear by cell models and starts are left out, which are never income.
    """

    def __init__(self, replay: Replay) -> None:
        price: Array | None = replay.inputs.price_eur_mwh
        assert price is not None
        terms = replay.study.settlement.terms
        served_kw = replay.served_kw
        asked_kw: Array = replay.record["demand_kw"].values
        mwh_per_kw = replay.inputs.grid.dt_h / _KWH_PER_MWH
        discharged = np.maximum(served_kw, 0.0) * mwh_per_kw
        charged = np.maximum(-served_kw, 0.0) * mwh_per_kw
        unmet = (np.abs(asked_kw) - np.abs(served_kw)) * mwh_per_kw
        sells, buys = terms.discharge_price_eur_mwh(price), terms.charge_price_eur_mwh(price)
        short = terms.shortfall_price_eur_mwh(price)
        # A string without a price of throughput could deliver it all.
        wear = float(WearPrices.of(replay.system).eur_per_kwh_discharged.min()) * _KWH_PER_MWH
        self.ideal_eur = float((discharged * sells - charged * buys - unmet * short).sum())
        self.wear_eur = float(discharged.sum()) * wear
        missing = short + np.where(served_kw > 0.0, sells - wear, -buys)
        self.worth = Worth(missing / _KWH_PER_MWH, np.zeros(price.size), buys / _KWH_PER_MWH)
