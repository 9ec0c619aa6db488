"""Claim: the table on the page about foresight is what the code gives; `make cases` writes it."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_midpoint

pytestmark = pytest.mark.golden


def test_the_table_of_the_page_on_foresight_is_the_one_the_code_gives() -> None:
    written = (make_midpoint.DOCS / "_cases" / make_midpoint.FILE).read_text(encoding="utf-8")
    assert make_midpoint.table() == written


def test_the_middle_of_a_step_predicts_the_plant_better_than_its_start() -> None:
    for low, high in make_midpoint.SOC:
        errors = make_midpoint._errors(low, high)
        assert (errors["midpoint"] < errors["start"]).all(), (low, high)
