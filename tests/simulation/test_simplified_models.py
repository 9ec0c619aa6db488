"""Claims about the simpler models that a controller may take the plant for."""

import numpy as np
import pytest

import bess
from bess.control.policies.simplified import simplified
from bess.study.scenarios import expand

SYSTEMS = ("reference", "unequal-4", "mixed-4", "cornejo-180")


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_linear_model_has_one_efficiency_and_no_heat(name: str) -> None:
    system = bess.load_system(name)
    linear = simplified(system, "linear")
    np.testing.assert_allclose(linear.nominal_kw, system.nominal_kw)
    np.testing.assert_allclose(linear.nominal_energy_kwh, system.nominal_energy_kwh, rtol=1e-9)
    state = bess.State([0.6] * system.n_strings, [50.0] * system.n_strings)
    small, large = (
        bess.rollout(linear, state, share * system.nominal_kw[:, None], dt_h=1.0 / 60.0)
        for share in (0.1, 1.0)
    )
    ratio = small.inverter_loss_kw / small.delivered_kw
    np.testing.assert_allclose(ratio, large.inverter_loss_kw / large.delivered_kw, rtol=1e-9)
    assert np.abs(large.battery_loss_kw).max() < 1e-4
    assert np.abs(large.derating_loss_kw).max() == 0.0


@pytest.mark.parametrize("name", SYSTEMS)
def test_at_nominal_power_a_linear_model_loses_what_the_plant_loses(name: str) -> None:
    system = bess.load_system(name)
    state = bess.State([0.5] * system.n_strings, [25.0] * system.n_strings)
    true, linear = (
        bess.rollout(each, state, system.nominal_kw[:, None], dt_h=1.0 / 3600.0)
        for each in (system, simplified(system, "linear"))
    )
    lost = true.inverter_loss_kw + true.battery_loss_kw
    np.testing.assert_allclose(linear.inverter_loss_kw, lost, rtol=1e-6)


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_convex_model_never_loses_more_than_the_plant(name: str) -> None:
    system = bess.load_system(name)
    convex = simplified(system, "convex")
    state = bess.State([0.6] * system.n_strings, [30.0] * system.n_strings)
    for share in (-1.0, -0.3, 0.05, 0.4, 1.0):
        request = share * system.nominal_kw[:, None]
        true, seen = (bess.rollout(each, state, request, dt_h=0.1) for each in (system, convex))
        assert (seen.inverter_loss_kw <= true.inverter_loss_kw + 1e-9).all()


def test_the_bundled_sweep_has_every_service_step_and_model() -> None:
    runs = expand(bess.load_study("linear-nonlinear"))
    assert len(runs) == 5 * 3 * 3
    assert {study.policy.model for study in runs.values()} == {"linear", "convex", "nonlinear"}
    efforts = {
        study.policy.rollouts * 1440.0 / study.system.parameters["control"]["step_min"]
        for study in runs.values()
    }
    assert efforts == {14400.0}, "every run may spend as many roll-outs on a day"


def test_on_a_day_of_two_cycles_the_detailed_model_loses_less_than_a_simple_one_every_minute() -> None:
    runs = expand(bess.load_study("linear-nonlinear", {"run.days": 1.0}))
    lost = {
        name: bess.run(runs[name], progress=False).kpis["lost_kwh"]
        for name in ("two-cycle-15min_model=nonlinear", "two-cycle-1min_model=linear")
    }
    assert lost["two-cycle-15min_model=nonlinear"] < 0.9 * lost["two-cycle-1min_model=linear"]
