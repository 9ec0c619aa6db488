"""SOC calibration on a period: every string is full once in it, at the time that costs least."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from live_cases import controller, measured

import bess
from bess.checkpoints import from_json, to_json
from bess.edge.serve import calibration
from bess.edge.serve.calibration import Calibration, PlannedCalibration, place
from bess.edge.serve.constraints import SocLimits
from bess.edge.serve.measurement_validator import ValidState
from bess.errors import InputError
from bess.study.sections import ServiceSection

DAY_S = 86_400.0


def placement(demand_kw: list[float], soc: float = 0.6, due: int | None = None):  # type: ignore[no-untyped-def]
    system = bess.System.reference(2)
    trusted = ValidState.without_doubt(bess.State([soc, soc], [25.0, 25.0]), system)
    service = ServiceSection(calibration_kw=46.0)
    return place(system, service, trusted, np.array(demand_kw), 0.5, 0, due or len(demand_kw))


def test_a_string_is_charged_while_the_others_are_not_needed() -> None:
    peak_first = placement([120.0] * 2 + [-30.0] * 12)
    assert peak_first[0] >= 2
    peak_last = placement([-30.0] * 12 + [120.0] * 2)
    assert peak_last[0] < 12
    assert min(peak_first[1], peak_last[1]) > 0.0


def test_a_time_at_which_the_others_cannot_carry_the_load_is_not_taken() -> None:
    assert placement([130.0] * 3 + [-60.0] * 7, soc=0.9)[0] >= 3
    short = placement([150.0] * 2 + [-20.0] * 12)  # days on which energy is short anyway
    assert short[1] > 20.0 * placement([20.0] * 6, soc=0.9)[1] > 0.0


def test_a_calibration_ends_before_the_string_is_due() -> None:
    """It takes about 107 kWh at 46 kW, five steps of half an hour, and costs least if begun at the fourth."""
    day_kw = [-20.0] * 4 + [20.0] * 4 + [-46.0] * 12
    assert placement(day_kw, due=12)[0] == 3
    assert placement(day_kw, due=6)[0] <= 1


def test_every_string_is_full_once_in_its_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "STARTS", 3)
    live = controller(3, policy="soc", control_step_s=900.0, calibration_days=1.5)
    soc = np.array([0.7, 0.6, 0.5])
    full_s: list[list[float]] = [[], [], []]
    for k in range(4 * 96):
        answer = live.step(measured(soc), 20.0 * np.sin(k / 6.0), 900.0 * k)
        assert answer.unmet_kw == 0.0
        soc = soc - answer.request_kw * 0.25 / live.system.nominal_energy_kwh
        for i in np.flatnonzero(soc > 0.994):
            full_s[i].append(900.0 * k)
        if k == 150:  # a restart forgets nothing of it
            again = controller(3, policy="soc", control_step_s=900.0, calibration_days=1.5)
            again.load_state_dict(from_json(to_json(live.state_dict())))
            live = again
    for times in full_s:
        assert np.diff([0.0, *times]).max() < 2.0 * DAY_S
        assert times[-1] > 2.0 * DAY_S


def test_a_string_that_was_full_anyway_is_not_calibrated() -> None:
    live = controller(2, policy="soc", control_step_s=900.0, calibration_days=2.0)
    for k in range(8):
        live.step(measured([1.0, 0.6]), -20.0, 900.0 * k)
    due_s = live.calibration.due_s()
    assert due_s is not None
    np.testing.assert_allclose(due_s, [7 * 900.0 + 2.0 * DAY_S, 2.0 * DAY_S])
    assert live.calibration.string is None


def fails(*_: object) -> tuple[int, float]:
    raise RuntimeError("no candidate")


@pytest.mark.parametrize("pool", [None, ThreadPoolExecutor(1)])
def test_after_a_search_that_fails_the_next_step_of_the_plan_begins_another(
    pool: ThreadPoolExecutor | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, service = bess.System.reference(2), ServiceSection(calibration_days=2.0)
    plans = Calibration(system, service, SocLimits(system, service, 900.0), pool)
    valid = ValidState.without_doubt(bess.State([0.6, 0.6], [25.0, 25.0]), system)
    plans.full_s = np.zeros(2)

    def searched(at_s: float) -> None:
        plans.update(at_s, valid, np.zeros(96))
        while plans.search.is_busy:
            plans.update(at_s, valid, np.zeros(96))

    monkeypatch.setattr(calibration, "place", fails)
    searched(2.0 * DAY_S)
    assert plans.search.error == "the search for the next calibration failed (RuntimeError: no candidate)"
    monkeypatch.setattr(calibration, "place", lambda *_: (0, 1.0))
    searched(2.0 * DAY_S)  # the same step of the plan: a failing search must not take all computing time
    assert plans.planned is None
    searched(2.0 * DAY_S + 900.0)
    assert plans.planned == PlannedCalibration(0, 2.0 * DAY_S + 900.0, 1.0)
    assert plans.search.error == ""


def test_a_search_that_fails_leaves_the_control_step_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "place", fails)
    live = controller(2, control_step_s=10.0, calibration_days=1.0)
    for k in range(3):
        answer = live.step(measured([0.6, 0.6]), 80.0, 10.0 * k)
        assert answer.request_kw.sum() == pytest.approx(80.0)
    assert "no candidate" in live.calibration.search.error


@pytest.mark.parametrize("fails_when", ["planned", "string"])
def test_a_string_that_goes_out_of_service_lets_the_others_have_their_calibration(fails_when: str) -> None:
    live = controller(3, policy="soc", control_step_s=900.0, calibration_days=2.0)
    first_out, calibrated = False, set()
    for k in range(96 * 2):
        first_out |= getattr(live.calibration, fails_when) is not None
        available = np.array([not first_out, True, True])
        live.step(measured([0.7, 0.7, 0.7], available=available), 5.0, 900.0 * k)
        calibrated.add(live.calibration.string)
    assert 1 in calibrated


def test_a_clock_that_was_ahead_delays_no_calibration() -> None:
    live = controller(2, policy="soc", control_step_s=900.0, calibration_days=2.0)
    for k in range(4):
        live.step(measured([0.7, 0.7]), 5.0, 4.0 * 365.0 * DAY_S + 900.0 * k)
    for k in range(2):
        live.step(measured([0.7, 0.7]), 5.0, 900.0 * k)
    due_s = live.calibration.due_s()
    assert due_s is not None
    assert due_s.max() <= 900.0 + 2.0 * DAY_S


def test_a_plant_of_one_string_has_no_period() -> None:
    with pytest.raises(InputError, match="no other string"):
        controller(1, calibration_days=7.0)


def test_a_time_planned_with_a_period_is_forgotten_without_one() -> None:
    before = controller(2, policy="soc", control_step_s=900.0, calibration_days=1.5)
    before.calibration.planned = PlannedCalibration(1, 3600.0, 0.2)
    live = controller(2, policy="soc", control_step_s=900.0)
    live.load_state_dict(from_json(to_json(before.state_dict())))
    live.step(measured([0.5, 0.5]), 0.0, 900.0)
    assert live.calibration.planned is None
