"""Bounds that need no relaxation: step cuts under a limit on what is shed, and schedules without a choice."""

import numpy as np
import pytest
from mutations import PYTHON, RUST, applies

import bess
from bess.control.split import bounds, power_split
from bess.control.split.bounds import Certificate
from bess.control.split.relaxation.group import RelaxedGroup
from bess.control.split.result import SplitStatus
from bess.display import rounded

SYSTEM = bess.System.reference(n_strings=2)


@pytest.mark.parametrize("soc", [0.04, 0.5, 0.97])
def test_a_schedule_without_a_choice_is_optimal_without_a_solve(soc):
    state = bess.State([soc, soc], [30.0, 45.0])
    for demand, limit in (([-184.0, 184.0, 184.0], None), ([50.0, -92.0, 20.0], [0.0, 92.0])):
        split = bess.PowerSplit(SYSTEM, 3)(state, demand, limit_kw=limit)
        assert (split.status, split.nodes, split.gap) == (SplitStatus.OPTIMAL, 0, 0.0)
        np.testing.assert_allclose(split.request_kw.sum(axis=0), demand, rtol=1e-12)


def test_full_power_in_some_steps_leaves_the_bound_tight():
    split = bess.PowerSplit(SYSTEM, 4)(bess.State([0.5, 0.5], [30.0, 31.0]), [184.0, 97.0, -184.0, -184.0])
    assert split.search_gap <= 1e-4
    assert split.gap <= 1e-3


def test_a_kwh_counts_the_same_in_whichever_string_it_is_lost():
    document = bess.System.reference().document
    document["system"]["n_strings"] = 2
    document["string"] = [{}, {"inverter": {"nominal_kw": 46.0}}]
    system = bess.System(document)
    for soc in ([0.001, 0.6], [0.6, 0.001]):
        split = bess.PowerSplit(system, 1)(bess.State(soc, [30.0, 30.0]), [138.0])
        shed_kw = split.availability_loss_kw
        assert shed_kw > 40.0
        assert split.groups[0].objective == pytest.approx(shed_kw / 138.0, rel=1e-9)


def test_a_node_that_clarabel_almost_solves_still_gives_a_bound():
    # Empty strings asked to turn around every quarter hour: primal residuals stay above Clarabel's tolerance.
    demand = np.array([-184.0, 165.6] * 4)
    splitter = bess.PowerSplit(SYSTEM, 8, node_limit=1)
    splitter.warm_start = np.stack([demand / 2.0, demand / 2.0])
    split = splitter(bess.State([0.0, 1e-5], [32.1, 31.5]), demand)
    assert not split.fallback
    assert split.search_gap <= 1e-3
    assert split.bound <= split.objective


def test_a_plant_and_a_horizon_too_large_for_the_relaxation_have_an_answer_and_a_bound_all_the_same():
    system = bess.System.reference(n_strings=5)
    hours = np.arange(96) // 4
    demand = np.where(hours % 2 == 0, 1.0, -1.0) * (150.0 + 20.0 * (hours % 7))
    split = bess.PowerSplit(system, 96)(bess.State(np.linspace(0.3, 0.7, 5), np.full(5, 30.0)), demand)
    np.testing.assert_allclose(split.request_kw.sum(axis=0), demand, rtol=1e-9)
    assert split.nodes == 0
    assert not split.fallback
    assert 0.5 * split.objective < split.bound <= split.objective


def test_a_problem_too_large_to_relax_says_so_and_not_that_a_limit_was_reached(monkeypatch):
    monkeypatch.setattr(bounds, "MAX_RELAXATION", 5)
    split = bess.PowerSplit(SYSTEM, 3)(bess.State([0.05, 0.08], [30.0, 30.0]), [90.0, 80.0, 150.0])
    assert (split.status, split.nodes) == (SplitStatus.TOO_LARGE, 0)
    assert "too large to relax" in split.statement
    assert not split.fallback


