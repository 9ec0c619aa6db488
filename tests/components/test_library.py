"""Physics of every bundled component: a new cell or inverter is tested by being registered."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import bess
from bess.system.components import list_cells, list_inverters, list_systems
from bess.system.components.registry import CELLS, INVERTERS, SYSTEMS

BASE = bess.System.reference().document


def string_with(section: str, **keys: Any) -> bess.System:
    """One string of the reference plant with another component."""
    document = copy.deepcopy(BASE)
    document["system"]["n_strings"] = 1
    document["string"] = [{section: keys}]
    return bess.System(document)


def string_of_cell(cell: str, **keys: Any) -> bess.System:
    """About 700 V and 376 Ah of a bundled cell, behind the reference inverter."""
    tables = string_with("battery", cell=cell, **keys).strings[0].battery
    volts = np.interp(0.5, tables.ocv_v.soc, tables.ocv_v.discharge[0])
    return string_with(
        "battery",
        cell=cell,
        cells_series=round(700.0 / float(volts)),
        cells_parallel=round(376.0 / tables.cell_capacity_ah),
        **keys,
    )


def start(soc: float, temperature_c: float = 25.0) -> bess.State:
    return bess.State(soc=[soc], temperature_c=[temperature_c])


@pytest.mark.parametrize("entry", [*list_systems(), *list_cells(), *list_inverters()], ids=lambda e: e.name)
def test_every_entry_says_what_it_is_where_it_comes_from_and_under_which_terms(entry: Any) -> None:
    assert min(map(len, (entry.description, entry.source, entry.licence))) > 10


@pytest.mark.parametrize("cell", CELLS)
def test_a_round_trip_closes_the_ledger_and_loses_energy(cell: str) -> None:
    plant = bess.Plant(string_of_cell(cell), start(0.6))
    flows = plant.run(np.repeat([[40.0], [0.0], [-40.0]], 4, axis=0), 900.0)
    throughput_kwh = np.abs(flows.delivered_kw).sum() * 0.25
    assert throughput_kwh == pytest.approx(80.0)
    assert np.abs(flows.ledger_residual_kwh).sum() <= 1e-9 * throughput_kwh
    assert (flows.battery_loss_kw[[0, -1]] > 0.0).all()
    assert plant.state.soc[0] < 0.6, "equal AC energy back and forth leaves a string emptier"


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(("power_kw", "limit"), [(92.0, 0.0), (-92.0, 1.0)])
def test_a_string_stops_at_the_end_of_its_window_and_reports_what_it_sheds(
    cell: str, power_kw: float, limit: float
) -> None:
    plant = bess.Plant(string_of_cell(cell), start(0.5))
    flows = plant.run(np.full((16, 1), power_kw), 900.0)
    assert ((flows.soc >= 0.0) & (flows.soc <= 1.0)).all()
    shed = flows.availability_loss_kw + flows.derating_loss_kw
    np.testing.assert_allclose(np.abs(flows.delivered_kw) + shed, 92.0, rtol=1e-12)
    assert flows.availability_loss_kw[-1, 0] > 20.0
    assert plant.state.soc[0] == pytest.approx(limit, abs=0.05)


@pytest.mark.parametrize("cell", CELLS)
def test_an_aged_cell_is_hotter_by_its_resistance(cell: str) -> None:
    heat = [
        bess.Plant(string_of_cell(cell, r_scale=scale), start(0.6)).step([20.0]).battery_loss_kw[0]
        for scale in (1.0, 1.5)
    ]
    assert heat[1] == pytest.approx(1.5 * heat[0], rel=0.03)


@pytest.mark.parametrize("cell", CELLS)
def test_the_open_circuit_voltage_rises_with_soc_and_charge_lies_above_discharge(cell: str) -> None:
    ocv = string_of_cell(cell).strings[0].battery.ocv_v
    charge, discharge = np.array(ocv.charge), np.array(ocv.discharge)
    assert (np.diff(charge, axis=1) > 0.0).all()
    assert (np.diff(discharge, axis=1) > 0.0).all()
    assert (charge > discharge).all()


def test_iron_phosphate_is_the_flat_counter_chemistry() -> None:
    def rise_v(cell: str) -> float:
        ocv = string_of_cell(cell).strings[0].battery.ocv_v
        return float(np.ptp(np.interp([0.3, 0.8], ocv.soc, ocv.discharge[0])))

    assert rise_v("sony-lfp-3ah") < 0.08 < 0.25 < rise_v("samsung-94ah")


@pytest.mark.parametrize("model", INVERTERS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_plant_loses_what_the_inverter_table_says(model: str, sign: float) -> None:
    system = string_with("inverter", model=model, nominal_kw=92.0)
    table = system.strings[0].inverter
    losses = table.loss_discharge if sign > 0.0 else table.loss_charge
    for load in (0.05, 0.37, 1.0):
        flows = bess.Plant(system, start(0.5)).step([sign * load * 92.0], 10.0)
        assert flows.inverter_loss_kw[0] == pytest.approx(
            92.0 * np.interp(load, table.load, losses), rel=1e-9
        )
        assert 0.4 < 1.0 - flows.inverter_loss_kw[0] / (load * 92.0) < 1.0


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_bundled_system_runs_a_day_and_closes_its_ledger(name: str) -> None:
    system = bess.load_system(name)
    hours = np.sin(np.linspace(0.0, 4.0 * np.pi, 96))
    flows = bess.Plant(system, system.initial_state()).run(0.6 * hours[:, None] * system.nominal_kw, 900.0)
    assert np.isfinite(flows.temperature_c).all()
    assert np.abs(flows.ledger_residual_kwh).sum() <= 1e-9 * np.abs(flows.delivered_kw).sum() * 0.25
