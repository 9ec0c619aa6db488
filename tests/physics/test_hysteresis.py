"""Claims about hysteresis: a loss of its own, beside chemical energy, which is a function of state."""

import copy
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import bess
from bess.plant import Flows

Array = NDArray[np.float64]

REACTIVE = [40.0, 0.0, -60.0]
"""Reactive power of three strings [kvar]."""


def reference(n_strings: int = 1, **sections: dict[str, Any]) -> bess.System:
    document = copy.deepcopy(bess.System.reference(n_strings).document)
    for name, values in sections.items():
        document.setdefault(name, {}).update(values)
    return bess.System(document)


def chemical_kwh(system: bess.System, soc: Array, soh_capacity: Array | float = 1.0) -> Array:
    """Capacity times the integral of the mean of both open-circuit voltages at 25 degC, by trapezia."""
    out = []
    for string, at in zip(system.strings, np.moveaxis(soc, -1, 0), strict=True):
        battery, table = string.battery, string.battery.ocv_v
        rows = np.array([np.add(c, d) / 2 for c, d in zip(table.charge, table.discharge, strict=True)])
        mean_v = np.array([np.interp(25.0, table.temperature_c, column) for column in rows.T])
        areas = np.diff(table.soc) * (mean_v[1:] + mean_v[:-1]) / 2

        def volts(value: float, table: Any = table, mean_v: Any = mean_v, areas: Any = areas) -> float:
            below = int(np.searchsorted(table.soc[1:-1], value, side="right"))
            here = np.interp(value, table.soc, mean_v)
            return float(areas[:below].sum() + (value - table.soc[below]) * (mean_v[below] + here) / 2)

        size = 1e-3 * battery.cells_series * battery.cells_parallel * battery.cell_capacity_ah
        out.append(size * np.vectorize(volts)(at))
    return np.stack(out, axis=-1) * soh_capacity


def half_gap_v(system: bess.System, soc: float) -> float:
    battery = system.strings[0].battery
    gap = np.subtract(battery.ocv_v.charge[0], battery.ocv_v.discharge[0])
    return 0.5 * battery.cells_series * float(np.interp(soc, battery.ocv_v.soc, gap))


def cycled(
    cycles: int, low: float = 0.2, high: float = 0.8, power_kw: float = 46.0
) -> tuple[bess.System, Flows]:
    """A reference string between two SOC, plant step by plant step."""
    system = reference()
    plant = bess.Plant(system, bess.State([low], [25.0]))
    flows, sign, left = [], -1.0, 2 * cycles
    while left:
        flows.append(plant.step([sign * power_kw], 10.0))
        if not low < flows[-1].soc[0] < high and (flows[-1].soc[0] - 0.5) * sign < 0.0:
            sign, left = -sign, left - 1
    names = [name for name, value in vars(flows[0]).items() if value is not None]
    stacked = {name: np.stack([getattr(each, name) for each in flows]) for name in names}
    return system, Flows(**{**vars(flows[0]), **stacked})


def record(flows: Flows, step_h: float) -> xr.Dataset:
    names = (
        "delivered_kw",
        "standby_kw",
        "chemical_kw",
        "hysteresis_loss_kw",
        "inverter_loss_kw",
        "battery_loss_kw",
    )
    names += (
        "soc",
        "temperature_c",
        "node_max_c",
        "availability_loss_kw",
        "derating_loss_kw",
        "inverter_starts",
    )
    data = xr.Dataset({name: (("time", "string"), getattr(flows, name)) for name in names})
    data["request_kw"] = data["delivered_kw"]
    data["demand_kw"] = data["delivered_kw"].sum("string")
    zero = xr.zeros_like(data["demand_kw"])
    zeros = ("unmet_kw", "fallback", "solver_status", "solver_gap", "solver_search_gap", "solver_nodes")
    start = {"initial_soc": np.array([0.2]), "initial_temperature_c": np.array([25.0])}
    data = data.assign(
        dict.fromkeys(zeros, zero) | {"ledger_residual_kwh": ("time", flows.ledger_residual_kwh)}
    )
    return data.assign_attrs(step_h=step_h, **start)


