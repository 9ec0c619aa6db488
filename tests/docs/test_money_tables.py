"""Claim: the tables on the page about money are what the code gives; `docs/make_money.py` writes them."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_money

pytestmark = pytest.mark.golden


def test_tables_are_made_of_the_stored_numbers() -> None:
    for name, text in make_money.tables(make_money.stored()).items():
        assert (make_money.DOCS / "_cases" / name).read_text(encoding="utf-8") == text, name


@pytest.mark.parametrize("name", make_money.PIECES)
def test_a_few_days_of_every_third_run_give_the_stored_numbers_again(name: str) -> None:
    piece = make_money.PIECES[name]
    if not piece.prices.exists():
        pytest.skip("real prices are not beside the repository (../shared/data)")
    stored = make_money.stored()[f"{name}, few days"]
    for run, figures in piece.measure(name, piece.few_days, every=3).items():
        for key, value in figures.items():
            assert value == pytest.approx(stored[run][key], rel=5e-3, abs=0.1), f"{run}: {key}"
