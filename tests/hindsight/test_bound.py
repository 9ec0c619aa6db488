"""The bound of hindsight is below whatever the plant does, and close where that is known."""

import sys
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.dispatch import bundled_profile
from bess.simulation.hindsight import LossWeights, lower_bound
from bess.simulation.hindsight.safe_program import Program

sys.path.insert(0, str(Path(__file__).parent))
from cases import RULES, STEP_S, by_rule, demand, lost_kwh, split, state, system


def check(seed: int) -> None:
    random = np.random.default_rng(seed)
    n_steps, law = int(random.integers(4, 97)), ("table", "pi")[int(random.integers(0, 2))]
    plant = system(random)
    start = state(random, plant)
    limit_kw = np.tile(plant.nominal_kw, (n_steps, 1))
    if random.random() < 0.3:
        limit_kw[: n_steps // 2, int(random.integers(0, plant.n_strings))] *= random.choice([0.0, 0.3])
    ambient_c = random.uniform(-10.0, 45.0) + random.uniform(0.0, 10.0, n_steps)
    demand_kw = demand(random, plant, limit_kw)
    bound = lower_bound(plant, start, demand_kw, limit_kw, ambient_c, step_s=STEP_S, law=law)

    def truth() -> bess.Plant:
        return bess.Plant(plant, start, derating_law=law)

    found = [
        lost_kwh(truth().run(split(random, demand_kw, limit_kw), STEP_S, ambient_c=ambient_c))
        for _ in range(3)
    ]
    found += [by_rule(rule, truth(), demand_kw, limit_kw, ambient_c) for rule in RULES]
    assert bound <= min(found) + 1e-6, f"seed {seed}: {bound} kWh against {min(found)} kWh"
    assert bound >= -1e-6


@pytest.mark.parametrize("seed", range(10))
def test_no_split_of_any_demand_on_any_plant_loses_less_than_the_bound(seed: int) -> None:
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 2000, 50))
def test_no_split_loses_less_than_the_bound_in_a_thousand_cases(first: int) -> None:
    for seed in range(first, first + 50):
        check(seed)


@pytest.mark.parametrize("seed", range(8))
def test_where_there_is_nothing_to_choose_the_bound_is_what_the_plant_loses(seed: int) -> None:
    """One string: its only schedule is the demand, so every coefficient is held to its own."""
    random = np.random.default_rng(seed)
    plant = bess.System.reference(1)
    start = bess.State([random.uniform(0.0, 1.0)], [random.uniform(20.0, 40.0)])
    limit_kw, ambient_c = np.full((96, 1), 92.0), np.full(96, random.uniform(10.0, 35.0))
    demand_kw = demand(random, plant, limit_kw)
    lost = lost_kwh(bess.Plant(plant, start).run(demand_kw[:, None], STEP_S, ambient_c=ambient_c))
    bound = lower_bound(plant, start, demand_kw, limit_kw, ambient_c, step_s=STEP_S)
    assert 0.94 * lost <= bound <= lost


def test_seven_days_of_two_cycles_lose_six_hundred_and_thirty_seven_kilowatt_hours_at_least() -> None:
    """The best schedule known loses 706 kWh. One band of temperature proved 621, any number on 630."""
    plant, demand_kw = bess.System.reference(2), np.tile(bundled_profile("two-cycle-48h"), 4)[:672]
    bound = lower_bound(
        plant,
        plant.initial_state(),
        demand_kw,
        np.full((672, 2), 92.0),
        np.full(672, 25.0),
        step_s=STEP_S,
    )
    assert 637.0 < bound < 707.0


def test_fine_levels_give_the_higher_bound() -> None:
    plant, demand_kw = bess.load_system("unequal-4"), 2.0 * bundled_profile("two-cycle-48h")[:48]
    fine, coarse = (
        lower_bound(
            plant,
            plant.initial_state(),
            demand_kw,
            np.full((48, 4), 92.0),
            np.full(48, 25.0),
            step_s=STEP_S,
            fine=fine,
        )
        for fine in (True, False)
    )
    assert coarse < fine


def test_standby_of_idle_inverters_is_lost_for_certain() -> None:
    document = dict(bess.System.reference(2).document)
    document["inverter"] = {**document["inverter"], "off_loss": 0.005}
    plant = bess.System(document)
    idle = np.zeros(8)
    bound = lower_bound(
        plant, plant.initial_state(), idle, np.full((8, 2), 92.0), np.full(8, 25.0), step_s=STEP_S
    )
    assert bound == pytest.approx(2 * 92.0 * 0.005 * 2.0)


def test_other_worths_are_bounded_as_well() -> None:
    """Where only what is undelivered counts, and in one step only, that is what is bounded."""
    plant = bess.System.reference(2)
    start = bess.State([0.02, 0.05], [25.0, 25.0])
    demand_kw, limit_kw, ambient_c = np.full(8, 120.0), np.full((8, 2), 92.0), np.full(8, 25.0)
    worth = LossWeights(np.array([0.0] * 7 + [2.0]), np.zeros(8), np.zeros(8))
    bound = lower_bound(plant, start, demand_kw, limit_kw, ambient_c, step_s=STEP_S, worth=worth)
    random = np.random.default_rng(1)
    least = np.inf
    for _ in range(10):
        flows = bess.Plant(plant, start).run(split(random, demand_kw, limit_kw), STEP_S)
        shed = (flows.availability_loss_kw + flows.derating_loss_kw).sum(axis=1)
        least = min(least, 2.0 * float(shed[-1]) * 0.25)
    assert 0.0 < bound <= least


def test_the_bound_of_a_program_holds_however_badly_it_was_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a + b <= 1, a <= 0.6, b <= 3 the least -2 a - b is -1.6, and of (2 d)^2 <= c g, g <= 1 the least
    c - 4 d is -1; wrong multipliers only give less."""

    def program() -> Program:
        built = Program()
        a = built.add(1, upper=0.6, cost=-2.0)
        b = built.add(1, upper=3.0, cost=-1.0)
        built.at_most(np.ones(1), (a, 1.0), (b, 1.0))
        c, d, g = (
            built.add(1, upper=9.0, cost=1.0),
            built.add((1, 1), upper=2.0, cost=-4.0),
            built.add(1, upper=1.0),
        )
        built.at_most_product((d, 2.0), (c, 1.0), (g, 0.5), (g, 0.5))
        return built

    assert program().lower_bound() == pytest.approx(-2.6, abs=1e-5)
    for wrong in (0.0, 0.7, 1.3, 5.0, -4.0, np.nan):
        answer = type("Answer", (), {"z": [wrong] * 14})
        solver = type("Solver", (), {"solve": lambda self, answer=answer: answer()})
        monkeypatch.setattr("clarabel.DefaultSolver", lambda *_, solver=solver: solver())
        assert program().lower_bound() <= -2.6


@pytest.mark.parametrize(
    "battery", [{"hysteresis_heat": True}, {"entropy": {"soc": [0.0, 1.0], "du_dt_mv_k": [0.1, 0.1]}}]
)
def test_heat_beyond_the_ohmic_one_is_refused_because_it_lessens_resistance(
    battery: dict[str, object],
) -> None:
    document = bess.System.reference(1).document
    document["battery"] = document["battery"] | battery
    plant = bess.System(document)
    limit_kw, ambient_c = np.full((4, 1), 92.0), np.full(4, 25.0)
    with pytest.raises(bess.InputError, match="the lower bound supports ohmic heat only"):
        lower_bound(plant, plant.initial_state(), np.full(4, 30.0), limit_kw, ambient_c, step_s=STEP_S)
