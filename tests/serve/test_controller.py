"""The live controller: sums, reasons, switching, calibration, and what it remembers."""

import tracemalloc
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, ClassVar

import numpy as np
import pytest
from live_cases import PLAN_STEPS, controller, measured

import bess
from bess.checkpoints import from_json, to_json
from bess.control.policies import Decision, PolicyInput
from bess.edge.serve.controller import Controller
from bess.edge.serve.service import build_controller
from bess.errors import InputError
from bess.study.sections import ServiceSection


@pytest.mark.parametrize("n_strings", [1, 2, 3, 8])
def test_set_points_and_what_is_unmet_are_the_demand(n_strings: int) -> None:
    rng = np.random.default_rng(n_strings)
    live = controller(n_strings)
    for k in range(150):
        demand_kw = float(rng.uniform(-1.2, 1.2) * 92.0 * n_strings)
        answer = live.step(
            measured(rng.uniform(0.0, 1.0, n_strings), rng.uniform(10.0, 55.0, n_strings)),
            demand_kw,
            900.0 * k,
        )
        sum_kw = answer.request_kw.sum()
        assert abs(sum_kw + np.sign(demand_kw) * answer.unmet_kw - demand_kw) < 1e-9 * 92.0 * n_strings
        assert (np.abs(answer.request_kw) <= 92.0 + 1e-9).all()
        assert (answer.request_kw * np.sign(demand_kw) >= 0.0).all()


def test_at_the_step_of_the_plan_the_answer_is_the_plan() -> None:
    live = controller(2)
    forecast = [60.0, 150.0, -40.0, -120.0, 0.0, 30.0]
    policy = controller(2).plan._policy
    from bess.control.policies import PolicyInput

    state = bess.State(soc=[0.6, 0.4], temperature_c=[25.0, 25.0])
    ahead = np.pad(forecast, (0, 2))
    decision = policy(PolicyInput(state, ahead, np.full(8, 25.0), np.full(2, 92.0)))
    answer = live.step(measured([0.6, 0.4]), 60.0, 0.0, forecast_kw=forecast)
    np.testing.assert_allclose(answer.request_kw, decision.request_kw)
    assert answer.plan_kw.shape == (2, 6)
    np.testing.assert_allclose(answer.plan_kw[:, 0], answer.request_kw)
    np.testing.assert_allclose(answer.plan_kw.sum(axis=0), forecast)


def test_a_plan_knows_announced_maintenance_and_discharges_the_string_before() -> None:
    """Two hours at 85 kW; string 0 will be out in the second, and the plant still reports it as available."""
    study = bess.load_study(
        "case1",
        {
            "policy.mode": "plan",
            "policy.objectives.kind": "energy",
            "policy.foresight_h": 2.0,
            "event": [
                {"string": 0, "start": at, "end": end, "announced": announced}
                for at, end, announced in (
                    ("2026-03-01T01:00:00Z", "2026-03-01T02:00:00Z", True),
                    ("2026-03-01T00:00:00Z", "2026-03-01T02:00:00Z", False),
                )
            ],
        },
    )
    live, notes = build_controller(study, background=False)
    assert any("without announced = true is not used" in note for note in notes)
    now_s = datetime(2026, 3, 1, tzinfo=UTC).timestamp()
    answer = live.step(measured([0.5, 0.5]), 85.0, now_s, forecast_kw=[85.0] * 8)
    np.testing.assert_allclose(answer.plan_kw.sum(axis=0), 85.0)
    assert not answer.plan_kw[0, 4:].any()
    assert answer.plan_kw[0, :4].sum() > 3.0 * answer.plan_kw[1, :4].sum()


def test_the_plan_of_any_forecast_meets_it_within_the_limits() -> None:
    live, rng = controller(3), np.random.default_rng(9)
    for k in range(30):
        forecast = rng.uniform(-350.0, 350.0, int(rng.integers(2, 12)))
        limits = rng.uniform(10.0, 92.0, 3)
        soc = 0.5 + 1e-3 * rng.standard_normal(3)
        reading = measured(soc, charge_limit_kw=limits, discharge_limit_kw=limits)
        answer = live.step(reading, float(forecast[0]), 90.0 * k, forecast_kw=forecast)
        can = np.minimum(np.abs(forecast), limits.sum())
        np.testing.assert_allclose(np.abs(answer.plan_kw.sum(axis=0)), can, atol=1e-6)
        assert (np.abs(answer.plan_kw) <= limits[:, None] + 1e-9).all()
        assert (answer.plan_kw * np.sign(forecast) >= 0.0).all()


