"""Claims about energy, limits and the published behaviour of one string."""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import bess
from bess.plant import Limit

TWO_CYCLES = [
    (2.5, -1),
    (0.5, 0),
    (4.75, 1),
    (0.5, 0),
    (5.25, -1),
    (0.5, 0),
    (4.75, 1),
    (0.5, 0),
    (2.75, -1),
    (2, 0),
]


def blocks(profile: Sequence[tuple[float, float]], power_kw: float) -> Any:
    return np.concatenate([np.full(round(4 * hours), sign * power_kw) for hours, sign in profile])[:, None]


def document(**battery: object) -> dict[str, Any]:
    out = copy.deepcopy(bess.System.reference(1).document)
    out["battery"].update(battery)
    return out


def test_the_ledger_closes_over_a_month() -> None:
    rng = np.random.default_rng(7)
    request = rng.uniform(-92, 92, (30 * 96, 1)) * rng.uniform(0.3, 1.0, (30 * 96, 3))
    request[rng.random((30 * 96, 1))[:, 0] < 0.2] = 0.0
    doc = document()
    doc["system"]["n_strings"] = 3
    doc["inverter"]["off_loss"] = 3e-4
    plant = bess.Plant(bess.System(doc), bess.State([0.1, 0.5, 0.9], [25.0, 35.0, 45.0]))
    flows = plant.run(request)
    throughput_kwh = np.abs(flows.delivered_kw).sum() * 0.25
    assert np.bitwise_or.reduce(flows.limits, axis=None) & (Limit.SOC_FULL | Limit.SOC_EMPTY)
    assert abs(flows.ledger_residual_kwh.sum()) < 1e-9 * throughput_kwh
    assert np.abs(flows.ledger_residual_kwh).sum() < 1e-9 * throughput_kwh
    # The same from the record alone: what the grid gave (standby included) is stored, heat, or inverter loss.
    standby_kw = np.where(flows.delivered_kw == 0.0, flows.inverter_loss_kw, 0.0)
    np.testing.assert_array_equal(flows.standby_kw[standby_kw > 0.0], standby_kw[standby_kw > 0.0])
    of_cells = flows.battery_loss_kw + flows.hysteresis_loss_kw - flows.chemical_kw - flows.ocv_shift_kw
    balance = of_cells + flows.inverter_loss_kw + flows.delivered_kw
    np.testing.assert_allclose(flows.standby_kw, balance, atol=1e-10)
    full = (flows.delivered_kw == 0.0) | (flows.availability_loss_kw == 0.0)
    stored = of_cells + flows.inverter_loss_kw
    np.testing.assert_allclose((standby_kw - flows.delivered_kw)[full], stored[full], atol=1e-10)


def test_chemical_energy_is_charge_times_voltage() -> None:
    flat = {"soc": [0.0, 1.0], "charge": [3.7, 3.7], "discharge": [3.7, 3.7]}
    flows = bess.Plant(bess.System(document(ocv_v=flat)), bess.State([0.5], [30.0])).run(
        blocks([(2, -1), (5, 1), (3, -1)], 50.0)
    )
    stored_kwh = -flows.chemical_kw.sum() * 0.25
    np.testing.assert_allclose(stored_kwh, 192 * 3.7 * 376.0 / 1e3 * (flows.soc[-1, 0] - 0.5), rtol=1e-9)


def test_one_string_at_half_power_peaks_where_the_parameter_check_does() -> None:
    # reference/params_check.py: 36.3 degC with currents frozen for 15 min; at 10 s its model gives 36.44.
    # Its table of f_soc has eleven knots, log-linear; the system file's four give 0.2 K more.
    soc = np.linspace(0.0, 0.1, 11)
    knots = {"soc": soc.tolist(), "resistance_mohm": np.round(2.5 * 16 ** (1 - soc / 0.1), 2).tolist()}
    plant = bess.Plant(bess.System(document(resistance_soc=knots)), bess.State([0.5], [25.0]))
    flows = plant.run(blocks(TWO_CYCLES, 46.0))
    np.testing.assert_allclose(flows.temperature_c.max(), 36.3, atol=0.2)
    np.testing.assert_allclose(flows.temperature_c.max(), 36.44, atol=0.02)
    np.testing.assert_allclose(np.abs(flows.delivered_kw).sum() * 0.25, 920.0 - 0.25 * 46, atol=12.0)
    np.testing.assert_allclose([flows.soc.min(), flows.soc.max()], [0.05, 0.92], atol=0.01)