def test_twenty_cycles_come_back_with_what_the_meter_says() -> None:
    _, flows = cycled(20)
    delivered_kw = flows.delivered_kw
    meter_pct = 100.0 * delivered_kw[delivered_kw > 0.0].sum() / -delivered_kw[delivered_kw < 0.0].sum()
    kpis = bess.kpis(record(flows, 10.0 / 3600.0))
    assert meter_pct == pytest.approx(92.60, abs=0.005)
    assert kpis["round_trip_efficiency_pct"] == pytest.approx(meter_pct, abs=0.005)
    assert kpis["hysteresis_loss_kwh"] == pytest.approx(13.87, abs=0.01)


def test_a_different_charge_at_the_end_is_no_loss_of_the_round_trip() -> None:
    """One cycle and half an hour of charge more, in which the colder string resists more."""
    _, flows = cycled(2)
    last = int(np.argmax(np.diff(np.sign(flows.delivered_kw[:, 0])) < 0.0))  # the first turn to charge
    whole, longer = record(flows, 1.0 / 360.0), record(flows, 1.0 / 360.0).isel(time=slice(0, last + 300))
    of_whole, of_longer = (bess.kpis(data)["round_trip_efficiency_pct"] for data in (whole, longer))
    assert of_longer == pytest.approx(of_whole, abs=0.2)
    given, taken = (
        np.maximum(longer["delivered_kw"], 0.0).sum(),
        np.maximum(-longer["delivered_kw"], 0.0).sum(),
    )
    assert 100.0 * given / taken < of_whole - 5.0


@pytest.mark.parametrize("request_kw", [60.0, -60.0])
def test_hysteresis_is_current_times_half_the_gap_in_either_direction(request_kw: float) -> None:
    system = reference()
    flows = bess.Plant(system, bess.State([0.37], [30.0])).step([request_kw], 10.0)
    expected_kw = 1e-3 * np.abs(flows.current_a) * half_gap_v(system, 0.37)
    np.testing.assert_allclose(flows.hysteresis_loss_kw, expected_kw, rtol=1e-12)
    assert expected_kw[0] > 0.1


def kept_kwh(flows: Flows, step_h: float) -> Array:
    """What the grid gave that did not become heat, hysteresis or inverter loss."""
    losses_kw = flows.inverter_loss_kw + flows.battery_loss_kw + flows.hysteresis_loss_kw
    return step_h * (flows.standby_kw - flows.delivered_kw - losses_kw + flows.ocv_shift_kw)


