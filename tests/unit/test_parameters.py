"""Claims about system files: the reference is right, overrides reach one string, errors say what is wrong."""

import copy
import tomllib
from typing import Any

import numpy as np
import pytest

import bess
from bess.system.components.registry import SYSTEMS


@pytest.fixture
def document() -> dict[str, Any]:
    return copy.deepcopy(bess.System.reference().document)


def test_reference_system_is_two_strings_of_92_kw_and_266_kwh() -> None:
    system = bess.System.reference()
    assert system.n_strings == 2
    np.testing.assert_allclose(system.nominal_kw, 92.0)
    np.testing.assert_allclose(system.capacity_ah, 376.0)
    np.testing.assert_allclose(system.nominal_energy_kwh, 265.7, rtol=0.02)


def test_any_number_of_equal_strings() -> None:
    system = bess.System.reference(n_strings=32)
    assert system.control_at(system.initial_state()).nominal_loss_kw()[0].size == 32


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
        ("battery.soc_mim", 0.1, "battery.soc_mim: unknown key; did you mean 'battery.soc_min'?"),
        (
            "inverter.nominal_kW",
            90.0,
            "inverter.nominal_kW: unknown key; did you mean 'inverter.nominal_kw'?",
        ),
        ("battery.soc_min", 1.0, "soc_min 1 must be below soc_max 1"),
        ("control.plant_step_s", 7.0, "does not divide the control step"),
        ("system.n_strings", 0, "system.n_strings = 0"),
        ("weather", {}, "unknown section 'weather'"),
        ("inverter.nominal_kw", "92", "inverter.nominal_kw = '92': must be a number"),
        ("inverter.nominal_kw", 1e300, "inverter.nominal_kw = 1e+300: must be in (0, 1e+06] kW"),
        ("inverter.nominal_kw", True, "inverter.nominal_kw = True: must be a number"),
        ("inverter.model", "no-such", "inverter.model = 'no-such': no such name; bundled are"),
        ("inverter.loss_discharge", [0.3] + [0.01] * 10, "more AC power would mean less DC power"),
        ("battery.cell_capacity_ah", -94.0, "battery.cell_capacity_ah = -94.0: must be in (0, 100000] Ah"),
        ("battery.cells_series", 10**400, "must be in [1, 10000]"),
        (
            "battery.ocv_v.charge",
            [float("nan")] * 15,
            "ocv_v.charge[0][0] = nan: must be a finite number",
        ),
        ("derating.factor", "0.5", "derating.factor = '0.5': must be a list"),
        ("thermal.spatial", 3, "thermal.spatial = 3: must be a table"),
        ("about.licence", 3, "about.licence = 3: must be a text"),
        ("string", [{"system": {"n_strings": 2}}], "string[0].system.n_strings: not a key of one"),
        (
            "string",
            [{}, {"battery": {"r_scale": 0.0}}],
            "string[1].battery.r_scale = 0.0: must be in",
        ),
        ("string", [{}] * 3, "3 [[string]] tables for system.n_strings = 2"),
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


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_a_bundled_system_round_trips_through_toml(name: str) -> None:
    system = bess.load_system(name)
    assert bess.System(system.document).strings == system.strings
    again = bess.System(tomllib.loads(system.to_toml()))
    assert again.strings == system.strings
    assert again.control == system.control
    assert " cell = " not in system.to_toml()


def test_a_named_cell_replaces_the_cell_of_the_base_and_keys_beside_it_override(
    document: dict[str, Any],
) -> None:
    document["string"] = [
        {
            "battery": {"cell": "samsung-94ah", "cell_capacity_ah": 80.0},
            "inverter": {"model": "princeton-gtib-100"},
        },
        {},
    ]
    first, second = bess.System(document).strings
    assert first.battery.resistance_table is not None
    assert first.battery.resistance_temperature is None
    assert first.battery.cell_capacity_ah == 80.0
    assert first.battery.cells_series == 192
    assert first.inverter.nominal_kw == 100.0
    assert second.battery.resistance_table is None


def test_a_missing_file_names_the_bundled_systems() -> None:
    with pytest.raises(bess.InputError, match="no such system file; bundled systems are reference"):
        bess.load_system("referense")


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


@pytest.mark.parametrize(
    ("given", "place"),
    [({"inverter": [{}, {}]}, "inverter"), ({"string": [{"battery": [{}, {}]}]}, r"string\[0\].battery")],
)
def test_several_inverters_or_batteries_of_a_string_are_refused_with_what_to_do(given, place):
    with pytest.raises(bess.InputError, match=place + ": a string is one battery .* list of 2; combine"):
        bess.System({**bess.System.reference(1).document, **given})
