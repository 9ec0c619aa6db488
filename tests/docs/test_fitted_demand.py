"""Claims: what the page says of the fitted demand is what the code gives; `fit_demand.py page` writes it."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

import bess
import fit_demand
from bess.dispatch import bundled_profile
from bess.dispatch.profile import _FITTED_LEVELS_KW, _FITTED_QUARTERS, _FITTED_START
from bess.report.words.paper import Verdict, comparisons


@pytest.fixture(scope="module")
def kpis() -> fit_demand.Kpis:
    runs = bess.run_scenarios(bess.load_study(fit_demand.FITTED), progress=False)
    return {name: {key: run.kpis[key] for key in fit_demand.KEYS} for name, run in runs.items()}


def test_most_statements_come_out_on_the_fitted_demand(kpis: fit_demand.Kpis) -> None:
    missing = [row.statement for row in comparisons(kpis) if row.verdict is not Verdict.YES]
    assert missing == MISSING


MISSING = [
    "S2 over S1, battery efficiency",
    "S2 over S1, derating efficiency",
    "Availability of S2 not below that of S1",
]


def test_the_page_shows_what_the_code_gives(kpis: fit_demand.Kpis) -> None:
    import json

    stored = json.loads(fit_demand.STORED.read_text(encoding="utf-8"))
    for name, values in kpis.items():
        assert values == pytest.approx(stored["kpis"][name], rel=1e-6), name
    assert fit_demand.TABLE.read_text(encoding="utf-8") == fit_demand.table(stored)


def test_the_bundled_profile_is_a_candidate_of_the_search() -> None:
    high, low, _, out_high, out_low, _ = (round(level) for level in _FITTED_LEVELS_KW)
    candidate = fit_demand.Demand((-high, -low, out_high, out_low), _FITTED_QUARTERS, _FITTED_START)
    np.testing.assert_array_equal(candidate.power_kw(), bundled_profile("two-cycle-fitted-48h"))


def test_s2_runs_a_second_string_where_one_suffices_only_where_resistance_climbs() -> None:
    """Above SOC 0.1 the heat that it saves is worth less to S2 than what its inverter loses."""
    system, goals = bess.System.reference(2), bess.Objectives(inverter=0.5, battery=0.5)

    def running(soc: float, power_kw: float, temperature_c: float) -> int:
        state = bess.State([soc, soc], [temperature_c, temperature_c])
        split = bess.split_power(system, state, [power_kw], objectives=goals, dt_h=0.25)
        return int(split.inverter_on[:, 0].sum())

    for temperature_c in (25.0, 45.0):
        for soc in (0.12, 0.3, 0.8):
            assert [running(soc, sign * 80.0, temperature_c) for sign in (-1.0, 1.0)] == [1, 1]
        assert running(0.05, -80.0, temperature_c) == 2


def test_a_short_cycle_takes_over_from_the_two_days() -> None:
    levels, quarters, start = (78, 30, 78, 30), (18, 2, 2, 19, 3, 2, 20, 3, 2, 19, 3, 3), 9
    plain = fit_demand.Demand(levels, quarters, start).power_kw()
    turned = fit_demand.Demand(levels, quarters, start, (80, 75, 2, 1, 70, 3, 0)).power_kw()
    np.testing.assert_array_equal(turned[:80], plain[:80])
    np.testing.assert_array_equal(turned[80:92], [-75, -75, 0, 70, 70, 70] * 2)
    assert turned.size == 192


def test_a_search_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"S1": 51.0, "S2": 46.0, "S3": 40.0}
    made = {
        name: dict.fromkeys(fit_demand.KEYS, 97.0) | {"peak_mean_temperature_c": t}
        for name, t in values.items()
    }
    monkeypatch.setattr(fit_demand, "kpis", lambda demand: made)
    log = tmp_path / "log"
    for _ in range(2):
        fit_demand.search(log, 0.3, seed=0)
    lines = log.read_text(encoding="utf-8").splitlines()
    assert len(lines) == len(set(lines)) == len(fit_demand.read(log)) > 2
    assert fit_demand.BUNDLED in fit_demand.read(log)
