"""Claims about cooling: closed forms, an ODE solver, energy balances, thermostats and what it takes."""

import copy
import tomllib
import typing
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from plant_reference import ReferenceString
from scipy.integrate import solve_ivp

import bess
from bess import _core
from bess.system.cooling import Cooling

pytestmark = pytest.mark.closed_form

DIRECT: dict[str, Any] = {"kind": "liquid", "start_c": -50.0, "supply_c": 20.0}
"""Cold plates whose coolant always flows."""


def cooled(n_strings: int = 1, spatial: dict[str, float] | None = None, **cooling: Any) -> bess.System:
    document = copy.deepcopy(bess.System.reference(n_strings).document)
    document["thermal"]["spatial"].update(spatial or {})
    if cooling:
        document["cooling"] = cooling
    return bess.System(document)


def plant_of(
    system: bess.System, temperature_c: list[float], ambient_c: float = 25.0, **more: Any
) -> bess.Plant:
    state = bess.State([0.5] * len(temperature_c), temperature_c)
    return bess.Plant(system, state, ambient_c=ambient_c, **more)


def heat_capacity_kwh_k(system: bess.System) -> float:
    spatial = system.strings[0].thermal.spatial
    volume_m3 = spatial.section_m2 * spatial.length_m * spatial.packs_per_string
    return volume_m3 * spatial.density_kg_m3 * spatial.specific_heat_j_kgk / 3.6e6


def flow_kw_k(system: bess.System) -> float:
    """Heat capacity flow of cold plates at full flow."""
    assert system.cooling is not None
    packs = system.strings[0].thermal.spatial.packs_per_string
    return packs * float(system.cooling.flow_kg_s or 0.0) * float(system.cooling.cp_j_kgk or 0.0) / 1e3


def effectiveness(system: bess.System) -> float:
    """``1 - exp(-NTU)``, ``NTU = U b L / (m cp)``."""
    spatial, cooling = system.strings[0].thermal.spatial, system.cooling
    assert cooling is not None and cooling.u_w_m2k is not None
    area_w_k = cooling.u_w_m2k * spatial.width_m * spatial.length_m * spatial.packs_per_string
    return float(1.0 - np.exp(-area_w_k / (1e3 * flow_kw_k(system))))


def pump_kw(system: bess.System) -> float:
    """``m dp / (rho eta)`` of one string."""
    cooling = system.cooling
    assert cooling is not None
    flow_kg_s = system.strings[0].thermal.spatial.packs_per_string * float(cooling.flow_kg_s or 0.0)
    return flow_kg_s * cooling.pressure_pa / (cooling.density_kg_m3 * cooling.mover_efficiency) / 1e3


def test_every_kind_of_the_plant_is_a_kind_of_system_files() -> None:
    models = typing.get_args(typing.get_args(Cooling)[0])
    names = [typing.get_args(model.model_fields["kind"].annotation)[0] for model in models]
    assert sorted(names) == sorted(_core.cooling_kinds())


def test_air_with_nothing_else_set_is_todays_march_to_the_last_bit() -> None:
    plain, air = plant_of(cooled(2), [31.0, 44.0], 33.0), plant_of(cooled(2, kind="air"), [31.0, 44.0], 33.0)
    request = np.stack([np.full(24, 60.0), np.full(24, -35.0)], axis=1)
    expected, found = plain.run(request, nodes=True), air.run(request, nodes=True)
    for name in (
        "delivered_kw",
        "soc",
        "temperature_c",
        "node_max_c",
        "battery_loss_kw",
        "node_temperature_c",
    ):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    # 16 packs with 0.033 kg/s each, 250 Pa, 1.2 kg/m3, 40 %.
    np.testing.assert_allclose(found.auxiliary_kw, 16 * 0.033 * 250.0 / (1.2 * 0.4) / 1e3)
    np.testing.assert_array_equal(expected.auxiliary_kw, 0.0)
    assert expected.cooling_kw is None


