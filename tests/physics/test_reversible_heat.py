"""Claims about reversible heat, ``-I T dU/dT``: closed form, an ODE solver, and what it leaves alone."""

import copy
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from plant_reference import ReferenceString
from scipy.integrate import solve_ivp

import bess
from bess.plant import Flows

TABLE = {"soc": [0.0, 0.3, 0.6, 1.0], "du_dt_mv_k": [-0.5, -0.1, 0.2, 0.25]}
SERIES = 192


def with_entropy(table: dict[str, list[float]] | None = TABLE, **spatial: float) -> bess.System:
    document = copy.deepcopy(bess.System.reference(1).document)
    document["thermal"]["spatial"].update(spatial)
    if table is not None:
        document["battery"]["entropy"] = table
    return bess.System(document)


def run(system: bess.System, request_kw: list[float], step_s: float = 900.0) -> Flows:
    plant = bess.Plant(system, bess.State([0.6], [30.0]))
    return plant.run(np.array(request_kw)[:, None], step_s, nodes=True)


def test_heat_of_reaction_is_current_times_temperature_times_entropy_coefficient() -> None:
    for request in (60.0, -60.0):
        flows = run(with_entropy(), [request], 10.0)
        expected_kw = -flows.current_a[0] * (30.0 + 273.15) * SERIES * 0.2e-3 / 1e3
        np.testing.assert_allclose(flows.reversible_heat_kw[0], expected_kw, rtol=1e-12)
        assert np.sign(expected_kw[0]) == -np.sign(request)


def test_it_warms_and_cools_the_cells_as_ohmic_heat_does() -> None:
    flows = run(with_entropy(lateral_u_w_m2k=0.0, end_u_w_m2k=0.0), [70.0, 70.0, -40.0, -40.0])
    spatial = with_entropy().strings[0].thermal.spatial
    volume_m3 = spatial.section_m2 * spatial.length_m * spatial.packs_per_string
    heat_kj = 900.0 * (flows.battery_loss_kw + flows.reversible_heat_kw).sum()
    warming_k = 1e3 * heat_kj / (volume_m3 * spatial.density_kg_m3 * spatial.specific_heat_j_kgk)
    np.testing.assert_allclose(flows.temperature_c[-1, 0] - 30.0, warming_k, rtol=1e-10)


def test_it_is_no_electrical_loss() -> None:
    plain, reversible = run(with_entropy(None), [50.0]), run(with_entropy(), [50.0])
    np.testing.assert_allclose(reversible.ledger_residual_kwh, 0.0, atol=1e-9)
    # Only through temperature, and with it resistance, does it touch the flows.
    np.testing.assert_allclose(reversible.battery_loss_kw, plain.battery_loss_kw, rtol=1e-2)
    np.testing.assert_array_equal(plain.reversible_heat_kw, 0.0)


def test_a_table_of_zeros_changes_no_bit() -> None:
    request = [60.0, -30.0, 0.0, 90.0]
    plain = run(with_entropy(None), request)
    zeros = run(with_entropy({"soc": [0.0, 1.0], "du_dt_mv_k": [0.0, 0.0]}), request)
    for name in ("delivered_kw", "soc", "node_temperature_c", "node_max_c"):
        np.testing.assert_array_equal(getattr(zeros, name), getattr(plain, name), err_msg=name)


def test_the_plant_converges_to_an_ode_solver_at_first_order() -> None:
    system = with_entropy()
    string = ReferenceString(system.document, 0.55, np.full(40, 31.0))
    capacity_as = 3600.0 * 376.0

    def slope(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        string.soc, string.temperature_c = float(y[0]), y[1:]
        node_r = string.node_resistance()
        current, _v = string._current(60e3, string._loss(60e3, False), float(node_r.mean()), False)
        volts_k = 1e-3 * SERIES * np.interp(string.soc, TABLE["soc"], TABLE["du_dt_mv_k"])
        reversible_w = -current * (float(y[1:].mean()) + 273.15) * volts_k
        heat = (current**2 * node_r + reversible_w) / node_r.size
        return np.concatenate(([-current / capacity_as], string.slope(heat, 25.0)))

    start = np.concatenate(([0.55], np.full(40, 31.0)))
    exact = solve_ivp(slope, (0, 600.0), start, method="BDF", rtol=1e-11, atol=1e-12).y[:, -1]
    errors = []
    for step_s in (20.0, 10.0, 5.0):
        plant = bess.Plant(system, bess.State([0.55], [31.0]), plant_step_s=step_s)
        nodes = plant.step([60.0], 600.0).node_temperature_c
        assert nodes is not None
        errors.append(np.abs(nodes[0] - exact[1:]).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 1.0, atol=0.1)
    assert errors[1] < 1e-3


def test_only_strings_with_a_table_have_it() -> None:
    document: dict[str, Any] = copy.deepcopy(bess.System.reference(2).document)
    document["string"] = [{"battery": {"entropy": TABLE}}, {}]
    flows = bess.Plant(bess.System(document), bess.State([0.6, 0.6], [30.0, 30.0])).run(np.full((4, 2), 50.0))
    alone = bess.Plant(with_entropy(None), bess.State([0.6], [30.0])).run(np.full((4, 1), 50.0))
    np.testing.assert_array_equal(flows.temperature_c[:, 1], alone.temperature_c[:, 0])
    assert (flows.reversible_heat_kw[:, 0] != 0.0).all()
    np.testing.assert_array_equal(flows.reversible_heat_kw[:, 1], 0.0)


def test_it_stands_in_the_record_of_a_study_that_has_it() -> None:
    changes = {"system.parameters.battery.entropy": TABLE, "run.days": 0.25}
    data = bess.run(bess.load_study("case1", changes), progress=False).dataset
    assert data["reversible_heat_kw"].dims == ("time", "string")
    assert (
        "reversible_heat_kw"
        not in bess.run(bess.load_study("case1", {"run.days": 0.25}), progress=False).dataset
    )


def test_a_table_that_does_not_fit_is_refused() -> None:
    with pytest.raises(bess.InputError, match="du_dt_mv_k has 1 values, soc has 2"):
        with_entropy({"soc": [0.0, 1.0], "du_dt_mv_k": [0.1]})
    with pytest.raises(bess.InputError, match=r"must be in \[-5, 5\] mV/K"):
        with_entropy({"soc": [0.0, 1.0], "du_dt_mv_k": [0.1, 60.0]})
