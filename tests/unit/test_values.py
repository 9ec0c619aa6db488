"""Claims about public objects as values: they compare, copy and cross to another process."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bess
from bess.control.policies import PolicyInput
from bess.control.wear import WearPrices, WearRates

STATE = bess.State(soc=[0.5, 0.4], temperature_c=[25.0, 30.0])
WAYS: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
}


def reference() -> bess.System:
    return bess.System.reference(2)


VALUES: dict[str, Callable[[float], object]] = {
    "State": lambda kw: bess.State(soc=[0.5, kw / 100.0], temperature_c=[25.0, 30.0]),
    "System": lambda kw: bess.System(
        reference().document | {"inverter": reference().document["inverter"] | {"nominal_kw": 60.0 + kw}}
    ),
    "Rollout": lambda kw: bess.rollout(reference(), STATE, np.full((2, 4), kw)),
    "Split": lambda kw: bess.split_power(reference(), STATE, [kw] * 4),
    "Flows": lambda kw: bess.Plant(reference(), STATE).step([kw, kw]),
    "PlantSnapshot": lambda kw: _after(kw).snapshot(),
    "Objectives": lambda kw: _used(bess.Objectives(inverter=kw)),
}


def _after(kw: float) -> bess.Plant:
    plant = bess.Plant(reference(), STATE)
    plant.step([kw, kw])
    return plant


def _used(objectives: bess.Objectives) -> bess.Objectives:
    bess.split_power(reference(), STATE, [40.0] * 2, objectives=objectives)
    return objectives


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", VALUES)
def test_a_value_equals_its_copy_and_no_other(kind: str, way: str) -> None:
    value = VALUES[kind](40.0)
    assert WAYS[way](value) == value == VALUES[kind](40.0)
    assert value != VALUES[kind](41.0)
    assert value != "something else"


def test_a_system_equals_that_of_its_document_whatever_it_is_called() -> None:
    system = reference()
    again = bess.System(system.document, name="mine")
    assert again == system and hash(again) == hash(system)
    assert bess.System.reference(3) != system


def test_nan_in_node_temperatures_does_not_make_flows_differ_from_themselves() -> None:
    system = bess.load_system("mixed-4")
    flows = bess.Plant(system, system.initial_state()).step(np.full(4, 5.0))
    assert flows == copy.deepcopy(flows)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("wear", ["none", "kokam-75ah"])
def test_a_copied_plant_goes_on_to_the_last_bit_and_apart_from_the_first(way: str, wear: str) -> None:
    document = reference().document
    document["wear"] = {"model": wear}
    plant = bess.Plant(bess.System(document), STATE, derating_law="pi", plant_step_s=5.0, ambient_c=31.0)
    plant.run(np.resize([[60.0, 20.0], [-50.0, -40.0]], (96, 2)))
    twin = WAYS[way](plant)
    assert twin.step([30.0, 60.0]) == plant.step([30.0, 60.0])
    twin.step([30.0, 0.0])
    assert twin.state != plant.state


@pytest.mark.parametrize("way", WAYS)
def test_a_copied_splitter_gives_the_same_answer_and_carries_the_plan_on(way: str) -> None:
    splitter = bess.PowerSplit(reference(), 4, bess.Objectives(inverter=0.5), gap=5e-3, node_limit=3)
    splitter(STATE, [70.0] * 4)
    twin = WAYS[way](splitter)
    np.testing.assert_array_equal(twin.warm_start, splitter.warm_start)
    assert twin(STATE, [60.0] * 4) == splitter(STATE, [60.0] * 4)
    assert twin.settings == splitter.settings


def test_a_system_cannot_be_changed() -> None:
    """Writing to its arrays changed later splits; an ambient temperature reached splits, but not runs."""
    system = reference()
    before = bess.split_power(system, STATE, [40.0] * 2)
    for array in (system.nominal_kw, system.min_power_kw, system.capacity_ah, *system.soc_window):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(bess.InputError, match="ambient_c cannot be set, a System is immutable"):
        system.ambient_c = 40.0
    system.document["inverter"]["nominal_kw"] = 10.0
    assert bess.System(system.document) == system == copy.copy(system) == reference()
    assert bess.split_power(system, STATE, [40.0] * 2) == before


def test_a_warm_start_is_changed_by_assignment_only() -> None:
    split = bess.PowerSplit(reference(), 2)
    split(STATE, [40.0] * 2)
    assert split.warm_start is not None
    with pytest.raises(ValueError, match="read-only"):
        split.warm_start[0] = 0.0


def test_prices_of_wear_and_inputs_of_policies_compare() -> None:
    """Comparing dataclasses of arrays was an error of NumPy."""
    rates = WearRates(reference())
    assert rates.at(STATE) == rates.at(STATE)
    assert WearPrices.of(reference()) == WearPrices.of(reference()) != WearPrices.of(bess.System.reference(3))
    inputs = PolicyInput(STATE, *np.ones((3, 2)))
    assert inputs == PolicyInput(STATE, *np.ones((3, 2))) != PolicyInput(STATE, *np.zeros((3, 2)))


def test_settings_are_changed_by_building_new_ones() -> None:
    """It was an error of pydantic of three lines, with an address."""
    study = bess.load_study("case1")
    for section, name in ((study, "title"), (study.run, "days"), (study.policy.objectives, "inverter")):
        with pytest.raises(
            bess.InputError, match=f"{name} cannot be set; build a new one, as study.with_values"
        ):
            setattr(section, name, 3.0)
    assert study.with_values({"run.days": 3.0}).run.days == 3.0


def test_numbers_that_are_missing_are_equal() -> None:
    """A plan without a bound was not equal to itself."""
    plan = bess.Plan(np.ones((2, 2)), 1.0, 1.0, np.zeros(2), 0)
    assert np.isnan(plan.bound)
    assert plan == replace(plan, bound=float("nan")) != replace(plan, bound=0.0)
    assert replace(plan, bound=0.0) != plan


def test_a_state_without_a_part_is_refused_by_name() -> None:
    split = bess.PowerSplit(bess.System.reference(2), 4)
    with pytest.raises(bess.InputError, match="PowerSplit: no warm_start in the state; give a result"):
        split.load_state_dict({})
    split.load_state_dict(split.state_dict())