def test_the_reference_file_peaks_within_half_a_kelvin_of_the_published_value() -> None:
    flows = bess.Plant(bess.System.reference(1), bess.State([0.5], [25.0])).run(blocks(TWO_CYCLES, 46.0))
    np.testing.assert_allclose(flows.temperature_c.max(), 36.3, atol=0.4)


def test_sensitivity_of_temperature_to_power_in_the_first_quarter_of_an_hour() -> None:
    rise = []
    for power in (-92.0, 92.0):
        plant = bess.Plant(bess.System.reference(1), bess.State([0.5], [25.0]))
        rise.append(plant.step([power]).temperature_c[0] - 25.0)
    np.testing.assert_allclose(np.mean(rise) / 92.0, 0.0122, atol=0.0002)


def test_the_pi_law_is_stricter_than_the_table_over_hours() -> None:
    # params_check.py, nominal power: PI law 48.4 degC and k down to 0.65.
    day = blocks(
        [(1.25, -1), (0.5, 0), (2.5, 1), (0.5, 0), (2.5, -1), (0.5, 0), (2.5, 1), (0.5, 0), (1.25, -1)], 92.0
    )
    peaks = []
    for law in ("pi", "table"):
        plant = bess.Plant(bess.System.reference(1), bess.State([0.5], [25.0]), derating_law=law)
        peaks.append(plant.run(day).temperature_c.max())
    np.testing.assert_allclose(peaks[0], 48.4, atol=0.5)
    assert peaks[0] < peaks[1]


def test_discharge_at_low_soc_stops_at_the_largest_power_of_the_battery() -> None:
    flows = bess.Plant(bess.System.reference(1), bess.State([0.01], [25.0])).step([92.0], 10.0)
    v = 192 * np.interp(0.01, [0.0, 0.025], [3.218, 3.356])
    r = 192 / 4 * 1e-3 * np.interp(0.01, [0.0, 0.02], [40.0, 22.97])
    assert flows.limits[0] == Limit.ROOT
    np.testing.assert_allclose(flows.delivered_kw + flows.inverter_loss_kw, v * v / (4e3 * r), rtol=1e-12)
    np.testing.assert_allclose(flows.current_a, v / (2 * r), rtol=1e-6)
    np.testing.assert_allclose(flows.delivered_kw + flows.availability_loss_kw, 92.0, rtol=1e-12)


def test_a_vanishing_resistance_gives_power_over_voltage() -> None:
    system = bess.System(document(r_scale=1e-15))
    flows = bess.Plant(system, bess.State([0.5], [25.0])).step([46.0], 10.0)
    np.testing.assert_allclose(flows.current_a, 1e3 * (46.0 + 1.2512) / (192 * 3.686), rtol=1e-12)


@pytest.mark.parametrize(
    ("soc", "power_kw", "limit"), [(0.999, -92.0, Limit.SOC_FULL), (0.2, 92.0, Limit.SOC_EMPTY)]
)
def test_soc_stops_exactly_at_its_window(soc: float, power_kw: float, limit: Limit) -> None:
    system = bess.System(document(soc_min=0.1999))
    flows = bess.Plant(system, bess.State([soc], [25.0])).step([power_kw])
    assert flows.limits[0] & limit
    # In discharge the last bit of charge cannot carry the inverter's no-load loss.
    np.testing.assert_allclose(flows.soc, 1.0 if power_kw < 0 else 0.1999, atol=1e-12)
    assert flows.availability_loss_kw[0] > 0


def test_inverter_losses_jump_at_no_load_and_fall_to_standby_when_off() -> None:
    doc = document()
    doc["inverter"]["off_loss"] = 3e-4
    plant = bess.Plant(bess.System(doc), bess.State([0.5], [25.0]))
    off, below, on = (plant.step([request_kw]) for request_kw in (0.0, 0.999e-3, 1e-3))
    np.testing.assert_allclose([off.inverter_loss_kw[0], below.inverter_loss_kw[0]], 92 * 3e-4, rtol=1e-6)
    assert (below.delivered_kw[0], below.availability_loss_kw[0]) == pytest.approx((0.0, 0.999e-3))
    np.testing.assert_allclose(on.inverter_loss_kw[0], 92 * 0.011, rtol=1e-4)
    assert (off.inverter_starts[0], on.inverter_starts[0]) == (0, 1)
    assert off.current_a[0] == 0.0
    np.testing.assert_allclose(off.ledger_residual_kwh, 0.0, atol=1e-15)
