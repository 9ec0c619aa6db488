"""Claims: the page on linear against nonlinear shows what the code gives; `make_linear.py` writes it."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_linear

import bess


def test_table_and_answer_are_made_of_the_stored_numbers() -> None:
    for path, text in (
        (make_linear.TABLE, make_linear.table(make_linear.stored())),
        (make_linear.ANSWER, make_linear.answer(make_linear.stored())),
    ):
        assert path.read_text(encoding="utf-8") == f"<!-- written by docs/make_linear.py -->\n\n{text}"


def test_every_service_step_and_model_was_measured() -> None:
    assert list(make_linear.stored()) == list(make_linear.studies())


@pytest.mark.parametrize("name", ["two-cycle 15 linear", "arbitrage 15 convex"])
def test_a_run_gives_its_stored_figures(name: str) -> None:
    """To 5 %: what a plan finds may change a little without the page saying anything else."""
    kpis = bess.run(make_linear.studies()[name], progress=False).kpis
    stored = make_linear.stored()[name]
    assert {key: kpis[key] for key in make_linear.KEPT} == pytest.approx(
        {key: stored[key] for key in make_linear.KEPT}, rel=0.05
    )


def test_the_answer_turns_with_the_numbers() -> None:
    figures = {"demand_kwh": 100.0, "lost_kwh": 5.0, "cpu_s": 1.0}
    numbers = {name: dict(figures) for name in make_linear.studies()}
    assert "**No.**" in make_linear.answer(numbers)
    numbers["two-cycle 1 linear"]["lost_kwh"] = 4.0
    assert "**Yes, for two-cycle.**" in make_linear.answer(numbers)
    numbers["two-cycle 15 linear"]["lost_kwh"] = 4.5
    assert "**No.**" in make_linear.answer(numbers)
    assert "In two-cycle the linear model lost less" in make_linear.answer(numbers)