def test_a_string_of_one_temperature_gives_up_what_ntu_says() -> None:
    system = cooled(**DIRECT)
    flows = plant_of(system, [42.0]).step([0.0], 10.0)
    expected_kw = flow_kw_k(system) * effectiveness(system) * (42.0 - 20.0)
    np.testing.assert_allclose(flows.cooling_kw, expected_kw, rtol=1e-12)


@pytest.mark.parametrize(
    "cooling",
    [
        {"kind": "air"},
        {"kind": "air", "supply_c": 22.0, "loop": {"heat_capacity_kj_k": 900.0, "wall_w_k": 60.0}},
        {"kind": "liquid"},
        {"kind": "liquid", "variable_flow": True, "flow_steps": [0.2], "step_k": 3.0},
        {"kind": "hybrid", "loop": {"heat_capacity_kj_k": 200.0, "source_kw": 6.0, "series": True}},
    ],
)
def test_heat_is_kept_or_carried_off_to_1e_9(cooling: dict[str, Any]) -> None:
    system = cooled(3, **cooling)
    plant = plant_of(system, [24.0, 33.0, 41.0], 36.0)
    rng = np.random.default_rng(7)
    flows = plant.run(rng.uniform(20.0, 80.0, (60, 3)) * np.sign(np.sin(np.arange(60) / 4.0))[:, None])
    assert flows.cooling_kw is not None
    kept_kwh = heat_capacity_kwh_k(system) * (flows.temperature_c[-1] - [24.0, 33.0, 41.0])
    heat_kwh, carried_kwh = 0.25 * flows.battery_loss_kw.sum(axis=0), 0.25 * flows.cooling_kw.sum(axis=0)
    np.testing.assert_allclose(kept_kwh, heat_kwh - carried_kwh, rtol=1e-9, atol=1e-9)


def test_a_room_is_in_the_end_as_warm_as_its_walls_let_through() -> None:
    light = {"specific_heat_j_kgk": 10.0}
    system = cooled(2, light, kind="air", loop={"heat_capacity_kj_k": 60.0, "wall_w_k": 80.0})
    flows = plant_of(system, [25.0, 25.0], 20.0).run(np.full((16, 2), [20.0, 10.0]))
    # Resistance falls slowly with warmth, so the last step stands for the steady state.
    expected_c = 20.0 + 1e3 * (flows.battery_loss_kw[-1].sum() + flows.auxiliary_kw[-1]) / 80.0
    assert flows.coolant_c is not None
    np.testing.assert_allclose(flows.coolant_c[-1], expected_c, rtol=1e-3)
    assert expected_c > 24.0