def test_a_status_says_optimal_only_where_the_rigorous_gap_is_within_the_gap_asked_for():
    splitters = [
        bess.PowerSplit(SYSTEM, 8, goals) for goals in (bess.Objectives(), bess.Objectives(inverter=0.0))
    ]
    seen = set()
    for seed in range(12):
        splitter = splitters[seed % 2]
        rng = np.random.default_rng(seed)
        splitter.warm_start = None
        state = bess.State(rng.uniform(0.4, 0.6, 2), rng.uniform(25.0, 40.0, 2))
        split = splitter(state, np.repeat([1.0, -1.0], 4) * rng.uniform(20.0, 150.0, 8))
        seen.add(split.status)
        tolerances = splitter.objectives.tolerances[0]
        proven = all(
            group.gap <= splitter.settings.gap or group.objective - group.bound <= abs_tol
            for group, abs_tol in zip(split.groups, tolerances, strict=True)
        )
        assert (split.status is SplitStatus.OPTIMAL) == proven
        assert f"{rounded(100.0 * max(group.gap for group in split.groups))} %" in split.statement
    assert {SplitStatus.OPTIMAL, SplitStatus.CONVEXIFIED_CLOSED} <= seen


def test_strings_at_their_largest_power_have_states_in_order_however_the_roots_round() -> None:
    """A cold string limited by its battery: its least heat was 1e-8 above its most, and ended in a panic."""
    system = bess.load_system("m5bat")
    soc = [0.5, 0.5, 0.5, 0.0, 0.0, 1.0, 1.0, 0.0, 0.98, 0.5]
    temperature_c = [
        *(
            -0.20780449869047857,
            38.78127737522396,
            8.789284958470386,
            -0.8788896917187383,
            -6.872871714404935,
        ),
        *(1.8888165770384067, 3.042312737202515, 26.5141014108819, 20.6706442596546, 55.09601697324054),
    ]
    split = bess.split_power(system, bess.State(soc, temperature_c), [7438.998897875603, 4857.425289472889])
    assert split.bound <= split.objective
    assert split.request_kw.sum(axis=0) + split.unmet_kw == pytest.approx(
        [7438.998897875603, 4857.425289472889]
    )


def test_relaxations_count_what_is_bounded_and_hold_earlier_groups_under_their_ceilings(monkeypatch):
    """A dearer cost or a lower ceiling would put the bound of a later group above what a split can reach."""
    objectives = bess.Objectives(
        availability={"priority": 3, "abs_tol": 1e-4}, derating={"priority": 2, "abs_tol": 1e-3}, inverter=0.0
    )
    asked, certified = [], {}

    def recorded(problem, control, constants, cost, ceilings, *rest, frozen=False):
        asked.append((not frozen, cost, list(ceilings)))
        return RelaxedGroup(problem, control, constants, cost, ceilings, *rest, frozen=frozen)

    def last(constants, problem, control, answer, costs, *rest):
        asked.clear()
        certified.update(groups=answer.groups, costs=costs)
        return Certificate(constants, problem, control, answer, costs, *rest)

    monkeypatch.setattr(bounds, "RelaxedGroup", recorded)
    monkeypatch.setattr(power_split, "Certificate", last)
    bess.PowerSplit(SYSTEM, 4, objectives, gap=1e-6)(bess.State([0.08, 0.3], [49.0, 40.0]), [150.0] * 4)
    groups, costs = certified["groups"], certified["costs"]
    assert not np.array_equal(costs.reported, costs.searched)
    later = set()
    for is_rigorous, cost, ceilings in asked:
        earlier = groups[: len(ceilings)]
        np.testing.assert_array_equal(cost, costs.reported if is_rigorous else costs.searched)
        assert ceilings == [g.ceiling if is_rigorous else g.search_ceiling for g in earlier]
        if any(g.ceiling > g.bound and g.search_ceiling > g.search_bound for g in earlier):
            later.add(is_rigorous)
    assert later == {True, False}


@pytest.mark.parametrize("mutation", PYTHON + RUST, ids=lambda mutation: mutation[0])
def test_the_list_of_mutations_follows_the_code(mutation):
    assert applies(mutation)
