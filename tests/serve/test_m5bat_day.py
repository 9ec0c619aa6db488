"""The measured day of M5BAT in steps of ten seconds: few starts, no more losses, everything delivered."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pytest

import bess

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT.parent / "shared" / "data" / "bess" / "m5bat_bess_battery_together_sample.parquet"
pytestmark = pytest.mark.skipif(not FILE.exists(), reason=f"the measured day is not at {FILE}")


def test_the_live_controller_starts_rarely_loses_no_more_and_delivers_everything() -> None:
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        import m5bat_live as example
    finally:
        sys.path.pop(0)
    demand_kw = example.ten_seconds(pd.read_parquet(FILE))
    means_kw = demand_kw.reshape(-1, example.PER_PLAN).mean(axis=1)
    system = bess.load_system("m5bat")
    quarter = example.quarter_hours(system, means_kw)
    held = example.held_sets(system, demand_kw, means_kw)
    live = example.live(system, demand_kw, means_kw)
    assert live.undelivered_kwh < 0.1
    # Measured: unit 1 starts 253 times, unit 10 131 times.
    assert live.starts[0] < 253 and live.starts[9] < 131
    assert live.starts.max() < 60
    assert live.lost_kwh <= held.lost_kwh
    # Means of quarter hours have no peaks, which cost most: live loses 10 % more for each kWh moved.
    assert live.lost_kwh / live.moved_kwh <= 1.12 * quarter.lost_kwh / quarter.moved_kwh
