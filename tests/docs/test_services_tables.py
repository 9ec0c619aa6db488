"""Claim: the tables about services are what the code gives; `make cases` writes them."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_services

pytestmark = pytest.mark.golden


def test_the_tables_are_made_of_the_stored_numbers() -> None:
    for name, text in make_services.tables(make_services.stored()).items():
        assert (make_services.DOCS / "_cases" / name).read_text(encoding="utf-8") == text


@pytest.mark.parametrize("kind", make_services.KINDS)
def test_a_bundled_week_gives_the_stored_numbers(kind: str) -> None:
    measured = make_services.week(kind, ("equal",))["equal"]
    assert measured == pytest.approx(make_services.stored()["weeks"][kind]["equal"], rel=1e-5, abs=1e-6)