def test_strings_exchange_heat_through_a_room_as_an_ode_solver_says() -> None:
    spatial = {"nodes": 10, "lateral_u_w_m2k": 40.0, "end_u_w_m2k": 10.0}
    room_kj_k, wall_w_k, ambient_c = 150.0, 90.0, 12.0
    loop = {"heat_capacity_kj_k": room_kj_k, "wall_w_k": wall_w_k}
    system = cooled(2, spatial, kind="air", pressure_pa=0.0, loop=loop)
    strings = [ReferenceString(system.document, 0.5, np.full(10, 25.0)) for _ in range(2)]
    node_kj_k = heat_capacity_kwh_k(system) * 3600.0 / 10

    def slope(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        slopes = []
        for string, nodes_c in zip(strings, (y[:10], y[10:20]), strict=True):
            string.temperature_c = nodes_c
            slopes.append(string.slope(np.zeros(10), y[20]))
        lost_kw = -node_kj_k * np.sum(slopes)
        room = (lost_kw + wall_w_k * (ambient_c - y[20]) / 1e3) / room_kj_k
        return np.concatenate([*slopes, [room]])

    start = np.concatenate([np.full(10, 45.0), np.full(10, 15.0), [30.0]])
    exact = solve_ivp(slope, (0.0, 3600.0), start, method="Radau", rtol=1e-10, atol=1e-10).y[:, -1]
    errors = []
    for step_s in (20.0, 10.0, 5.0):
        plant = plant_of(system, [45.0, 15.0], ambient_c, plant_step_s=step_s)
        flows = plant.step([0.0, 0.0], 3600.0)
        assert flows.node_temperature_c is not None and flows.coolant_c is not None
        found = np.append(flows.node_temperature_c.ravel(), flows.coolant_c)
        errors.append(np.abs(found - exact).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.1)
    assert errors[1] < 0.02
    # The cold string is warmer than ambient could make it: the hot one warmed the room.
    assert exact[10:20].mean() > 15.0 + 0.5


def test_what_leaves_a_string_in_series_enters_the_next() -> None:
    loop = {"heat_capacity_kj_k": 1e4, "series": True}
    system = cooled(3, **DIRECT, loop=loop)
    plant = plant_of(system, [40.0, 40.0, 40.0])
    snapshot = plant.snapshot()
    assert snapshot.coolant is not None
    snapshot.coolant[1] = 30.0
    plant.restore(snapshot)
    flows = plant.step([0.0] * 3, 10.0)
    share = effectiveness(system)
    expected_kw = flow_kw_k(system) * share * 10.0 * (1.0 - share) ** np.arange(3)
    np.testing.assert_allclose(flows.cooling_kw, expected_kw, rtol=1e-9)


def test_a_chiller_takes_heat_and_pump_over_its_coefficient_of_performance() -> None:
    system = cooled(**DIRECT)
    pump = pump_kw(system)
    flows = plant_of(system, [42.0], 30.0).step([0.0], 10.0)
    assert flows.cooling_kw is not None
    heat_kw = flows.cooling_kw[0] + pump
    # Evaporator at 15, condenser at 35 degC.
    np.testing.assert_allclose(flows.auxiliary_kw, pump + heat_kw / (0.4 * 288.15 / 20.0), rtol=1e-9)


def test_the_chiller_is_bypassed_when_it_is_cold_outside() -> None:
    system = cooled(**DIRECT)
    pump = pump_kw(system)
    for ambient_c, part in ((15.0, 0.03), (15.1, 1.0 / 6.0)):
        flows = plant_of(system, [42.0], ambient_c).step([0.0], 10.0)
        assert flows.cooling_kw is not None
        np.testing.assert_allclose(
            flows.auxiliary_kw, pump + part * (flows.cooling_kw[0] + pump), rtol=1e-9, err_msg=str(ambient_c)
        )


def test_fans_take_the_cube_of_their_flow() -> None:
    steps = {"kind": "air", "start_c": 30.0, "dead_band_k": 2.0, "flow_steps": [0.5, 1.0], "step_k": 5.0}
    full = 8 * 0.033 * 250.0 / (1.2 * 0.4) / 1e3
    for start_c, expected_kw in ((29.0, 0.0), (31.0, full / 8.0), (36.0, full)):
        flows = plant_of(cooled(**steps), [start_c], 20.0).step([0.0], 10.0)
        np.testing.assert_allclose(flows.auxiliary_kw, expected_kw, rtol=1e-12, err_msg=str(start_c))


def test_a_thermostat_starts_above_its_start_and_ends_a_dead_band_below() -> None:
    plant = plant_of(cooled(kind="liquid"), [29.0], 35.0)
    on, mean_c = [], []
    for step in range(4000):
        flows = plant.step([-60.0 if step % 600 < 300 else 60.0], 10.0)
        assert flows.cooling_kw is not None
        on.append(bool(flows.cooling_kw[0] > 0.0))
        mean_c.append(flows.temperature_c[0])
    starts = [at for at in range(1, 4000) if on[at] and not on[at - 1]]
    ends = [at for at in range(1, 4000) if on[at - 1] and not on[at]]
    assert starts and ends
    # Decided by the temperature at the end of the step before.
    assert all(30.0 < mean_c[at - 1] < 30.05 for at in starts)
    assert all(24.9 < mean_c[at - 1] < 25.0 for at in ends)


def test_no_thermostat_lets_coolant_warm_a_string() -> None:
    # The dry cooler makes 40 degC; the string is at 32 and the chiller not yet on.
    flows = plant_of(cooled(kind="hybrid"), [32.0], 35.0).step([0.0], 900.0)
    np.testing.assert_array_equal(flows.cooling_kw, 0.0)
    np.testing.assert_array_equal(flows.auxiliary_kw, 0.0)


def test_a_hybrid_chills_only_while_the_warmest_string_is_too_warm() -> None:
    plant = plant_of(cooled(2, kind="hybrid"), [36.0, 28.0], 22.0)
    first = plant.step([0.0, 0.0], 10.0)
    assert first.coolant_c == 20.0
    later = plant.run(np.zeros((24, 2)))
    assert later.coolant_c is not None
    # Ended 5 K below its start; after that the dry cooler's 27 degC.
    assert later.coolant_c[-1] == 27.0
    assert 25.0 < later.temperature_c[-1, 0] < 30.0


@pytest.mark.parametrize("kind", _core.cooling_kinds())
def test_a_cooled_plant_continues_bit_by_bit_from_a_snapshot(kind: str) -> None:
    loop = {"heat_capacity_kj_k": 400.0, "source_kw": 5.0, "wall_w_k": 20.0}
    system = cooled(2, kind=kind, start_c=30.0, loop=loop)
    request = np.full((40, 2), [70.0, -40.0])
    whole = plant_of(system, [29.5, 27.0], 33.0)
    expected = whole.run(request)
    first = plant_of(system, [29.5, 27.0], 33.0)
    first.run(request[:17])
    second = plant_of(system, [20.0, 20.0], 33.0)
    second.restore(first.snapshot())
    found = second.run(request[17:])
    for name in ("temperature_c", "soc", "auxiliary_kw", "cooling_kw", "coolant_c"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name)[17:], err_msg=name)


