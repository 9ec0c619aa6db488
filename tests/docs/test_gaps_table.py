"""Claims: the page on gaps shows what was measured, and the code gives it; ``make_gaps.py`` writes it."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_gaps


def test_the_table_is_made_of_the_stored_numbers() -> None:
    rows = make_gaps.stored()
    assert len(rows) == make_gaps.N_PROBLEMS
    assert make_gaps.TABLE.read_text(encoding="utf-8") == make_gaps.table(rows)


def test_no_bound_is_above_the_best_found_and_next_to_nothing_is_missed() -> None:
    rows = make_gaps.stored()
    assert max(row["bound above"] for row in rows) == 0.0
    assert sum(row["missed"] > make_gaps.MISSED for row in rows) <= 0.02 * len(rows)


@pytest.mark.parametrize("seed", [3, 16, 25, 41])
def test_a_problem_gives_its_stored_gap(seed: int) -> None:
    problem, stored = make_gaps.Fresh.of(seed), make_gaps.stored()[seed]
    found = make_gaps.long_search(problem, seed)
    again = make_gaps.compare(problem, found)
    assert again["kind"] == stored["kind"]
    assert again["gap"] == pytest.approx(stored["gap"], rel=0.1, abs=1e-4)
    assert again["missed"] <= max(2.0 * float(stored["missed"]), make_gaps.MISSED)
    assert again["bound above"] == 0.0