def test_a_reserve_is_never_discharged() -> None:
    live = controller(2, control_step_s=10.0, soc_floor=(0.3, 0.0))
    answer = live.step(measured([0.3, 0.6]), 80.0, 0.0)
    np.testing.assert_allclose(answer.request_kw, [0.0, 80.0])
    assert "string 0 rests: at its lowest state of charge, 30.0 %" in answer.reasons
    answer = live.step(measured([0.3, 0.6]), 150.0, 10.0)
    assert answer.request_kw[0] == 0.0
    assert answer.unmet_kw == pytest.approx(58.0)


def test_a_demand_beyond_the_plant_is_named_not_hidden() -> None:
    answer = controller(2).step(measured([0.5, 0.5]), 500.0, 0.0)
    np.testing.assert_allclose(answer.request_kw, [92.0, 92.0])
    assert answer.unmet_kw == pytest.approx(316.0)
    assert "316 kW of 500 kW cannot be met" in answer.status
    assert answer.reasons[0] == "string 0 runs: at its limit of 92 kW"
    in_watts = controller(2).step(measured([0.5, 0.5]), -78000.0, 0.0)
    assert "77816 kW of -78000 kW cannot be met" in in_watts.status


def test_ramps_limit_the_change_of_every_set_point() -> None:
    live = controller(2, control_step_s=1.0, ramp_kw_per_s=5.0)
    last = np.zeros(2)
    for k, demand_kw in enumerate([120.0] * 30 + [-120.0] * 60):
        answer = live.step(measured([0.5, 0.5]), demand_kw, float(k))
        assert (np.abs(answer.request_kw - last) <= 5.0 + 1e-9).all()
        last = answer.request_kw
    assert last.sum() == pytest.approx(-120.0)


def test_set_points_that_have_lapsed_are_no_beginning_of_a_ramp() -> None:
    live = controller(2, control_step_s=10.0, ramp_kw_per_s=1.0)
    for k in range(10):
        live.step(measured([0.5, 0.5]), 60.0, 10.0 * k)
    assert live.last_kw.sum() == pytest.approx(60.0)
    answer = live.step(measured([0.5, 0.5]), -60.0, 3600.0)
    assert answer.in_service.all()  # no state of charge should have moved within this hour
    assert answer.request_kw.sum() == pytest.approx(-10.0)


def test_a_fallback_keeps_to_the_ramp_and_goes_on_from_the_last_one() -> None:
    live, at_rest = controller(2, control_step_s=10.0, ramp_kw_per_s=1.0), measured([0.6, 0.5])
    live.step(at_rest, 0.0, 0.0)
    answers = [live.fallback(at_rest, demand_kw, "late") for demand_kw in (60.0, 60.0, 60.0, 60.0, -60.0)]
    sums_kw = [answer.request_kw.sum() for answer in answers]
    assert sums_kw == pytest.approx([20.0, 40.0, 60.0, 60.0, 40.0])
    assert [answer.unmet_kw for answer in answers] == pytest.approx([40.0, 20.0, 0.0, 0.0, 100.0])


def test_a_set_point_that_a_ramp_determines_says_so() -> None:
    live = controller(2, control_step_s=1.0, ramp_kw_per_s=5.0)
    for k, demand_kw in enumerate([60.0, 60.0, -60.0]):
        answer = live.step(measured([0.6, 0.0]), demand_kw, float(k))
        assert answer.reasons[0] == "string 0 runs: its ramp limit permits no faster change"
    assert answer.reasons[1] == "string 1 rests: other strings must first ramp down from the other direction"


@pytest.mark.parametrize(
    ("demand_kw", "limit_kw", "string", "reason"),
    [
        (5.0, 92.0, 0, "idles: the demand of 5 kW is below its minimum power of 20 kW"),
        (-5.0, 92.0, 1, "rests: the demand of 5 kW is below its minimum power of 80 kW"),
        (110.0, 92.0, 1, "runs: at its minimum power of 80 kW"),
        (60.0, 70.0, 1, "rests: at most 70 kW are possible, less than its minimum power of 80 kW"),
    ],
)
def test_a_set_point_that_a_minimum_power_determines_says_so(
    demand_kw: float, limit_kw: float, string: int, reason: str
) -> None:
    live = controller(2, control_step_s=10.0, minimum_power_kw=(20.0, 80.0))
    limits = np.array([92.0, limit_kw])
    reading = measured([0.5, 0.5], charge_limit_kw=limits, discharge_limit_kw=limits)
    assert live.step(reading, demand_kw, 0.0).reasons[string] == f"string {string} {reason}"


def test_least_times_hold_while_the_demand_jumps_about() -> None:
    live = controller(3, control_step_s=10.0, minimum_on_s=60.0, minimum_off_s=60.0, start_kwh=0.0)
    rng = np.random.default_rng(3)
    changed_at = np.full(3, -np.inf)
    before = np.zeros(3, dtype=bool)
    for k in range(400):
        soc = 0.5 + 1e-3 * rng.standard_normal(3)
        answer = live.step(measured(soc), float(rng.uniform(-250.0, 250.0)), 10.0 * k)
        switched = answer.running != before
        assert (10.0 * k - changed_at[switched] >= 60.0).all()
        changed_at[switched] = 10.0 * k
        before = answer.running
    assert live.commitment.starts.sum() > 3


