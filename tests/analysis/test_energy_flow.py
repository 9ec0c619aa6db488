"""Claims about the energy flow: each direction balances, and its parts are those of the key figures."""

import pytest

import bess
from bess.simulation.analysis.energy_flow import energy_flow

Flow = dict[str, dict[str, float]]
CASES = {
    "short of energy": {"system.initial_soc": [0.2, 0.6]},
    "cooled": {"system.parameters.cooling": {"kind": "air"}},
    "idle inverters": {"policy.name": "priority", "demand.scale": 0.3},
}


@pytest.fixture(params=CASES, scope="module")
def run(request: pytest.FixtureRequest) -> tuple[dict[str, float], Flow]:
    values = {"policy.name": "soc", "run.days": 1.0} | CASES[request.param]
    result = bess.run(bess.load_study("case1", values), progress=False)
    return result.kpis, energy_flow(result.dataset)


def test_what_was_asked_is_delivered_or_has_a_reason(run: tuple[dict[str, float], Flow]) -> None:
    for way in (run[1]["charge"], run[1]["discharge"]):
        missing = way["unmet"] + way["derating"] + way["availability"]
        assert way["asked"] - missing == pytest.approx(way["grid"], abs=1e-9)


def test_grid_and_store_differ_by_the_losses_in_each_direction(
    run: tuple[dict[str, float], Flow],
) -> None:
    """But for the work of the open-circuit voltage, which is second to every loss (docs/equations.md)."""
    charge, discharge, beside = (run[1][part] for part in ("charge", "discharge", "beside"))
    charge_loss, discharge_loss = (
        way["inverter"] + way["battery"] + way["hysteresis"] for way in (charge, discharge)
    )
    assert charge["store"] == pytest.approx(charge["grid"] - charge_loss, rel=5e-4)
    assert discharge["store"] == pytest.approx(discharge["grid"] + discharge_loss, rel=5e-4)
    stored = charge["store"] - discharge["store"]
    shift = charge["grid"] - discharge["grid"] - charge_loss - discharge_loss - stored
    assert abs(shift) < 1e-3 * (charge["grid"] + beside["standby"] + beside["auxiliary"])


def test_the_parts_add_up_to_the_key_figures(run: tuple[dict[str, float], Flow]) -> None:
    kpis, flow = run
    for name in ("inverter", "battery", "hysteresis"):
        both = flow["charge"][name] + flow["discharge"][name]
        beside = flow["beside"]["standby"] if name == "inverter" else 0.0
        assert both + beside == pytest.approx(kpis[f"{name}_loss_kwh"], abs=1e-9)
    assert flow["charge"]["grid"] == pytest.approx(kpis["charged_kwh"])
    assert flow["discharge"]["grid"] == pytest.approx(kpis["discharged_kwh"])
    assert flow["beside"]["auxiliary"] == pytest.approx(kpis["auxiliary_kwh"])
