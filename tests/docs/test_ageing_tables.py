"""Claim: the tables on the page about ageing are what the code gives; `make cases` writes them."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_ageing

pytestmark = pytest.mark.golden


def test_tables_of_the_page_on_ageing_are_those_the_code_gives() -> None:
    for name, text in make_ageing.tables().items():
        assert (make_ageing.DOCS / "_cases" / name).read_text(encoding="utf-8") == text, name