table = {
    "temperature_c": [10.0, 25.0, 45.0],
    "soc": [0.0, 0.1, 0.45, 1.0],
    "charge": [[3.1, 3.5, 3.7, 4.1], [3.15, 3.52, 3.7, 4.1], [3.2, 3.53, 3.72, 4.1]],
    "discharge": [[3.0, 3.45, 3.7, 4.08], [3.1, 3.47, 3.66, 4.08], [3.15, 3.5, 3.66, 4.1]],
}
entropy = {"entropy": {"soc": [0.0, 0.5, 1.0], "du_dt_mv_k": [-0.4, 0.1, 0.3]}}
cooled = {"kind": "liquid", "start_c": 20.0, "flow_kg_s": 0.05, "supply_c": 15.0}
VARIANTS: dict[str, dict[str, dict[str, Any]]] = {
    "reference": {},
    "standby": {"inverter": {"off_loss": 3e-4}},
    "hysteresis heat": {"battery": {"hysteresis_heat": True}},
    "entropy": {"battery": entropy},
    "entropy and hysteresis heat": {"battery": entropy | {"hysteresis_heat": True}},
    "voltages over temperature": {"battery": {"ocv_v": table}},
    "voltage limits": {"battery": {"cell_voltage_min_v": 3.55, "cell_voltage_max_v": 3.95}},
    "ageing": {"wear": {"model": "kokam-75ah"}},
    "cooling": {"cooling": cooled},
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("reactive", [False, True], ids=["active power", "reactive power"])
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_balance_closes_by_the_energy_of_the_state_at_start_and_end(
    variant: str, reactive: bool, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    system = reference(3, **VARIANTS[variant])
    start = bess.State(rng.uniform(0.0, 1.0, 3), rng.uniform(0.0, 50.0, 3))
    request = rng.uniform(-92.0, 92.0, (40, 1)) * rng.uniform(0.0, 1.0, (40, 3)) * (rng.random((40, 1)) < 0.8)
    # Reactive power beside less active power, so that both fit.
    asked = np.tile(REACTIVE, (40, 1)) if reactive else None
    flows = bess.Plant(system, start).run(request, reactive_kvar=asked)
    soc = np.concatenate([start.soc[None], flows.soc])
    health = np.concatenate([start.soh_capacity[None], flows.soh_capacity])[:-1]
    # Capacity changes at the end of a step: the charge that goes with it is lost, and no flow.
    gained = chemical_kwh(system, soc[1:], health) - chemical_kwh(system, soc[:-1], health)
    np.testing.assert_allclose(-0.25 * flows.chemical_kw, gained, atol=1e-9)
    np.testing.assert_allclose(kept_kwh(flows, 0.25), gained, atol=1e-9)
    np.testing.assert_allclose(flows.ledger_residual_kwh, 0.0, atol=1e-9)
    assert (flows.hysteresis_loss_kw >= 0.0).all()


def test_the_shift_of_the_voltage_is_of_first_order_in_the_plant_step() -> None:
    system, shifts = reference(), []
    for step_s in (20.0, 10.0, 5.0):
        plant = bess.Plant(system, bess.State([0.9], [25.0]), plant_step_s=step_s)
        flows = plant.run(np.full((16, 1), 46.0))
        shifts.append(flows.ocv_shift_kw.sum() / flows.delivered_kw.sum())
    np.testing.assert_allclose(np.log2(np.array(shifts[:-1]) / shifts[1:]), 1.0, atol=0.02)
    assert 2e-5 < shifts[1] < 6e-5


def test_hysteresis_warms_the_string_only_where_the_system_says_so() -> None:
    adiabatic = {"thermal": {"spatial": reference().strings[0].thermal.spatial.model_dump()}}
    adiabatic["thermal"]["spatial"] |= {"lateral_u_w_m2k": 0.0, "end_u_w_m2k": 0.0}
    adiabatic["thermal"]["lumped"] = reference().document["thermal"]["lumped"]
    flows = {}
    for heats in (False, True):
        system = reference(battery={"hysteresis_heat": heats}, **adiabatic)
        flows[heats] = bess.Plant(system, bess.State([0.5], [30.0])).run([[50.0], [50.0], [-70.0], [-70.0]])
        spatial = system.strings[0].thermal.spatial
        volume_m3 = spatial.section_m2 * spatial.length_m * spatial.packs_per_string
        heat_kw = flows[heats].battery_loss_kw + heats * flows[heats].hysteresis_loss_kw
        warming_k = 900e3 * heat_kw.sum() / (volume_m3 * spatial.density_kg_m3 * spatial.specific_heat_j_kgk)
        assert flows[heats].temperature_c[-1, 0] - 30.0 == pytest.approx(warming_k, rel=1e-10)
    assert flows[True].temperature_c[-1, 0] - flows[False].temperature_c[-1, 0] > 0.1


def test_only_a_string_that_says_so_is_warmed() -> None:
    document = copy.deepcopy(bess.System.reference(2).document)
    document["string"] = [{"battery": {"hysteresis_heat": True}}, {}]
    state = bess.State([0.6, 0.6], [30.0, 30.0])
    flows = bess.Plant(bess.System(document), state).run(np.full((4, 2), 50.0))
    alone = bess.Plant(reference(), bess.State([0.6], [30.0])).run(np.full((4, 1), 50.0))
    np.testing.assert_array_equal(flows.temperature_c[:, 1], alone.temperature_c[:, 0])
    assert (flows.temperature_c[:, 0] > flows.temperature_c[:, 1]).all()


def test_it_stands_in_record_and_key_figures_of_a_study() -> None:
    plain, heated = (
        bess.run(bess.load_study("case1", {"run.days": 0.5, "policy.name": "soc"} | more), progress=False)
        for more in ({}, {"system.parameters.battery.hysteresis_heat": True})
    )
    assert plain.dataset["hysteresis_loss_kw"].dims == ("time", "string")
    total_kwh = 0.25 * float(plain.dataset["hysteresis_loss_kw"].sum())
    assert plain.kpis["hysteresis_loss_kwh"] == pytest.approx(total_kwh, rel=1e-12) and total_kwh > 1.0
    of_parts = sum(plain.kpis[name] for name in ("undelivered_kwh", "inverter_loss_kwh", "battery_loss_kwh"))
    assert plain.kpis["lost_kwh"] == pytest.approx(of_parts)
    assert heated.kpis["peak_mean_temperature_c"] > plain.kpis["peak_mean_temperature_c"] + 0.1
