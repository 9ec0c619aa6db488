"""Claims about the energy flow: each direction balances, and its parts are those of the key figures."""

import pytest

import bess
from bess.simulation.analysis.energy_flow import EnergyFlow, energy_flow

CASES = {
    "short of energy": {"system.initial_soc": [0.2, 0.6]},
    "cooled": {"system.parameters.cooling": {"kind": "air"}},
    "idle inverters": {"policy.name": "priority", "demand.scale": 0.3},
}


@pytest.fixture(params=CASES, scope="module")
def run(request: pytest.FixtureRequest) -> tuple[dict[str, float], EnergyFlow]:
    values = {"policy.name": "soc", "run.days": 1.0} | CASES[request.param]
    result = bess.run(bess.load_study("case1", values), progress=False)
    return result.kpis, energy_flow(result.dataset)


def test_what_was_asked_is_delivered_or_has_a_reason(run: tuple[dict[str, float], EnergyFlow]) -> None:
    for way in (run[1].charge, run[1].discharge):
        missing = way.unmet_kwh + way.derating_kwh + way.availability_kwh
        assert way.asked_kwh - missing == pytest.approx(way.grid_kwh, abs=1e-9)


def test_grid_and_store_differ_by_the_losses_in_each_direction(
    run: tuple[dict[str, float], EnergyFlow],
) -> None:
    """But for the work of the open-circuit voltage, which is second to every loss (docs/equations.md)."""
    flow = run[1]
    charge, discharge = flow.charge, flow.discharge
    charge_loss, discharge_loss = (
        way.inverter_kwh + way.battery_kwh + way.hysteresis_kwh for way in (charge, discharge)
    )
    assert charge.store_kwh == pytest.approx(charge.grid_kwh - charge_loss, rel=5e-4)
    assert discharge.store_kwh == pytest.approx(discharge.grid_kwh + discharge_loss, rel=5e-4)
    stored = charge.store_kwh - discharge.store_kwh
    shift = charge.grid_kwh - discharge.grid_kwh - charge_loss - discharge_loss - stored
    assert abs(shift) < 1e-3 * flow.taken_kwh


def test_the_parts_add_up_to_the_key_figures(run: tuple[dict[str, float], EnergyFlow]) -> None:
    kpis, flow = run
    for name in ("inverter", "battery", "hysteresis"):
        both = sum(getattr(way, f"{name}_kwh") for way in (flow.charge, flow.discharge))
        beside = flow.standby_kwh if name == "inverter" else 0.0
        assert both + beside == pytest.approx(kpis[f"{name}_loss_kwh"], abs=1e-9)
    assert flow.charge.grid_kwh == pytest.approx(kpis["charged_kwh"])
    assert flow.discharge.grid_kwh == pytest.approx(kpis["discharged_kwh"])
    assert flow.auxiliary_kwh == pytest.approx(kpis["auxiliary_kwh"])
