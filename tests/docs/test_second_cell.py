"""Claims about a second cell: entropy that was published, and fitted to nothing here, explains its heat."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_second_cell as second


def test_the_page_shows_what_the_code_gives() -> None:
    written = second.TABLE.read_text(encoding="utf-8")
    assert written == f"<!-- written by docs/make_second_cell.py -->\n\n{second.table()}"


@pytest.mark.golden
@pytest.mark.parametrize("trained", second.RATES)
def test_with_published_entropy_every_blind_prediction_is_better_by_a_third_or_more(trained: str) -> None:
    before, after = (second.rmse_k(*second.fit([trained], kind)) for kind in ("none", "published"))
    for rate in second.RATES:
        if rate != trained:
            assert after[rate] < 0.67 * before[rate]


def test_the_resistance_meets_the_measured_voltage() -> None:
    """At constant current the terminal voltage is OCV less R I; the plant takes both from here."""
    for rate in second.RATES:
        (soc, ocv), milliohm = second.electrical([rate])
        known, volts = second.voltage_v(rate)
        (ohm,) = (row / 1000.0 for row in milliohm.values())
        met = np.interp(known, soc, ocv - ohm * second.current_a(rate))
        inner = known > 0.05
        np.testing.assert_allclose(met[inner], volts[inner], atol=2e-3)
