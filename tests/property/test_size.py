"""A plant of another size: everything is in proportion, to the last bit (powers of two are exact)."""

from __future__ import annotations

import numpy as np
import pytest

import bess

SIZE = 16.0
REFERENCE = {"system.parameters.inverter.min_power_kw": 0.001}
LARGE = {
    "system.parameters.battery.cells_parallel": 4 * int(SIZE),
    "system.parameters.inverter.nominal_kw": 92.0 * SIZE,
    "system.parameters.inverter.min_power_kw": 0.001 * SIZE,
    "system.parameters.thermal.spatial.packs_per_string": 8 * int(SIZE),
    "system.parameters.thermal.lumped.k1_k_per_j": 6.2e-7 / SIZE,
}


CERTIFIED = {"policy.name": "mpc"}
PLAN = {"policy.name": "mpc", "policy.mode": "plan", "policy.objectives": {"kind": "energy"}}


@pytest.mark.parametrize(
    ("study", "policy", "of_demand"),
    [
        ("case1", CERTIFIED, ["demand.scale"]),
        ("case1", PLAN, ["demand.scale"]),
        ("fcr-arbitrage", {"policy.name": "mpc"}, []),
        ("self-consumption", {"policy.name": "mpc"}, ["demand.scale", "demand.pv_scale"]),
    ],
    ids=["certified split", "plan", "reserve and trade", "behind a meter"],
)
def test_a_plant_of_sixteen_times_the_size_does_the_same_sixteen_times(
    study: str, policy: dict[str, object], of_demand: list[str]
) -> None:
    """A constant in kW, kWh or EUR would show."""
    values = {"run.days": 0.75, **policy}
    small, large = (
        bess.run(
            bess.load_study(study, {**system, **values, **dict.fromkeys(of_demand, size)}), progress=False
        )
        for system, size in ((REFERENCE, 1.0), (LARGE, SIZE))
    )
    assert float(np.abs(small.dataset["request_kw"]).max()) > 10.0
    for name in ("request_kw", "delivered_kw", "battery_loss_kw"):
        np.testing.assert_array_equal(large.dataset[name], SIZE * small.dataset[name], err_msg=name)
    for name in ("soc", "temperature_c", "inverter_starts"):
        np.testing.assert_array_equal(large.dataset[name], small.dataset[name], err_msg=name)
    assert large.kpis.get("net_eur", 0.0) == pytest.approx(SIZE * small.kpis.get("net_eur", 0.0), rel=1e-9)