def test_scenarios_are_cooled_each_by_itself() -> None:
    system = cooled(2, kind="liquid", loop={"heat_capacity_kj_k": 100.0})
    states = [bess.State([0.5, 0.5], [t, 26.0]) for t in (28.0, 38.0)]
    fleet = bess.PlantEnsemble(system, states, ambient_c=33.0)
    together = fleet.run(np.full((2, 12, 2), 50.0))
    for index, state in enumerate(states):
        alone = bess.Plant(system, state, ambient_c=33.0).run(np.full((12, 2), 50.0))
        np.testing.assert_array_equal(together.temperature_c[index], alone.temperature_c)
        np.testing.assert_array_equal(together.auxiliary_kw[index], alone.auxiliary_kw)


def test_strings_of_different_length_share_one_coolant() -> None:
    document = copy.deepcopy(bess.System.reference(3).document)
    document["string"] = [{}, {"thermal": {"spatial": {"nodes": 24}}}, {}]
    document["cooling"] = DIRECT | {"loop": {"heat_capacity_kj_k": 500.0, "series": True}}
    system = bess.System(document)
    start_c = np.array([38.0, 34.0, 31.0])
    plant = plant_of(system, start_c.tolist(), 35.0)
    flows = plant.run(np.full((20, 3), 40.0))
    assert flows.cooling_kw is not None
    kept_kwh = heat_capacity_kwh_k(system) * (flows.temperature_c[-1] - start_c)
    balance_kwh = 0.25 * (flows.battery_loss_kw - flows.cooling_kw).sum(axis=0)
    np.testing.assert_allclose(kept_kwh, balance_kwh, rtol=1e-9, atol=1e-9)
    assert (np.diff(flows.temperature_c[-1]) > 0.005).all(), "what comes after is warmer"


