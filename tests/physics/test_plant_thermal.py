"""Claims about heat along the air path, against the analytic slab, closed forms and an ODE solver."""

import copy
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from plant_reference import ReferenceString
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import bess

pytestmark = pytest.mark.closed_form


def with_thermal(**changes: float) -> bess.System:
    document = copy.deepcopy(bess.System.reference(1).document)
    document["thermal"]["spatial"].update(changes)
    return bess.System(document)


def idle_nodes(
    system: bess.System, start_c: float, ambient_c: float, seconds: float, step_s: float
) -> NDArray[np.float64]:
    plant = bess.Plant(system, bess.State([0.5], [start_c]), plant_step_s=step_s, ambient_c=ambient_c)
    nodes = plant.step([0.0], seconds).node_temperature_c
    assert nodes is not None
    return np.asarray(nodes[0])


def slab_c(x_m: NDArray[np.float64], seconds: float, spatial: Any, start_c: float, air_c: float) -> Any:
    """Slab cooled by convection on both faces (Incropera, eq. 5.42): 40 terms of the series."""
    half = spatial.length_m / 2
    diffusivity = spatial.conductivity_w_mk / (spatial.density_kg_m3 * spatial.specific_heat_j_kgk)
    biot = spatial.end_u_w_m2k * half / spatial.conductivity_w_mk
    theta = np.zeros_like(x_m)
    for n in range(40):
        zeta = brentq(lambda z: z * np.sin(z) - biot * np.cos(z), n * np.pi + 1e-12, n * np.pi + np.pi / 2)
        weight = 4 * np.sin(zeta) / (2 * zeta + np.sin(2 * zeta))
        theta += (
            weight * np.exp(-(zeta**2) * diffusivity * seconds / half**2) * np.cos(zeta * (x_m - half) / half)
        )
    return air_c + (start_c - air_c) * theta


SLAB = {"length_m": 0.4, "conductivity_w_mk": 50.0, "end_u_w_m2k": 200.0, "lateral_u_w_m2k": 0.0}


def slab_error(nodes: int, step_s: float) -> float:
    system = with_thermal(**SLAB, nodes=nodes)
    x_m = (np.arange(nodes) + 0.5) * SLAB["length_m"] / nodes
    exact = slab_c(x_m, 1600.0, system.strings[0].thermal.spatial, 60.0, 20.0)
    return float(np.abs(idle_nodes(system, 60.0, 20.0, 1600.0, step_s) - exact).max())


def test_a_cooling_slab_follows_the_analytic_series() -> None:
    assert slab_error(nodes=80, step_s=0.1) < 0.003


def test_the_scheme_is_second_order_in_space() -> None:
    # The time step falls with the square of the node width, so its first-order error falls at the same rate.
    errors = [slab_error(nodes, 16.0 * (10 / nodes) ** 2) for nodes in (10, 20, 40)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def cooling_ode(system: bess.System, start_c: float, ambient_c: float, seconds: float) -> NDArray[np.float64]:
    nodes = system.strings[0].thermal.spatial.nodes
    string = ReferenceString(system.document, 0.5, np.full(nodes, start_c))

    def slope(_: float, temperature_c: NDArray[np.float64]) -> NDArray[np.float64]:
        string.temperature_c = temperature_c
        return string.slope(np.zeros(nodes), ambient_c)

    solution = solve_ivp(slope, (0, seconds), np.full(nodes, start_c), method="BDF", rtol=1e-11, atol=1e-11)
    return np.asarray(solution.y[:, -1])


COOLING = {"lateral_u_w_m2k": 40.0, "conductivity_w_mk": 50.0, "end_u_w_m2k": 60.0}


def test_cooling_by_air_is_first_order_in_time_against_an_ode_solver() -> None:
    system = with_thermal(**COOLING)
    exact = cooling_ode(system, 50.0, 15.0, 7200.0)
    errors = [
        np.abs(idle_nodes(system, 50.0, 15.0, 7200.0, step) - exact).max() for step in (20.0, 10.0, 5.0)
    ]
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.05)
    assert errors[1] < 0.02


def test_cooling_by_air_is_second_order_in_space_against_an_ode_solver() -> None:
    # Cells are compared by their averages on a grid four times finer than the finest. The time step falls as
    # the square of the node width.
    fine = cooling_ode(with_thermal(**COOLING, nodes=160), 50.0, 15.0, 7200.0)
    errors = []
    for nodes in (10, 20, 40):
        coarse = idle_nodes(
            with_thermal(**COOLING, nodes=nodes), 50.0, 15.0, 7200.0, 32.0 * (10 / nodes) ** 2
        )
        errors.append(np.abs(coarse - fine.reshape(nodes, -1).mean(axis=1)).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.2)


def test_the_coupled_plant_converges_to_an_ode_solver_at_first_order() -> None:
    system = bess.System.reference(1)
    string = ReferenceString(system.document, 0.45, np.full(40, 31.0))
    capacity_as = 3600.0 * 376.0

    def slope(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        string.soc, string.temperature_c = float(y[0]), y[1:]
        node_r = string.node_resistance()
        current, _v = string._current(60e3, string._loss(60e3, False), float(node_r.mean()), False)
        heat = current**2 * node_r / node_r.size
        return np.concatenate(([-current / capacity_as], string.slope(heat, 25.0)))

    start = np.concatenate(([0.45], np.full(40, 31.0)))
    exact = solve_ivp(slope, (0, 600.0), start, method="BDF", rtol=1e-11, atol=1e-12).y[:, -1]
    errors = []
    for step_s in (20.0, 10.0, 5.0):
        plant = bess.Plant(system, bess.State([0.45], [31.0]), plant_step_s=step_s)
        flows = plant.step([60.0], 600.0)
        assert flows.node_temperature_c is not None
        errors.append([abs(flows.soc[0] - exact[0]), np.abs(flows.node_temperature_c[0] - exact[1:]).max()])
    ratios = np.array(errors[:-1]) / errors[1:]
    np.testing.assert_allclose(np.log2(ratios), 1.0, atol=0.1)
    assert errors[1][1] < 1e-3


def test_without_cooling_all_heat_warms_the_cells() -> None:
    system = with_thermal(lateral_u_w_m2k=0.0, end_u_w_m2k=0.0)
    flows = bess.Plant(system, bess.State([0.6], [28.0])).run(np.full((8, 1), 70.0))
    spatial = system.strings[0].thermal.spatial
    volume_m3 = spatial.section_m2 * spatial.length_m * spatial.packs_per_string
    heat_j = flows.battery_loss_kw.sum() * 1e3 * 900.0
    warming_k = heat_j / (volume_m3 * spatial.density_kg_m3 * spatial.specific_heat_j_kgk)
    np.testing.assert_allclose(flows.temperature_c[-1, 0] - 28.0, warming_k, rtol=1e-10)


def test_an_unstable_plant_step_is_refused_and_the_named_one_is_accepted() -> None:
    system = with_thermal(nodes=160)
    state = bess.State([0.5], [25.0])
    with pytest.raises(bess.InputError, match=r"2 Fo \+ lateral = .* use at most (?P<s>[0-9.]+) s") as caught:
        bess.Plant(system, state, plant_step_s=120.0)
    diffusivity, lateral = 1.0 / 2158e3, 1.9 * 0.96 / (2158e3 * 0.05839)
    largest_s = float(str(caught.value).split("use at most ")[1].split(" s")[0])
    np.testing.assert_allclose(largest_s, 1.0 / (2.0 * diffusivity / 0.01**2 + lateral), rtol=1e-5)
    assert bess.Plant(system, state, plant_step_s=largest_s).plant_step_s == largest_s
