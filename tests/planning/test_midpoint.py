"""Claims about the control model in its midpoint form."""

from __future__ import annotations

import numpy as np
import pytest

import bess

SYSTEM = bess.System.reference(2)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_with_half_the_step_the_error_of_soc_is_a_quarter_in_the_middle_and_a_half_at_the_start(
    sign: float,
) -> None:
    """Second and first order, between the knots of the tables; cooling is of first order in both forms."""
    state, hours = bess.State([0.65, 0.65], [27.0, 27.0]), 0.25

    def end(parts: int, model: str) -> float:
        request = np.full((2, parts), sign * 30.0)
        roll = bess.rollout(SYSTEM, state, request, hours / parts, model=model)  # type: ignore[arg-type]
        return float(roll.soc[0, -1])

    truth = end(4096, "midpoint")
    for model, ratio in (("start", 2.0), ("midpoint", 4.0)):
        errors = [abs(end(parts, model) - truth) for parts in (2, 4, 8)]
        np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], ratio, rtol=0.15)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("soc", [0.06, 0.1, 0.2])
def test_a_step_that_is_taken_in_parts_cools_once(sign: float, soc: float) -> None:
    """Below the low-SOC switch as above it: as warm as the other form leaves it after 256 steps."""
    state, hours = bess.State([soc, soc], [40.0, 40.0]), 0.25

    def end_c(parts: int, model: str) -> float:
        request = np.full((2, parts), sign * 5.0)
        roll = bess.rollout(SYSTEM, state, request, hours / parts, model=model)  # type: ignore[arg-type]
        return float(roll.temperature_c[0, -1])

    assert end_c(1, "midpoint") == pytest.approx(end_c(256, "start"), abs=0.01)


@pytest.mark.parametrize(("soc", "request_kw"), [(0.04, 60.0), (0.97, -80.0)])
def test_a_string_that_becomes_empty_or_full_delivers_its_request_until_then(
    soc: float, request_kw: float
) -> None:
    """As in the plant: full power for a part of the step costs more than little power for all of it."""
    system, state = bess.System.reference(1), bess.State([soc], [30.0])
    plant = bess.PlantEnsemble(system, [state]).run(np.full((1, 1, 1), request_kw), 900.0)
    middle, start = (
        bess.rollout(system, state, [[request_kw]], 0.25, model=model)  # type: ignore[arg-type]
        for model in ("midpoint", "start")
    )
    assert middle.soc[0, -1] == pytest.approx(0.0 if request_kw > 0.0 else 1.0)
    for name in ("delivered_kw", "inverter_loss_kw", "battery_loss_kw"):
        truth = np.squeeze(getattr(plant, name))
        assert np.squeeze(getattr(middle, name)) == pytest.approx(truth, rel=0.15), name
    assert abs(start.battery_loss_kw.sum() / plant.battery_loss_kw.sum() - 1.0) > 0.3


def test_both_forms_agree_on_what_does_not_move() -> None:
    idle = [
        bess.rollout(SYSTEM, bess.State([0.5, 0.1], [25.0, 40.0]), np.zeros((2, 3)), model=model)  # type: ignore[arg-type]
        for model in ("start", "midpoint")
    ]
    for name in bess.Rollout.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(idle[0], name), getattr(idle[1], name))


def test_an_unknown_form_is_refused() -> None:
    with pytest.raises(bess.InputError, match='"start" and "midpoint"'):
        bess.rollout(SYSTEM, bess.State([0.5, 0.5], [25.0, 25.0]), np.zeros((2, 1)), model="end")  # type: ignore[arg-type]
