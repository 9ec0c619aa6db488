"""The arena: what its page says is what the code gives, and no rule wins against the optimiser."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

import arena
import bess
import distilled
from once import Once

pytestmark = pytest.mark.golden

STORED = json.loads(arena.STORED.read_text(encoding="utf-8"))
SCENARIOS = arena.scenarios()
MEASURED_AGAIN = ("seven-days", "three-hot", "four-market", "unequal-light", "differing", "mixed", "m5bat")
FOUGHT = (
    "two-light-cool",
    "two-spread",
    "two-frequency",
    "two-persistence",
    "three-hot",
    "four-market",
    "four-frequency",
    "unequal-light",
    "differing",
)


def test_distilled_controllers_are_compared_with_the_arena_of_its_page() -> None:
    kept = json.loads(distilled.KEPT.read_text(encoding="utf-8"))
    assert distilled.table(kept) == distilled.TABLE.read_text(encoding="utf-8")


def test_the_arena_is_as_wide_as_its_page_says() -> None:
    assert len(SCENARIOS) >= 24
    assert list(STORED["scenarios"]) == list(SCENARIOS)
    files = {study.system.file for study in SCENARIOS.values()}
    assert files == {"reference", "unequal-4", "mixed-4", "m5bat"}
    counts = {s.system.n_strings or 2 for s in SCENARIOS.values() if s.system.file == "reference"}
    assert counts == {2, 3, 4, 8}
    ambients = [study.system.ambient_c or 25.0 for study in SCENARIOS.values()]
    assert (min(ambients), max(ambients)) == (5.0, 40.0)
    demands = {study.demand.file for study in SCENARIOS.values()}
    assert demands == {"two-cycle-48h", "frequency-week", "peak-shaving-week", "market-week"}


def test_tables_of_the_page_are_made_of_the_stored_scores() -> None:
    for name, text in arena.tables(STORED).items():
        assert (arena.PAGE / name).read_text(encoding="utf-8") == text, f"{name}: run `make arena`"


@pytest.mark.parametrize("name", MEASURED_AGAIN)
def test_rules_score_what_the_page_says(name: str) -> None:
    stored = arena.read(STORED["scenarios"][name])
    for rule in arena.RULES:
        score = arena.score(SCENARIOS[name].with_values({"policy.name": rule}))
        for key in ("delivered_kwh", "undelivered_kwh", "inverter_kwh", "battery_kwh", "starts", "peak_c"):
            old, new = getattr(stored[rule], key), getattr(score, key)
            assert new == pytest.approx(old, rel=2e-3, abs=0.1), f"{name}, {rule}, {key}: run `make arena`"


@pytest.mark.parametrize("name", ["seven-days", "three-hot"])
def test_proven_is_what_the_page_says(name: str) -> None:
    _, result = arena.measured(SCENARIOS[name].with_values({"policy.name": "equal"}))
    stored = STORED["scenarios"][name]["proven_kwh"]
    assert arena.looked_back(result)["proven_kwh"] == pytest.approx(stored, rel=2e-3)


@pytest.mark.parametrize("name", FOUGHT)
def test_no_rule_wins_against_the_optimiser(name: str, once: Once) -> None:
    def score(study: bess.Study) -> arena.Score:
        run = once.simulated(study)
        return arena.score_of(run.kpis, run.starts, cpu_s=0.0)

    scores = arena.compete(SCENARIOS[name], ["mpc"], {}, score)
    cost, less = arena.behind_rules(scores, "mpc")
    assert cost <= arena.WINS, f"{name}: a rule costs {100.0 * cost:.2f} % less"
    assert less <= arena.WINS, f"{name}: a rule delivers {100.0 * less:.2f} % more"
    stored = arena.read(STORED["scenarios"][name])["mpc"]
    assert scores["mpc"].cost_kwh == pytest.approx(stored.cost_kwh, rel=5e-3), f"{name}: run `make arena`"


def test_a_rule_that_wins_is_seen() -> None:
    rule = arena.Score(1000.0, 990.0, 10.0, 20.0, 20.0, 99.0, 4.0, 30.0, 0.1)
    worse = arena.Score(1000.0, 980.0, 20.0, 15.0, 20.0, 98.0, 4.0, 30.0, 1.0)
    scores = dict.fromkeys(arena.RULES, rule) | {"mpc": worse}
    cost, less = arena.behind_rules(scores, "mpc")
    assert cost == pytest.approx(95.0 / 70.0 - 1.0)
    assert less == pytest.approx(1.0 - 980.0 / 990.0)
