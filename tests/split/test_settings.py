"""One owner for each setting: what a study, Python and the compiled split are told is the same."""

import numpy as np
import pytest

import bess
from bess.control.policies import PolicySection, Settings, build_policy
from bess.control.split.settings import SplitSettings

SYSTEM = bess.System.reference(n_strings=2)
STATE = bess.State([0.5, 0.4], [25.0, 30.0])


def test_defaults_are_the_same_from_a_study_from_python_and_for_a_policy():
    defaults = SplitSettings()
    study = bess.load_study("case1").policy
    assert {name: getattr(study, name) for name in SplitSettings.model_fields} == dict(defaults)
    assert bess.PowerSplit(SYSTEM, 2).settings == defaults
    assert Settings().policy == PolicySection(**dict(defaults))
    assert defaults.objectives == bess.Objectives() == bess.Objectives.paper()


@pytest.mark.parametrize(
    ("limits", "node_limit"), [({}, 1), ({"node_limit": 30}, 30), ({"time_limit_s": 2.0}, None)]
)
def test_a_closed_loop_solves_the_roots_only_unless_a_limit_is_set(limits, node_limit):
    splitter = build_policy("mpc", SYSTEM, Settings(0.25, 2, PolicySection(**limits)))._splitter
    assert splitter.settings.node_limit == node_limit
    if not limits:
        split = splitter(bess.State([0.02, 0.05], [30.0, 30.0]), [80.0, 60.0])
        assert max(group.gap for group in split.groups) > 0.03
        assert 0 < split.nodes <= 2 * len(split.groups)


def test_every_setting_of_a_split_reaches_it_from_a_study():
    values = {
        "policy.gap": 0.02,
        "policy.node_limit": 7,
        "policy.time_limit_s": 3.0,
        "policy.objectives.normalisation": "payoff",
        "policy.objectives.derating.priority": 2,
        "policy.objectives.inverter.abs_tol": 1e-3,
        "policy.objectives.battery.rel_tol": 1e-2,
    }
    study = bess.load_study("case1", values)
    settings = build_policy("mpc", SYSTEM, Settings(0.25, 2, study.policy))._splitter.settings
    assert (settings.gap, settings.node_limit, settings.time_limit_s) == (0.02, 7, 3.0)
    goals = settings.objectives
    assert goals == bess.Objectives(
        normalisation="payoff",
        derating=bess.Objective(priority=2),
        inverter=bess.Objective(abs_tol=1e-3),
        battery=bess.Objective(rel_tol=1e-2),
    )
    assert goals.groups == ((0, 1), (2, 3))


@pytest.mark.parametrize("given", [1.0, {"weight": 1.0}, bess.Objective(1.0), bess.Objective(abs_tol=1e-3)])
def test_a_weight_or_a_tolerance_does_not_change_the_priority(given):
    assert bess.Objectives(availability=given).availability.priority == 2
    assert bess.Objectives(derating=given).derating.priority == 1


def test_a_weight_set_in_a_study_does_not_change_the_priority():
    study = bess.load_study("case1", {"policy.objectives.availability.weight": 1})
    assert study.policy.objectives == bess.Objectives()


def test_a_resolved_study_gives_the_same_objectives_again(tmp_path):
    for kind in ("paper", "energy"):
        study = bess.load_study("case1", {"policy.objectives.kind": kind, "policy.objectives.battery": 0.5})
        path = tmp_path / f"{kind}.toml"
        path.write_text(study.to_toml())
        assert bess.load_study(path).policy == study.policy


def test_energy_objectives_are_kwh_of_shortfall_and_losses_in_one_sum():
    for shortfall in (1.0, 3.0):
        goals = bess.Objectives.energy(shortfall=shortfall)
        split = bess.PowerSplit(SYSTEM, 3, goals, dt_h=0.5)(STATE, [60.0, 120.0, 184.0])
        roll = split.rollout
        undelivered = roll.availability_loss_kw + roll.derating_loss_kw
        lost_kwh = 0.5 * (shortfall * undelivered + roll.inverter_loss_kw + roll.battery_loss_kw).sum()
        assert len(split.groups) == 1
        assert split.objective == pytest.approx(lost_kwh, rel=1e-12)
        assert 0.9 * split.objective <= split.bound <= split.objective


def test_energy_objectives_find_what_exhaustive_search_finds():
    # One step on hot strings, where a share decides between derating and losses.
    state, demand = bess.State([0.5, 0.5], [47.0, 40.0]), 100.0
    first = np.linspace(8.0, 92.0, 2001)
    roll = bess.rollout(SYSTEM, state, np.stack([first, demand - first], axis=1)[:, :, None])
    cost = 0.25 * (
        3.0 * (roll.availability_loss_kw + roll.derating_loss_kw)
        + roll.inverter_loss_kw
        + roll.battery_loss_kw
    ).sum(axis=(1, 2))
    split = bess.split_power(SYSTEM, state, [demand], bess.Objectives.energy())
    assert split.bound <= cost.min() * (1.0 + 1e-9)
    assert split.objective <= cost.min() * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"policy.objectives.kind": "profit"}, "policy.objectives.kind = 'profit'"),
        ({"policy.objectives.shortfall": 2.0}, 'shortfall is for kind = "energy"'),
        ({"policy.objectives.battery.priority": 1.5}, "battery.priority = 1.5: must be a whole number"),
        ({"policy.node_limit": 0}, "policy.node_limit = 0"),
        ({"policy.time_limit_s": -1.0}, "policy.time_limit_s = -1.0"),
        ({"policy.objectives.normalisation": "none"}, "normalisation"),
    ],
)
def test_a_bad_setting_is_refused_with_its_key(values, message):
    with pytest.raises(bess.InputError) as caught:
        bess.load_study("case1", values)
    assert message in str(caught.value)
