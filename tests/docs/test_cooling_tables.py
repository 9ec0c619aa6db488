"""Claim: the tables on the page about cooling are what the code gives; `make cases` writes them."""

import re
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_cooling


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.\d+", text)]


def test_the_tables_of_the_page_on_cooling_are_those_the_code_gives() -> None:
    for name, text in make_cooling.tables().items():
        written = (make_cooling.DOCS / "_cases" / name).read_text(encoding="utf-8")
        assert re.sub(r"[\d.]+", "0", written) == re.sub(r"[\d.]+", "0", text), f"{name}: run `make cases`"
        # The last digit shown may round another way.
        np.testing.assert_allclose(numbers(written), numbers(text), rtol=2e-3, atol=0.011, err_msg=name)


def test_the_hybrid_saves_what_is_published_against_fans_of_one_speed_only() -> None:
    saved = make_cooling.saved_points(make_cooling.week_of("hot"))
    assert saved["air, strong"] >= 1.5
    assert 0.0 < saved["air, strong, fans by temperature"] < 1.5
