"""Claims about the gain over rules: it is the difference of two runs that anybody can make."""

import json
from pathlib import Path

import pytest
import xarray as xr

import bess
from bess.control.policies.adapters import FunctionPolicy
from bess.control.policies.rule import RulePolicy
from bess.simulation.hindsight.replay import Replay, gain_over_rules

UNLIKE = {"system.initial_soc": [0.3, 0.7], "run.days": 1.0}
RULES = ("equal", "priority", "soc", "temperature")


def made(study: str, **values: object) -> bess.Result:
    keys = {key.replace("__", "."): value for key, value in values.items()}
    return bess.run(bess.load_study(study, keys), progress=False)


@pytest.fixture(scope="module")
def by_rule() -> dict[str, bess.Result]:
    return {rule: bess.run(bess.load_study("case1", UNLIKE | {"policy.name": rule}), progress=False)
            for rule in RULES}  # fmt: skip


@pytest.mark.parametrize("policy", RULES)
def test_the_gain_is_what_runs_under_each_rule_give(policy: str, by_rule: dict[str, bess.Result]) -> None:
    lost = {rule: run.kpis["lost_kwh"] for rule, run in by_rule.items()}
    best = min(lost, key=lambda rule: (lost[rule], rule != policy))
    gain = gain_over_rules(Replay.of(by_rule[policy].dataset), policy)
    assert gain["gain_rule"] == best
    assert gain["gain_kwh"] == lost[best] - lost[policy]
    assert max(lost.values()) > min(lost.values())
    drawn = [run.dataset["chemical_kw"].values.sum() * 0.25 for run in (by_rule[best], by_rule[policy])]
    assert gain["gain_stored_kwh"] == pytest.approx(drawn[0] - drawn[1], abs=1e-9)
    assert "gain_eur" not in gain


def replayed(record: xr.Dataset, rule: str) -> dict[str, float]:
    replay = Replay.of(record)
    return bess.kpis(replay.under(RulePolicy(replay.system, replay.inputs.grid.dt_h, rule), rule))


@pytest.mark.parametrize("study", ["case1", "self-consumption", "fcr"])
def test_a_rule_replayed_on_its_own_demand_gives_the_same_figures(study: str) -> None:
    """Also of demand that depends on the SOC, of reactive power, and at a meter with its prices."""
    reactive: dict[str, object] = {"reactive__power_factor": 0.9} if study == "case1" else {}
    result = made(study, policy__name="soc", run__days=1.0, **reactive)
    again = replayed(result.dataset, "soc")
    for name in ("lost_kwh", "inverter_loss_kwh", "peak_node_temperature_c"):
        assert again[name] == result.kpis[name]
    gain = gain_over_rules(Replay.of(result.dataset), "soc")
    assert "gain_eur" not in gain
    if study == "self-consumption":
        assert again["net_eur"] == pytest.approx(result.kpis["net_eur"], abs=1e-9)


def test_a_report_keeps_the_gain_with_the_key_figures(
    tmp_path: Path, by_rule: dict[str, bess.Result]
) -> None:
    from bess.report import write_report

    folder = tmp_path / "run"
    bess.run(bess.load_study("case1", UNLIKE | {"policy.name": "priority"}), out=folder, progress=False)
    page = write_report(folder, rules=False).read_text(encoding="utf-8")
    assert "gain_kwh" not in json.loads((folder / "kpis.json").read_text()) and "best rule" not in page
    page = write_report(folder).read_text(encoding="utf-8")
    saved = json.loads((folder / "kpis.json").read_text())
    lost = {rule: run.kpis["lost_kwh"] for rule, run in by_rule.items()}
    assert saved["gain_kwh"] == min(lost.values()) - lost["priority"] < 0.0
    share = 100.0 * -saved["gain_kwh"] / min(lost.values())
    assert f"({share:.0f} %) more than the best rule, {saved['gain_rule']}" in page
    assert write_report(folder).read_text(encoding="utf-8") == page


def test_a_report_with_hindsight_simulates_the_rules_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bess.report import write_report

    study = bess.load_study("case1", UNLIKE | {"policy.name": "priority", "run.days": 0.125})
    bess.run(study, out=tmp_path / "run", progress=False)
    simulated = []
    under = Replay.under
    monkeypatch.setattr(
        Replay, "under", lambda self, policy, *more: simulated.append(policy) or under(self, policy, *more)
    )
    write_report(tmp_path / "run", hindsight=True)
    assert len(simulated) == len(RULES) + 1, "every rule, and one plan"


def test_an_error_in_a_replay_names_the_policy_that_is_replayed() -> None:
    replay = Replay.of(made("case1", policy__name="equal", run__days=0.25).dataset)

    def fails(inputs: object) -> None:
        raise ValueError("no plan")

    with pytest.raises(bess.BessError, match="policy 'a plan of 12 h', step 0: ValueError: no plan"):
        replay.under(FunctionPolicy(fails), "a plan of 12 h")  # type: ignore[arg-type]
