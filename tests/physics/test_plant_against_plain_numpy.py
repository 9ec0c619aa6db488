"""Claim: the plant does what its specification says, as an independent scalar implementation shows."""

import copy
from typing import Any, Literal

import numpy as np
import pytest
from plant_reference import ReferenceString

import bess

pytestmark = pytest.mark.independent

FLOWS = {
    "delivered_kw": "delivered",
    "availability_loss_kw": "availability",
    "derating_loss_kw": "derating",
    "inverter_loss_kw": "inverter",
    "battery_loss_kw": "battery",
    "hysteresis_loss_kw": "hysteresis",
    "chemical_kw": "chemical",
}


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return copy.deepcopy(bess.System.reference(1).document)


@pytest.mark.parametrize(
    ("soc", "temperature_c", "request_kw", "law"),
    [
        (0.5, 25.0, [46.0, 46.0, -92.0], "table"),
        (0.5, 33.0, [-5.0, 0.0, 20.0], "table"),
        (0.03, 40.0, [92.0, 92.0, 0.0, -30.0], "table"),
        (0.08, 52.0, [60.0, 60.0, 60.0], "table"),
        (0.98, 47.0, [-92.0, -92.0, -92.0, 92.0], "table"),
        (0.9999, 30.0, [-92.0, -0.5, 3.0], "table"),
        (0.0, 30.0, [-1.0, 20.0, -0.2, -50.0], "table"),
        (0.6, 47.0, [92.0, 92.0, -92.0, -92.0], "pi"),
    ],
)
def test_flows_and_state_equal_those_of_a_plain_numpy_plant(
    document: dict[str, Any],
    soc: float,
    temperature_c: float,
    request_kw: list[float],
    law: Literal["table", "pi"],
) -> None:
    plant = bess.Plant(
        bess.System(document), bess.State([soc], [temperature_c]), derating_law=law, ambient_c=22.0
    )
    nodes = document["thermal"]["spatial"]["nodes"]
    oracle = ReferenceString(document, soc, np.full(nodes, temperature_c), pi_law=law == "pi")
    for request in request_kw:
        flows = plant.step([request])
        expected = oracle.control_step(1e3 * request, 22.0)
        for name, key in FLOWS.items():
            np.testing.assert_allclose(
                getattr(flows, name), expected[key] / 1e3, rtol=1e-7, atol=1e-6, err_msg=name
            )
        np.testing.assert_allclose(flows.soc, oracle.soc, rtol=0, atol=1e-9)
        assert flows.node_temperature_c is not None
        np.testing.assert_allclose(flows.node_temperature_c[0], oracle.temperature_c, rtol=0, atol=1e-8)
        np.testing.assert_allclose(flows.derating_factor, expected["factor"], rtol=1e-9)


@pytest.mark.parametrize(
    ("soc", "request_kw", "limit_v"),
    [(0.95, [-92.0, -92.0, -20.0, 92.0], 4.15), (0.12, [60.0, 60.0, 92.0, -92.0], 3.3)],
)
def test_voltage_limits_cut_the_power_so_that_the_terminals_stay_within(
    document: dict[str, Any], soc: float, request_kw: list[float], limit_v: float
) -> None:
    battery = document["battery"] | {"cell_voltage_min_v": 3.3, "cell_voltage_max_v": 4.15}
    limited = document | {"battery": battery}
    system = bess.System(limited)
    plant = bess.Plant(system, bess.State([soc], [25.0]), ambient_c=22.0)
    oracle = ReferenceString(limited, soc, np.full(document["thermal"]["spatial"]["nodes"], 25.0))
    bound = []
    for request in request_kw:
        flows, expected = plant.step([request]), oracle.control_step(1e3 * request, 22.0)
        for name, key in FLOWS.items():
            np.testing.assert_allclose(
                getattr(flows, name), expected[key] / 1e3, rtol=1e-7, atol=1e-6, err_msg=name
            )
        np.testing.assert_allclose(flows.soc, oracle.soc, rtol=0, atol=1e-9)
        bound.append(bool(flows.limits[0] & bess.plant.Limit.VOLTAGE))
    assert bound == [True, True, request_kw[2] > 0.0, False]
    again = bess.Plant(system, bess.State([soc], [25.0]))
    ends = [again.step([request_kw[0]], 10.0) for _ in range(90)]
    last, ocv = ends[-1], document["battery"]["ocv_v"]
    table = ocv["charge" if request_kw[0] < 0.0 else "discharge"]
    open_v = 192 * np.interp(ends[-2].soc[0], ocv["soc"], table)
    r_ohm = 1e3 * last.battery_loss_kw[0] / last.current_a[0] ** 2
    assert (open_v - r_ohm * last.current_a[0]) / 192 == pytest.approx(limit_v, rel=1e-6)


def test_measured_resistance_is_read_at_the_current_that_flows(document: dict[str, Any]) -> None:
    battery = document["battery"]
    for key in ("resistance_temperature", "resistance_soc"):
        del battery[key]

    def cell_mohm(c_rate: float, temperature_c: float, soc: float) -> float:
        return (3.0 - 0.4 * c_rate) * (1.0 - 0.01 * (temperature_c - 25.0)) * (1.0 + 0.3 * soc)

    soc, temperature, c_rate = [0.0, 1.0], [0.0, 60.0], [0.1, 2.0]
    table = [[[cell_mohm(c, t, s) for s in soc] for t in temperature] for c in c_rate]
    battery["resistance_table"] = {
        "soc": soc,
        "temperature_c": temperature,
        "c_rate": c_rate,
        "control_c_rate": 0.3,
        "charge_mohm": table,
        "discharge_mohm": table,
    }
    plant = bess.Plant(bess.System(document), bess.State([0.5], [30.0]))
    flows = plant.step([92.0], 10.0)
    current = flows.current_a[0]
    # Linear in each of soc, temperature and C-rate, so the table is exact everywhere.
    r_ohm = 1e-3 * 192 / 4 * cell_mohm(current / 376.0, 30.0, 0.5)
    v = 192 * 3.686
    np.testing.assert_allclose(
        v * current - r_ohm * current**2, 1e3 * (92.0 + flows.inverter_loss_kw[0]), rtol=1e-9
    )
    np.testing.assert_allclose(1e3 * flows.battery_loss_kw[0], r_ohm * current**2, rtol=1e-7)
