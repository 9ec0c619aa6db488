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
def test_a_few_days_give_the_stored_numbers_again(name: str) -> None:
    piece = make_money.PIECES[name]
    if not piece.prices.exists():
        pytest.skip("real prices are not beside the repository (../shared/data)")
    stored = make_money.stored()[f"{name}, few days"]
    for run, figures in piece.measure(name, piece.few_days).items():
        for key, value in figures.items():
            assert value == pytest.approx(stored[run][key], rel=5e-3, abs=0.1), f"{run}: {key}"


def test_two_strings_of_different_age_earn_more_for_their_health_with_a_plan_that_knows_wear() -> None:
    """Graner et al. report 21 per cent more revenue for each loss of health."""
    runs = make_money.stored()["ages"]
    per_point = {
        name: run["revenue_eur"] / (make_money.START_HEALTH - run["soh_capacity_mean"])
        for name, run in runs.items()
    }
    assert per_point["mpc-aware"] > 1.21 * per_point["equal-linear"]
    assert runs["mpc-aware"]["net_eur"] > runs["equal-linear"]["net_eur"]


def test_a_year_of_the_published_benchmark_earns_what_its_nonlinear_program_does() -> None:
    """And the linear plan with its settings comes within 1.5 per cent of the linear program's revenue."""
    runs = make_money.stored()["year"]
    for name in (name for name in runs if name.startswith("linear")):
        assert runs[name]["revenue_eur"] == pytest.approx(make_money.PUBLISHED[name][0], rel=0.015), name
    aware = [name for name in runs if name.startswith("aware")]
    assert aware
    for name in aware:
        revenue, _, _, charge_mwh, discharge_mwh = make_money.PUBLISHED[name]
        assert runs[name]["revenue_eur"] >= revenue, name
        short_kwh = runs[name]["short_of_charge_kwh"] + runs[name]["short_of_discharge_kwh"]
        assert short_kwh <= 1000.0 * (charge_mwh + discharge_mwh), name
