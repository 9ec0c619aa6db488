"""Branch and bound of the rigorous relaxation: more nodes prove more, and never more than is true."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest

import bess
from bess.control.split import power_split
from bess.control.split.result import SplitStatus

SYSTEM = bess.System.reference(n_strings=2)
LIMITS = (1, 10, 40, 160, 640)

CASES = {
    "nearly empty": (bess.State([0.02, 0.05], [30.0, 30.0]), [80.0, 60.0]),
    "below the switch and above": (bess.State([0.08, 0.13], [30.0, 35.0]), [100.0, 70.0]),
    "nearly full": (bess.State([0.93, 0.97], [30.0, 30.0]), [-90.0, -70.0]),
    "hot and nearly empty": (bess.State([0.06, 0.12], [50.0, 47.0]), [60.0, 80.0]),
    "like each other": (bess.State([0.06, 0.06], [30.0, 30.0]), [60.0, 60.0]),
    "full, then in discharge": (bess.State([0.99, 0.95], [30.0, 30.0]), [-80.0, 60.0]),
}


@cache
def splits(name: str) -> list[bess.Split]:
    """Splits with more and more nodes."""
    state, demand = CASES[name]
    return [bess.split_power(SYSTEM, state, demand, gap=1e-4, node_limit=limit) for limit in LIMITS]


@cache
def exhaustive(name: str, points: int = 161) -> list[tuple[float, float]]:
    """Objectives of every schedule on a grid of the first string's shares."""
    state, demand = CASES[name]
    lows = [max(0.0, abs(power) - 92.0) for power in demand]
    highs = [min(92.0, abs(power)) for power in demand]
    shares = [np.linspace(low, high, points) for low, high in zip(lows, highs, strict=True)]
    first = np.array(list(itertools.product(*shares)))
    both = np.stack([first, np.abs(demand) - first], axis=1) * np.sign(demand)
    roll = bess.rollout(SYSTEM, state, both)
    n, nominal = 2 * len(demand), 92.0
    shed = roll.availability_loss_kw.sum(axis=(1, 2)) / (n * nominal)
    inverter_kw, battery_kw = (x.mean() for x in SYSTEM.control_at(state).nominal_loss_kw())
    losses = (
        roll.derating_loss_kw / nominal
        + roll.inverter_loss_kw / inverter_kw
        + roll.battery_loss_kw / battery_kw
    )
    return list(zip(shed, losses.sum(axis=(1, 2)) / n, strict=True))


@pytest.mark.parametrize("name", CASES)
def test_bounds_rise_with_the_nodes_and_stay_below_every_schedule_of_a_grid(name):
    for group in (0, 1):
        bounds = [split.groups[group].bound for split in splits(name)]
        assert all(later >= earlier - 1e-6 * abs(earlier) for earlier, later in itertools.pairwise(bounds))
    first, second = (np.array(values) for values in zip(*exhaustive(name), strict=True))
    for split in splits(name):
        assert split.groups[0].bound <= first.min() + 1e-12
        allowed = first <= split.groups[0].objective
        if allowed.any():
            assert split.bound <= second[allowed].min() + 1e-12


@pytest.mark.parametrize("name", CASES)
def test_with_enough_nodes_the_bound_is_that_of_the_best_schedule(name):
    best = splits(name)[-1]
    assert all(group.gap <= 5e-3 for group in best.groups)
    assert best.nodes <= 2 * 2 * LIMITS[-1]


def test_nodes_raise_bounds_that_the_root_leaves_low():
    raised = sum(splits(name)[-1].bound > splits(name)[0].bound * 1.005 for name in CASES)
    assert raised >= 3


def test_nodes_lead_to_better_schedules(monkeypatch):
    """After a search that is cut short, a node's point, rounded, repaired and rolled out, sheds less."""
    monkeypatch.setattr(power_split, "ROLLOUTS", 1)
    monkeypatch.setattr(power_split, "MAX_SEARCHES", 1)
    certified, known, found = power_split.Certificate, [], []

    def recorded(*given):
        certificate = certified(*given)
        known.append(given[3].incumbent.objectives)
        found.append(certificate.incumbent.objectives)
        return certificate

    monkeypatch.setattr(power_split, "Certificate", recorded)
    state = bess.State([0.07669139, 0.18081985], [31.57424879, 28.88680946])
    bess.split_power(SYSTEM, state, [126.2069721544812, 123.80082615566097, 71.9142366013817], node_limit=200)
    assert np.all(found[0] < known[0] * 0.9995)


def test_the_default_budget_closes_what_its_root_leaves_open():
    state, demand = CASES["nearly empty"]
    root, default = (bess.split_power(SYSTEM, state, demand, gap=1e-2, node_limit=n) for n in (1, None))
    assert max(group.gap for group in root.groups) > 1e-2
    assert default.status is SplitStatus.OPTIMAL


def test_few_nodes_close_most_of_what_is_open_over_eight_steps():
    """The cuts that matter are known before a node is solved for them."""
    state, demand = bess.State([0.05, 0.12], [30.0, 33.0]), [70.0, 110.0, 40.0, 90.0, 60.0, 30.0, 80.0, 50.0]
    root, few = (bess.split_power(SYSTEM, state, demand, node_limit=n) for n in (1, 30))
    assert root.groups[0].gap > 0.1
    assert few.groups[0].gap < 0.1 * root.groups[0].gap


def test_strings_that_must_end_full_do_not_stall_the_solver():
    """Nearly every node was solved twice, and hundreds of them closed nothing."""
    state = bess.State([0.9394, 0.9665], [31.313, 35.853])
    split = bess.split_power(SYSTEM, state, [-122.79, -155.73, -68.74])
    assert split.nodes < 60
    assert max(group.gap for group in split.groups) < 5e-3


@pytest.mark.parametrize(("node_limit", "solves"), [(None, False), (1, False), (2, True)])
def test_only_a_limit_above_1_solves_relaxations_where_the_gap_is_small(node_limit, solves):
    state, demand = bess.State([0.5, 0.6], [30.0, 31.0]), [90.0, 70.0, 120.0]
    split = bess.split_power(SYSTEM, state, demand, node_limit=node_limit)
    assert (split.nodes > 0) == solves


def test_a_time_limit_ends_the_tree_with_a_valid_bound():
    state, demand = CASES["nearly empty"]
    split = bess.split_power(SYSTEM, state, demand, gap=1e-6, time_limit_s=1e-6)
    assert split.status is SplitStatus.TIME_LIMIT
    assert split.bound <= splits("nearly empty")[-1].objective