def test_least_times_hold_over_a_restart() -> None:
    settings = {"control_step_s": 10.0, "minimum_off_s": 120.0, "start_kwh": 0.0}
    whole, first = (controller(3, policy="equal", **settings) for _ in range(2))  # type: ignore[arg-type]
    demands = [240.0, 240.0, *[40.0] * 6]
    for k, demand_kw in enumerate(demands):
        before = [live.step(measured([0.5] * 3), demand_kw, 10.0 * k) for live in (whole, first)]
        assert (before[0].running == before[1].running).all()
    second = controller(3, policy="equal", **settings)  # type: ignore[arg-type]
    second.load_state_dict(from_json(to_json(first.state_dict())))
    second.plan.load_state_dict(first.plan.state_dict())
    for k in range(len(demands), len(demands) + 20):
        now = [live.step(measured([0.5] * 3), 40.0, 10.0 * k) for live in (whole, second)]
        assert (now[0].running == now[1].running).all(), k


class ThreeSteps:
    """A policy of one's own that plans three of the steps of the forecast, and counts its plans."""

    statuses: ClassVar = {0: "chosen"}

    def __init__(self) -> None:
        self.plans = 0

    def __call__(self, inputs: PolicyInput) -> Decision:
        self.plans += 1
        plan_kw = np.tile(inputs.demand_kw[:3] / inputs.limit_kw.size, (inputs.limit_kw.size, 1))
        return Decision(plan_kw[:, 0], plan_kw=plan_kw)

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        pass


@pytest.mark.parametrize("demand_kw", [100.0, 300.0])
def test_a_restart_makes_no_plan_anew_however_short_it_is_and_whatever_was_asked(demand_kw: float) -> None:
    system, policy = bess.System.reference(2), ThreeSteps()
    first, second = (
        Controller(system, policy, ServiceSection(control_step_s=60.0), PLAN_STEPS, background=False)
        for _ in range(2)
    )
    ahead_kw = [demand_kw] * PLAN_STEPS
    first.step(measured([0.5, 0.5]), demand_kw, 0.0, forecast_kw=ahead_kw)
    second.load_state_dict(from_json(to_json(first.state_dict())))
    second.plan.load_state_dict(first.plan.state_dict())
    answer = second.step(measured([0.5, 0.5]), demand_kw, 60.0, forecast_kw=ahead_kw)
    assert policy.plans == 1 and answer.request_kw.sum() == min(demand_kw, 184.0)


def test_what_a_start_is_worth_makes_starts_rare() -> None:
    starts = []
    for start_kwh in (0.0, 0.5):
        live = controller(2, control_step_s=10.0, start_kwh=start_kwh)
        rng = np.random.default_rng(5)
        for k in range(360):
            soc = 0.5 + 1e-3 * rng.standard_normal(2)
            live.step(measured(soc), float(rng.choice([20.0, 85.0, 0.0])), 10.0 * k)
        starts.append(int(live.commitment.starts.sum()))
    assert starts[1] < 0.2 * starts[0]


