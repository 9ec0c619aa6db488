"""Claims about certified splits of many strings in closed loop with the plant."""

import numpy as np
import pytest

import bess

N_STRINGS = 64
HOURS = 0.5


def test_a_certified_plant_of_64_strings_delivers_with_small_gaps_and_kpis_of_its_record() -> None:
    rng = np.random.default_rng(5)
    study = bess.load_study(
        "case1",
        {
            "system.n_strings": N_STRINGS,
            "system.initial_soc": rng.uniform(0.1, 0.9, N_STRINGS).tolist(),
            "system.initial_temperature_c": rng.uniform(20.0, 40.0, N_STRINGS).tolist(),
            "demand.scale": N_STRINGS / 2,
            "run.days": HOURS / 24.0,
        },
    )
    result = bess.run(study, progress=False)
    data, kpis = result.dataset, result.kpis
    assert data.sizes["string"] == N_STRINGS
    assert kpis["solver_steps"] == data.sizes["time"] == 2
    assert kpis["solver_gap_max"] == data.solver_gap.max() < 0.05
    assert not data.fallback.any()
    np.testing.assert_allclose(data.request_kw.sum("string"), data.demand_kw)
    running = (data.request_kw != 0.0).sum("string")
    assert ((running > 0) & (running < N_STRINGS)).all()
    for kpi, record in (
        ("delivered_kwh", np.abs(data.delivered_kw)),
        ("inverter_loss_kwh", data.inverter_loss_kw),
        ("battery_loss_kwh", data.battery_loss_kw),
        ("undelivered_kwh", data.availability_loss_kw + data.derating_loss_kw),
    ):
        assert kpis[kpi] == pytest.approx(float(record.sum()) * 0.25)
    assert kpis["delivered_kwh"] == pytest.approx(HOURS * 39.0 * N_STRINGS)
    assert 0.0 < kpis["lost_kwh"] < 0.05 * kpis["delivered_kwh"]
    charged = data.soc.values[1] > data.soc.values[0]  # at the end of each step
    np.testing.assert_array_equal(charged, data.request_kw.values[1] != 0.0)
