"""What holds for every decision, whatever the weights."""

import numpy as np
import pytest
from explicit_cases import SYSTEMS, cases, controller, random_weights

import bess
from bess.control.explicit import N_WEIGHTS


@pytest.mark.parametrize("name", SYSTEMS)
def test_set_points_sum_to_the_demand_within_the_limits_in_its_direction(name: str) -> None:
    system, random = SYSTEMS[name](), np.random.default_rng(7)
    for round_ in range(10):
        law = controller(system, random_weights(random))
        for case in cases(system, 50, 100 + round_):
            request_kw = law.split(case.state, case.ahead_kw, case.limit_kw)
            assert abs(request_kw.sum() - case.ahead_kw[0]) <= 1e-9 * max(1.0, case.limit_kw.sum())
            assert (np.abs(request_kw) <= case.limit_kw).all()
            assert (request_kw * case.ahead_kw[0] >= 0.0).all()


@pytest.mark.parametrize("name", SYSTEMS)
def test_without_prices_of_the_state_what_can_be_delivered_is_delivered(name: str) -> None:
    system = SYSTEMS[name]()
    law = controller(system, np.zeros(N_WEIGHTS))
    checked = 0
    for case in cases(system, 300, 8):
        demand_kw = case.ahead_kw[0]
        state = bess.State(case.state.soc, np.minimum(case.state.temperature_c, 40.0))
        max_kw = np.minimum(system.control_at(state).deliverable_kw(
            state.soc, state.temperature_c, bool(demand_kw > 0.0), 0.25), case.limit_kw)  # fmt: skip
        if max_kw.sum() < abs(demand_kw):
            continue
        request_kw = law.split(state, case.ahead_kw, case.limit_kw)
        asked = bess.rollout(system, state, request_kw[:, None])
        # Shed is what costs more to deliver than three times itself: near the root limit of discharge.
        lost_kw = asked.availability_loss_kw.sum()
        assert lost_kw <= 1e-6 or lost_kw < 0.02 * abs(demand_kw), (case, request_kw)
        checked += 1
    assert checked > 50


def test_an_empty_string_is_not_asked_for_a_charge_below_its_inverter_loss() -> None:
    """Such a charge discharges the cells, so the plant would shed it."""
    system = SYSTEMS["mixed-4"]()
    law = controller(system, np.zeros(N_WEIGHTS))
    state = bess.State([0.0, 1.0, 0.155, 0.0], np.full(4, 25.0))
    request_kw = law.split(state, np.full(24, -0.93), np.array([36.8, 60.0, 100.0, 0.0]))
    np.testing.assert_allclose(request_kw, [0.0, 0.0, -0.93, 0.0])


@pytest.mark.parametrize(("name", "above"), [("two", 0.002), ("unequal-4", 0.002), ("mixed-4", 0.25)])
def test_without_prices_of_the_state_no_random_split_loses_much_less(name: str, above: float) -> None:
    """Parabolas are close to convex curves of loss, and not so close to that of an inverter of
    ``mixed-4``."""
    system, random = SYSTEMS[name](), np.random.default_rng(9)
    law = controller(system, np.zeros(N_WEIGHTS))
    for _ in range(25):
        state = bess.State(
            random.uniform(0.2, 0.8, system.n_strings), random.uniform(15.0, 40.0, system.n_strings)
        )
        demand_kw = random.uniform(0.1, 0.95) * system.nominal_kw.sum() * random.choice([-1.0, 1.0])
        ahead_kw = np.full(24, demand_kw)
        own = law.split(state, ahead_kw, system.nominal_kw)
        sets = random.random((400, system.n_strings)) < 0.6
        shares = sets * random.dirichlet(np.full(system.n_strings, 4.0), 400) + 1e-12
        tried = shares / shares.sum(axis=1, keepdims=True) * demand_kw
        fits = (np.abs(tried) <= system.nominal_kw).all(axis=1)
        tried = np.where(np.abs(tried) < 1e-6, 0.0, tried)[fits]
        batch = np.concatenate([own[None], tried])[:, :, None]
        out = bess.rollout(system, state, batch, model="midpoint")
        missing = out.availability_loss_kw + out.derating_loss_kw
        costs = (3.0 * missing + out.inverter_loss_kw + out.battery_loss_kw).sum(axis=(1, 2))
        assert costs[0] <= (1.0 + above) * costs.min()


def test_like_strings_are_interchangeable() -> None:
    system, random = bess.System.reference(4), np.random.default_rng(10)
    law = controller(system, random_weights(random))
    for case in cases(system, 50, 11):
        order = random.permutation(4)
        own = case.state
        measured = (own.soc, own.temperature_c, own.soh_capacity, own.soh_resistance)
        state = bess.State(*(values[order] for values in measured))
        there = law.split(case.state, case.ahead_kw, case.limit_kw)
        back = law.split(state, case.ahead_kw, case.limit_kw[order])
        if (
            np.unique(case.state.soc).size == 4
        ):  # which of two equally low strings is the lowest is a convention
            np.testing.assert_allclose(back, there[order], rtol=1e-7, atol=1e-7 * case.limit_kw.sum())


def test_the_features_of_a_forecast_are_what_the_page_says() -> None:
    law = controller(bess.System.reference(2), steps=48)
    ahead_kw = np.concatenate([np.full(8, 40.0), np.full(20, -60.0), np.full(20, 50.0)])
    out_kwh, in_kwh, peak_kw, near_kw, far_kw = law.core.demand_features(ahead_kw[None])[0]
    assert out_kwh == pytest.approx(80.0)  # 2 h at 40 kW, before anything comes back
    assert in_kwh == pytest.approx(5.0 * 60.0 - 80.0)
    assert peak_kw == 60.0
    assert near_kw == pytest.approx((8 * 40.0 + 16 * 60.0) / 24)  # the first six hours
    assert far_kw == pytest.approx(np.abs(ahead_kw).mean())
    assert law.core.demand_features(ahead_kw[None]).shape == (1, 5)
