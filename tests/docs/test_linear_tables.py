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


@pytest.mark.parametrize("name", ["two-cycle 15 linear", "arbitrage 15 convex", "peak-shaving 15 nonlinear"])
def test_a_run_gives_its_stored_figures(name: str) -> None:
    """To 5 % or 5 kWh: what a plan finds may change a little without the page saying anything else."""
    kpis = bess.run(make_linear.studies()[name], progress=False).kpis
    stored = make_linear.stored()[name]
    assert {key: kpis[key] for key in make_linear.KEPT} == pytest.approx(
        {key: stored[key] for key in make_linear.KEPT}, rel=0.05, abs=5.0
    )


def test_no_controller_at_any_step_loses_clearly_less_than_a_plan_of_a_day_every_quarter_of_an_hour() -> None:
    numbers = make_linear.stored()
    for service in make_linear.SAME_DEMAND:
        planned = make_linear.lost_pct(numbers[f"{service} 15 nonlinear"])
        others = [make_linear.lost_pct(entry) for name, entry in numbers.items() if name.startswith(service)]
        assert planned <= min(others) + 0.075


def test_at_a_minute_the_certified_split_is_behind_the_linear_controller_in_three_services() -> None:
    numbers = make_linear.stored()
    behind = {
        service: make_linear.lost_pct(numbers[f"{service} 1 certified"])
        - make_linear.lost_pct(numbers[f"{service} 1 linear"])
        for service in make_linear.SERVICES
    }
    assert {service for service, points in behind.items() if points > 0.0} == {
        "peak-shaving",
        "self-consumption",
        "arbitrage",
    }
    assert behind["arbitrage"] == pytest.approx(2.4, abs=0.05)


def test_the_answer_turns_with_the_numbers() -> None:
    figures = {"demand_kwh": 100.0, "lost_kwh": 5.0, "cpu_s": 1.0}
    numbers = {name: dict(figures) for name in make_linear.studies()}
    assert "**No.**" in make_linear.answer(numbers)
    numbers["two-cycle 1 linear"]["lost_kwh"] = 4.0
    assert "**Yes, for two-cycle.**" in make_linear.answer(numbers)
    numbers["two-cycle 15 linear"]["lost_kwh"] = 4.5
    assert "**No.**" in make_linear.answer(numbers)
    assert "In two-cycle the linear model is better" in make_linear.answer(numbers)
