"""Bounds from shadow prices: none is above a schedule within the ceilings of earlier groups, at any state."""

from __future__ import annotations

import numpy as np
import pytest
from control_cases import CORNERS, DT_H, differing

import bess
from bess.control.objectives import Costs
from bess.control.problem import SplitProblem
from bess.control.split.bounds import PRICED_SAMPLE
from bess.control.split.settings import ROLLOUTS

SCHEDULES = 60
FAR = 1e9
"""An objective of no schedule, which does not cut a bound off."""


@pytest.mark.parametrize(
    ("n_steps", "objectives"),
    [(1, "paper"), (16, "paper"), (24, "energy"), pytest.param(96, "paper", marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("corner", CORNERS)
def test_no_schedule_costs_less_than_its_bound(corner: str, n_steps: int, objectives: str) -> None:
    rng = np.random.default_rng((list(CORNERS).index(corner), n_steps))
    check(differing(2, rng) if n_steps == 16 else bess.System.reference(2), corner, n_steps, objectives, rng)


@pytest.mark.parametrize("corner", CORNERS)
def test_no_schedule_of_more_strings_than_the_price_sample_costs_less_than_its_bound(corner: str) -> None:
    rng = np.random.default_rng(list(CORNERS).index(corner))
    document = differing(2, rng).document
    document["string"] *= PRICED_SAMPLE // 2 + 4
    document["system"]["n_strings"] = len(document["string"])
    check(bess.System(document, name="two kinds"), corner, 3, "paper", rng)


def check(system: bess.System, corner: str, n_steps: int, objectives: str, rng: np.random.Generator) -> None:
    """No schedule around the best one, nor far from it, costs less than the bounds of its groups."""
    soc, temperature_c = (rng.uniform(*bounds, system.n_strings) for bounds in CORNERS[corner])
    window = [np.array([getattr(s.battery, n) for s in system.strings]) for n in ("soc_min", "soc_max")]
    sign = 1.0 if corner == "empty" else np.where(np.arange(n_steps) // 3 % 2, 1.0, -1.0)
    demand = sign * rng.uniform(0.05, 1.0, n_steps) * system.nominal_kw.sum()
    state = bess.State(np.clip(soc, *window), temperature_c)
    problem = SplitProblem.check(system, n_steps, DT_H, state, demand, rng.uniform(5.0, 45.0, n_steps), None)
    split = bess.PowerSplit(system, n_steps, bess.Objectives(kind=objectives))
    cost = split._costs.reported
    control = problem.control(Costs(cost, cost), *split.objectives.tolerances)
    best = np.abs(control.split(None, ROLLOUTS // 10).incumbent.request_kw)
    other = rng.random((SCHEDULES, *best.shape)) ** rng.choice([0.0, 1.0, 9.0], (SCHEDULES, 1, 1))
    wanted = best + rng.choice([0.0, 0.01, 1.0], (SCHEDULES, 1, 1)) * other * system.nominal_kw[:, None]
    wanted *= np.abs(problem.demand_kw) / np.maximum(wanted.sum(axis=1, keepdims=True), 1e-9)
    fits = (wanted <= system.nominal_kw[:, None] * (1.0 + 1e-9)).all(axis=(1, 2))
    requests = np.concatenate([best[None], wanted[fits]]) * np.sign(problem.demand_kw)
    costs = control.evaluate(requests)
    assert len(costs) > 10
    for ceiling in np.quantile(costs[:, 0], [0.0, 0.5]):
        ceilings = [float(ceiling)][: costs.shape[1] - 1]
        within = costs[costs[:, 0] <= ceiling] if ceilings else costs
        bound = control.priced_bound(np.array(ceilings), FAR, PRICED_SAMPLE)
        assert 0.0 <= bound <= within[:, -1].min() * (1.0 + 1e-12)
        # Near a known cost the prices are those of the relaxation.
        known = 1.5 * within[:, -1].min()
        assert control.priced_bound(np.array(ceilings), known, PRICED_SAMPLE) <= known / 1.5 * (1.0 + 1e-12)
    if costs.shape[1] > 1:
        assert control.priced_bound(np.array([]), FAR, PRICED_SAMPLE) <= costs[:, 0].min() + 1e-12


@pytest.mark.parametrize("n_strings", [2, 32, 256])
def test_a_horizon_of_a_day_has_a_bound_within_15_per_cent_and_many_strings_within_5(n_strings: int):
    n_steps = 96 if n_strings == 2 else 8
    rng = np.random.default_rng(n_strings)
    state = bess.State(rng.uniform(0.3, 0.7, n_strings), rng.uniform(15.0, 40.0, n_strings))
    sign = np.where(np.arange(n_steps) // 2 % 2, 1.0, -1.0)
    demand = sign * rng.uniform(0.1, 0.8, n_steps) * 92.0 * n_strings
    split = bess.split_power(bess.System.reference(n_strings), state, demand)
    assert split.groups[0].objective == 0.0
    assert split.gap < (0.15 if n_strings == 2 else 0.05)


def test_strings_of_too_many_kinds_have_the_bounds_of_single_steps() -> None:
    n_strings, n_steps = PRICED_SAMPLE + 1, 4
    system = bess.System.reference(n_strings)
    rng = np.random.default_rng(3)
    soc, temperature_c = rng.uniform(0.03, 0.2, n_strings), rng.uniform(15.0, 40.0, n_strings)
    demand = np.full(n_steps, 60.0 * n_strings)
    split = bess.PowerSplit(system, n_steps)
    for n_kinds in (1, n_strings):
        state = bess.State(soc, temperature_c, np.linspace(0.8, 1.0, n_kinds)[np.arange(n_strings) % n_kinds])
        control = SplitProblem.check(system, n_steps, DT_H, state, demand, None, None).control(
            split._costs, *split.objectives.tolerances
        )
        assert control.n_kinds() == n_kinds
        steps = control.split(None, ROLLOUTS, gap=split.settings.gap).groups[0]
        assert steps.bound < 0.9 * steps.objective
        split.warm_start = None
        bound = split(state, demand).groups[0].bound
        assert bound > steps.bound if n_kinds == 1 else bound == steps.bound
