"""The examples run as they stand, each on a short stretch, and do what they say."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import bess

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_quickstart_splits_runs_and_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = load("quickstart").main(tmp_path / "out", days=0.125)
    assert result.dataset.sizes == {"time": 12, "string": 2}
    saved = json.loads((tmp_path / "out" / "kpis.json").read_text())
    assert saved["system_efficiency_pct"] == result.kpis["system_efficiency_pct"]
    printed = capsys.readouterr().out
    assert "set-points" in printed and str(tmp_path / "out" / "report.html") in printed
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_compare_policies_serves_the_same_demand_with_each(tmp_path: Path) -> None:
    kpis = load("compare_policies").main(tmp_path, days=0.25)
    assert set(kpis) == {"mpc", "equal", "priority", "soc", "temperature"}
    assert len({values["demand_kwh"] for values in kpis.values()}) == 1
    assert kpis["mpc"]["system_efficiency_pct"] > kpis["equal"]["system_efficiency_pct"]
    assert (tmp_path / "policies.svg").read_text().count("<svg") == 1


def test_own_plant_is_the_one_that_runs(tmp_path: Path) -> None:
    example = load("own_cell_and_inverter")
    result = example.main(tmp_path, days=0.125)
    system = bess.load_system(tmp_path / "my-plant.toml")
    assert system.nominal_kw.tolist() == [110.0, 110.0]
    assert system.capacity_ah.tolist() == [400.0, 340.0]
    flows = result.dataset.isel(time=0)
    # The sheet says 97.7 % (97.6 in charge) at full DC power; nothing in between is worse than the first row.
    loss = abs(flows["inverter_loss_kw"].sum() / flows["delivered_kw"].sum())
    assert 0.02 < float(loss) < 0.13
    sheet = np.array(example.LOAD_PCT) / 100.0
    ac = sheet * np.array(example.DISCHARGE_PCT) / 100.0
    table = system.strings[0].inverter
    assert np.interp(ac, table.load, table.loss_discharge) == pytest.approx(sheet - ac, abs=3e-4)


def test_pareto_sweep_runs_every_weight_and_names_the_knee(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = load("pareto_sweep").main(tmp_path, days=0.125, divisions=2, workers=1)
    assert not sweep.failed and len(sweep.outcomes) == 3
    assert "knee: inverter=" in capsys.readouterr().out
    assert (tmp_path / "runs" / "report.html").exists()
