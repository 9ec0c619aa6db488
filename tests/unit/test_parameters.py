"""Claims about system files: the reference is right, overrides reach one string, errors say what is wrong."""

import copy
from typing import Any

import numpy as np
import pytest

import bess


@pytest.fixture
def document() -> dict[str, Any]:
    return copy.deepcopy(bess.System.reference().document)


def test_reference_system_is_two_strings_of_92_kw_and_266_kwh() -> None:
    system = bess.System.reference()
    assert system.n_strings == 2
    np.testing.assert_allclose(system.nominal_kw, 92.0)
    np.testing.assert_allclose(system.capacity_ah, 376.0)
    np.testing.assert_allclose(system.nominal_energy_kwh, 265.7, rtol=0.02)
    assert system.core.n_strings == 2


def test_any_number_of_equal_strings() -> None:
    assert bess.System.reference(n_strings=32).core.n_strings == 32


def test_a_string_table_overrides_any_section_of_one_string(document: dict[str, Any]) -> None:
    document["string"] = [{}, {"battery": {"r_scale": 1.5}, "system": {"initial_soc": 0.2}}]
    system = bess.System(document)
    assert [s.battery.r_scale for s in system.strings] == [1.0, 1.5]
    np.testing.assert_allclose(system.initial_state().soc, [0.5, 0.2])


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        ("battery.ocv_v.soc", [0.0, 0.2, 0.1], "battery.ocv_v.soc: knots must ascend, but 0.1 follows 0.2"),
        ("battery.resistance_temperature.resistance_mohm", [-1.0] + [1.0] * 9, "resistance_mohm[0] = -1.0"),
        ("inverter.loss_charge", [1.5] + [0.1] * 10, "inverter.loss_charge[0] = 1.5"),
        ("battery.soc_max", float("nan"), "battery.soc_max = nan"),
        ("battery.colour", "red", "battery.colour: unknown key"),
        ("battery.soc_min", 1.0, "soc_min 1 must be below soc_max 1"),
        ("control.plant_step_s", 7.0, "does not divide the control step"),
        ("system.n_strings", 0, "system.n_strings = 0"),
        ("weather", {}, "unknown section 'weather'"),
    ],
)
def test_errors_name_the_key_the_value_and_what_is_allowed(
    document: dict[str, Any], path: str, value: object, expected: str
) -> None:
    *parents, key = path.split(".")
    table = document
    for parent in parents:
        table = table[parent]
    table[key] = value
    with pytest.raises(bess.InputError) as caught:
        bess.System(document, name="plant.toml")
    assert str(caught.value).startswith("plant.toml: ")
    assert expected in str(caught.value)


def test_an_ocv_that_falls_is_refused(document: dict[str, Any]) -> None:
    document["battery"]["ocv_v"]["charge"][3] = 3.2
    with pytest.raises(bess.InputError, match="must not fall with SOC"):
        bess.System(document)


@pytest.mark.parametrize(
    ("soc", "temperature_c"), [([0.5, 1.2], [25, 25]), ([float("nan")], [25]), ([0.5], [25, 25]), ([], [])]
)
def test_a_state_outside_its_range_is_refused(soc: list[float], temperature_c: list[float]) -> None:
    with pytest.raises(bess.InputError):
        bess.State(soc=soc, temperature_c=temperature_c)