def test_a_decision_of_a_large_plant_takes_little_memory_and_little_state() -> None:
    """Half of the strings run; to compare each exchange of two of them took the cube of their number."""
    peaks, sizes = [], []
    for n in (32, 128):
        live = controller(n, policy="equal", control_step_s=10.0)
        live.commitment.running[::2] = True
        soc = np.linspace(0.4, 0.6, n)
        live.step(measured(soc), 40.0 * n, 0.0)
        live.plan.current = None
        tracemalloc.start()
        live.step(measured(soc), 30.0 * n, 10.0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        sizes.append(len(to_json(live.commitment.state_dict())))
    assert peaks[1] < 20.0 * peaks[0]
    assert sizes[1] < 5.0 * sizes[0]


def test_a_jump_of_the_demand_starts_as_many_inverters_of_a_large_plant_as_it_needs() -> None:
    live = controller(100, policy="equal", control_step_s=10.0)
    answer = live.step(measured(np.linspace(0.4, 0.6, 100)), 60.5 * 92.0, 0.0)
    assert answer.unmet_kw == 0.0
    assert 61 <= answer.running.sum() <= 100


def test_starts_go_around_among_equal_strings() -> None:
    live = controller(4, policy="equal", control_step_s=60.0, start_kwh=0.01)
    rng = np.random.default_rng(4)
    for k in range(400):
        soc = 0.5 + 1e-3 * rng.standard_normal(4)
        live.step(measured(soc), 60.0 if k % 2 else 0.0, 60.0 * k)
    starts = live.commitment.starts
    assert starts.sum() > 40
    assert starts.max() - starts.min() <= 0.5 * starts.mean()


def test_a_string_is_calibrated_while_the_others_carry_the_load() -> None:
    live = controller(3, control_step_s=60.0)
    soc = np.array([0.9, 0.6, 0.6])
    live.calibration.begin(0)
    for k in range(600):
        answer = live.step(measured(soc), 50.0, 60.0 * k)
        assert answer.request_kw.sum() == pytest.approx(50.0)
        if live.calibration.string is None:
            break
        assert answer.request_kw[0] <= 0.0
        assert "calibration" in answer.reasons[0]
        soc = soc - answer.request_kw / 266.0 / 60.0
    assert soc[0] > 0.99
    assert live.calibration.string is None


def test_calibration_never_costs_the_load_anything() -> None:
    live = controller(2, control_step_s=60.0)
    live.calibration.begin(0)
    answer = live.step(measured([0.5, 0.5]), 92.0, 0.0)
    np.testing.assert_allclose(answer.request_kw, [0.0, 92.0])
    assert answer.unmet_kw == 0.0
    for soc, demand_kw in (
        ([0.5, 0.5], 150.0),
        ([0.5, 0.0], 60.0),
        ([0.5, 0.5], -150.0),
        ([0.5, 1.0], -80.0),
    ):
        live = controller(2, control_step_s=60.0)
        live.calibration.begin(0)
        answer = live.step(measured(soc), demand_kw, 0.0)
        assert answer.request_kw.sum() == pytest.approx(demand_kw)


def test_a_controller_continues_as_if_it_had_never_ended() -> None:
    rng = np.random.default_rng(7)
    demands = rng.uniform(-150.0, 150.0, 200)
    socs = 0.5 + 0.02 * rng.standard_normal((200, 2))

    def run(live, steps):  # type: ignore[no-untyped-def]
        return [live.step(measured(socs[k]), demands[k], 60.0 * k).request_kw for k in steps]

    whole = run(controller(2, control_step_s=60.0), range(200))
    first = controller(2, control_step_s=60.0)
    head = run(first, range(90))
    second = controller(2, control_step_s=60.0)
    second.load_state_dict(from_json(to_json(first.state_dict())))
    second.plan.load_state_dict(first.plan.state_dict())
    np.testing.assert_array_equal(whole, head + run(second, range(90, 200)))


@pytest.mark.parametrize("failure", [RuntimeError("no memory"), TimeoutError("no licence")])
def test_a_plan_that_fails_in_any_way_is_reported_and_the_next_one_is_made(
    failure: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = controller(2)

    def fail(*_: object) -> None:
        raise failure

    with monkeypatch.context() as patched:
        patched.setattr(live.plan, "_make", fail)
        for k in range(2):
            answer = live.step(measured([0.6, 0.6]), 80.0, 900.0 * k)
            assert answer.request_kw.sum() == pytest.approx(80.0)
            assert f"the last plan failed ({type(failure).__name__}: {failure})" in answer.status
    assert live.step(measured([0.6, 0.6]), 80.0, 1800.0).status == "Shared within the plan."
    assert live.plan.making.error == ""


def test_settings_that_fit_no_plant_are_refused() -> None:
    for bad, words in (
        ({"control_step_s": 900.0, "soc_floor": (0.1, 0.2, 0.3)}, "3 values for 2 strings"),
        ({"soc_floor": 0.6, "soc_ceiling": 0.5}, "must be below soc_ceiling"),
        ({"minimum_power_kw": 120.0}, "string 0 has 92 kW"),
    ):
        with pytest.raises(InputError, match=words):
            controller(2, **bad)
    with pytest.raises(InputError, match="strings 0 to 1"):
        controller(2).calibration.begin(2)


def test_the_service_plans_with_the_model_of_the_study_as_a_run_does() -> None:
    pytest.importorskip("prometheus_client")
    from bess.control.policies import PolicyInput, build_policy
    from bess.study.plant_choice import policy_settings

    state = bess.State(soc=[0.7, 0.4], temperature_c=[30.0, 25.0])
    inputs = PolicyInput(state, np.full(8, 100.0), np.full(8, 25.0), np.full(2, 92.0))
    requests = []
    for model in ("nonlinear", "linear"):
        study = bess.load_study("policies", {"policy.foresight_h": 2.0, "policy.model": model})
        live, _ = build_controller(study, background=False)
        own = build_policy("mpc", live.system, policy_settings(study, live.system))
        requests.append(live.plan._policy(inputs).request_kw)
        np.testing.assert_array_equal(requests[-1], own(inputs).request_kw)
    assert not np.allclose(*requests)
