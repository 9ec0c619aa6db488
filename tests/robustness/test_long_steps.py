"""Claim: a plant is not set to work that would not end; it says how long a step and a call may be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bess
from bess.plant import PlantEnsemble

SYSTEM = bess.System.reference(2)


@pytest.mark.parametrize("step_s", [1e9, 1e300, 86_410.0, 5.0, -900.0, float("nan"), float("inf")])
def test_a_control_step_lasts_a_day_at_most(step_s: float) -> None:
    plant = bess.Plant(SYSTEM, SYSTEM.initial_state())
    calls: tuple[Any, ...] = (
        lambda: plant.step([1.0, 1.0], step_s),
        lambda: plant.run([[1.0, 1.0]], step_s),
        lambda: PlantEnsemble(SYSTEM, [SYSTEM.initial_state()]).step([[1.0, 1.0]], step_s),
    )
    for call in calls:
        with pytest.raises(bess.InputError, match=r"plant: control step .* s is outside \[10, 86400\] s"):
            call()


@pytest.mark.parametrize("step_s", [10**400, "900", True, 1 + 2j, None, [900.0, 900.0], b"900"])
def test_a_control_step_is_one_number(step_s: Any) -> None:
    plant = bess.Plant(SYSTEM, SYSTEM.initial_state())
    with pytest.raises(bess.InputError, match=r"plant: control step.*s"):
        plant.step([1.0, 1.0], step_s)
    with pytest.raises(bess.InputError, match=r"plant: control step.*s"):
        plant.run([[1.0, 1.0]], step_s)


@pytest.mark.parametrize("value", [10**400, "10", True, 1 + 2j, [10.0, 10.0]])
def test_the_numbers_of_a_new_plant_are_numbers(value: Any) -> None:
    for name in ("plant_step_s", "ambient_c"):
        with pytest.raises(bess.InputError, match=name):
            bess.Plant(SYSTEM, SYSTEM.initial_state(), **{name: value})


def test_a_call_has_an_end() -> None:
    plant = bess.Plant(SYSTEM, SYSTEM.initial_state(), plant_step_s=0.001)
    with pytest.raises(bess.InputError, match=r"17280000000 plant steps of strings .* more than 10000000000"):
        plant.run(np.zeros((100, 2)), 86_400.0)
    assert plant.state.soc.tolist() == SYSTEM.initial_state().soc.tolist()
