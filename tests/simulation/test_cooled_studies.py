"""Claims about studies of plants with cooling: what is recorded, counted, and known to the controller."""

from pathlib import Path

import numpy as np
import pytest

import bess
import bess.simulation.runner as run_module
from power_cut import cut_off

COOLED = {
    "system.parameters.cooling": {"kind": "hybrid", "loop": {"heat_capacity_kj_k": 500.0}},
    "system.ambient_c": 33.0,
    "system.initial_temperature_c": 34.0,
    "run.days": 0.5,
}


@pytest.fixture(scope="module")
def result() -> bess.Result:
    return bess.run(bess.load_study("case1", COOLED), progress=False)


def test_key_figures_count_what_cooling_takes_once(result: bess.Result) -> None:
    data, kpis = result.dataset, result.kpis
    auxiliary_kwh = float(data["auxiliary_kw"].sum()) * 0.25
    assert auxiliary_kwh > 1.0
    assert kpis["auxiliary_kwh"] == pytest.approx(auxiliary_kwh, rel=1e-12)
    lost_pct = 100.0 * auxiliary_kwh / kpis["request_kwh"]
    with_auxiliaries = kpis["system_efficiency_with_auxiliaries_pct"]
    assert with_auxiliaries == pytest.approx(kpis["system_efficiency_pct"] - lost_pct, rel=1e-12)


def test_the_round_trip_pays_for_cooling(result: bess.Result) -> None:
    data = result.dataset
    without = bess.kpis(data.drop_vars("auxiliary_kw"))
    delivered_kw, auxiliary_kw = data["delivered_kw"].values.sum(axis=1), data["auxiliary_kw"].values
    meter_kw, chemical_kw = delivered_kw - auxiliary_kw, data["chemical_kw"].values.sum(axis=1)
    gives = meter_kw > 0.0
    expected = meter_kw[gives].sum() / chemical_kw[gives].sum()
    expected *= chemical_kw[~gives].sum() / meter_kw[~gives].sum()
    assert result.kpis["round_trip_efficiency_pct"] == pytest.approx(100.0 * expected, rel=1e-12)
    assert result.kpis["round_trip_efficiency_pct"] < without["round_trip_efficiency_pct"] - 0.1
    assert without["auxiliary_kwh"] == 0.0


def test_a_cooled_run_is_resumed_to_the_same_bits(
    result: bess.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "MAX_PART_STEPS", 8)
    study = bess.load_study("case1", COOLED)
    cut_off(study, tmp_path / "run", 20, monkeypatch)
    resumed = bess.run(study, progress=False, out=tmp_path / "run", resume=True).dataset
    for name in ("temperature_c", "auxiliary_kw", "cooling_kw", "coolant_c"):
        np.testing.assert_array_equal(resumed[name].values, result.dataset[name].values, err_msg=name)


def test_a_run_that_could_not_be_resumed_ends_with_what_is_too_hot(tmp_path: Path) -> None:
    """Its fan heats a room with hardly any wall."""
    fan = {"kind": "air", "pressure_pa": 2e5, "loop": {"heat_capacity_kj_k": 1e3, "wall_w_k": 100.0}}
    study = bess.load_study("case1", COOLED | {"system.parameters.cooling": fan, "policy.name": "equal"})
    with pytest.raises(bess.InputError, match=r"step 0: cells or coolant reach \d+ degC, above the 150 degC"):
        bess.run(study, progress=False, out=tmp_path / "run")


def test_hindsight_says_that_it_does_not_know_thermostats(result: bess.Result) -> None:
    with pytest.raises(bess.InputError, match=r"has \[cooling\] kind = 'hybrid'; .*ambient-air cooling only"):
        bess.hindsight(result)
