"""Claims about public objects as values: they compare, copy and cross to another process."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bess

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