def test_a_system_with_cooling_reads_back_from_its_own_file() -> None:
    system = cooled(2, kind="hybrid", loop={"heat_capacity_kj_k": 300.0})
    again = bess.System(tomllib.loads(system.to_toml()))
    assert again.cooling == system.cooling
    assert [s.thermal.lumped for s in again.strings] == [s.thermal.lumped for s in system.strings]


def test_the_controllers_model_of_air_is_found_again_by_asking_the_plant() -> None:
    plain, air = cooled(), cooled(kind="air")
    typed, lumped = plain.strings[0].thermal.lumped, air.lumped
    assert lumped is not None
    np.testing.assert_allclose(lumped.k1_k_per_j, typed.k1_k_per_j, rtol=2e-3)
    np.testing.assert_allclose(lumped.k2_per_s, typed.k2_per_s, rtol=0.07)
    ambient_c = np.array([0.0, 20.0, 40.0])
    np.testing.assert_allclose(air.surroundings_c(ambient_c), ambient_c, atol=0.2)
    np.testing.assert_array_equal(plain.surroundings_c(ambient_c), ambient_c)
    assert lumped.error_k.max() < 2e-3


def test_the_controllers_model_follows_the_kind() -> None:
    liquid, hybrid = cooled(kind="liquid"), cooled(kind="hybrid")
    assert liquid.lumped is not None and hybrid.lumped is not None
    # The thermostat holds strings between 25 and 30 degC whatever the ambient.
    assert 24.0 < float(liquid.surroundings_c(np.array(35.0))) < 30.0
    np.testing.assert_allclose(liquid.lumped.ambient_gain, 0.0, atol=0.02)
    assert liquid.strings[0].thermal.lumped.k2_per_s > hybrid.strings[0].thermal.lumped.k2_per_s
    assert hybrid.lumped.ambient_gain[0] > 0.05


def test_a_controller_that_is_told_no_ambient_takes_what_the_strings_cool_towards() -> None:
    system, plain = cooled(kind="liquid"), cooled()
    assert plain.reference_temperature_c == plain.ambient_c
    state, request = bess.State([0.5], [27.0]), [[40.0, 40.0]]
    default = bess.rollout(system, state, request, 0.25)
    told = bess.rollout(system, state, request, 0.25, ambient_c=system.reference_temperature_c)
    np.testing.assert_array_equal(default.temperature_c, told.temperature_c)
    assert bess.split_power(system, state, [40.0]).rollout.temperature_c[0, 0] == default.temperature_c[0, 0]


@pytest.mark.parametrize(
    ("cooling", "message"),
    [
        ({"kind": "ice"}, "'air', 'liquid', 'hybrid'"),
        ({"kind": "air", "chill_c": 30.0}, "cooling.chill_c: unknown key; it is a key of kind 'hybrid'"),
        ({"kind": "air", "strat_c": 30.0}, "cooling.strat_c: unknown key; did you mean 'cooling.start_c'"),
        ({"kind": "air", "flow_kg_s": -1.0}, "cooling.flow_kg_s = -1.0: must be in"),
        ({"kind": "liquid", "flow_steps": [1.0, 0.5]}, "knots must ascend"),
        ({"kind": "liquid", "flow_steps": [0.0]}, "a stage of flow is above 0"),
        ({"kind": "air", "variable_flow": True}, "variable_flow needs start_c"),
        (
            {"kind": "air", "loop": {"heat_capacity_kj_k": 900.0}},
            r"no heat sink; set supply_c, or loop.wall_w_k above 0 W/K",
        ),
        (
            {"kind": "liquid", "loop": {"heat_capacity_kj_k": 1.0}},
            r"heat_capacity_kj_k 1 kJ/K is outside \[13\.32, ",
        ),
        ({"kind": "liquid", "u_w_m2k": 1e5}, "plant step of 10 s is unstable"),
    ],
)
def test_bad_cooling_is_refused_with_key_and_range(cooling: dict[str, Any], message: str) -> None:
    with pytest.raises(bess.InputError, match=message):
        cooled(**cooling)
