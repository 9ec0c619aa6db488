"""One catalogue names every key figure, for the terminal, the page, figures, sweeps and the manual."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bess
from bess.simulation.analysis.catalogue import CATALOGUE, HEADINGS, Kpi, better, grouped, kpi
from bess.simulation.analysis.kpis import _round_trip
from bess.simulation.analysis.settlement import COSTS


@pytest.fixture(scope="module")
def given() -> dict[str, float]:
    study = bess.load_study("case1").with_values({"run.days": 1.0})
    return dict(bess.run(study, progress=False).kpis)


def test_every_figure_of_a_run_is_in_the_catalogue(given: dict[str, float]) -> None:
    assert not given.keys() - CATALOGUE.keys()


def test_every_figure_of_a_settlement_is_in_the_catalogue() -> None:
    assert {*COSTS, "net_eur", "discharge_revenue_eur"} <= CATALOGUE.keys()


def test_every_entry_says_in_one_sentence_what_it_means() -> None:
    for name, entry in CATALOGUE.items():
        assert entry.meaning.endswith("."), name
        assert entry.group in HEADINGS, name
        assert entry.better in ("min", "max", None), name
        assert entry.label[0].isupper() or entry.label.startswith("SOC"), name
        assert len({each.label for each in CATALOGUE.values()}) == len(CATALOGUE)


def test_units_agree_with_the_names() -> None:
    units = {"_pct": "%", "_kwh": "kWh", "_eur": "EUR", "_c": "°C", "_k": "K"}
    for name, entry in CATALOGUE.items():
        for suffix, unit in units.items():
            if name.endswith(suffix):
                assert entry.unit == unit, name


def test_lost_energy_is_the_sum_of_its_parts(given: dict[str, float]) -> None:
    assert given["undelivered_kwh"] == given["availability_loss_kwh"] + given["derating_loss_kwh"]
    parts = given["undelivered_kwh"] + given["inverter_loss_kwh"] + given["battery_loss_kwh"]
    assert given["lost_kwh"] == pytest.approx(parts, rel=1e-12)


def test_round_trip_efficiency_of_a_closed_cycle_is_energy_out_per_energy_in(tmp_path: Path) -> None:
    """Days of one cycle each, after which SOC is where it was: then no correction is left."""
    hours = pd.date_range("2024-01-01", periods=24 * 4, freq="15min", tz="UTC")
    power_kw = np.where(hours.hour < 12, -40.0, 34.97) * np.isin(hours.hour, (2, 3, 4, 14, 15, 16))
    path = tmp_path / "demand.csv"
    pd.DataFrame({"time": hours, "power_kw": power_kw}).to_csv(path, index=False)
    values = {"demand.file": str(path), "run.days": 1.0, "policy.name": "equal"}
    result = bess.run(bess.load_study("case1").with_values(values), progress=False)
    flow = result.dataset["delivered_kw"].values
    plain = -flow[flow > 0].sum() / flow[flow < 0].sum()
    drift = float(result.dataset["soc"][-1].mean()) - float(result.dataset.attrs["initial_soc"][0])
    assert abs(drift) < 2e-4
    assert result.kpis["round_trip_efficiency_pct"] == pytest.approx(100.0 * plain, abs=0.05)
    assert 80.0 < result.kpis["round_trip_efficiency_pct"] < 99.0


def test_energy_left_in_store_is_no_loss_of_the_round_trip() -> None:
    """Charging three times as long, with three times its losses, changes nothing."""

    def record(charging_steps: int) -> xr.Dataset:
        delivered = np.array([*[-50.0] * charging_steps, 40.0])
        chemical = np.array([*[-45.0] * charging_steps, 43.0])
        names = {"delivered_kw": delivered, "chemical_kw": chemical, "standby_kw": 0.0 * delivered}
        return xr.Dataset({name: (("time", "string"), values[:, None]) for name, values in names.items()})

    (once,), (thrice,) = (list(_round_trip(record(steps))) for steps in (1, 3))
    assert once == ("round_trip_efficiency_pct", pytest.approx(100.0 * (45.0 / 50.0) * (40.0 / 43.0)))
    assert thrice[1] == pytest.approx(once[1])
    assert not list(_round_trip(record(3).isel(time=slice(0, 2))))


def test_the_round_trip_pays_for_standby_at_the_meter() -> None:
    columns = {
        "delivered_kw": [-50.0, 0.0, 40.0],
        "chemical_kw": [-44.0, 0.0, 44.0],
        "standby_kw": [1.0, 3.0, 2.0],
    }
    data = xr.Dataset({name: (("time", "string"), np.array(v)[:, None]) for name, v in columns.items()})
    ((_, value),) = _round_trip(data)
    assert value == pytest.approx(100.0 * (40.0 - 2.0) / (50.0 + 1.0 + 3.0))


def test_numbers_are_shown_with_their_digits_and_factor() -> None:
    gap = CATALOGUE["solver_gap_median"]
    assert gap.quantity(0.00123) == "0.123 %"
    assert kpi("lost_kwh").quantity(1234.56) == "1,234.6 kWh"
    assert kpi("ledger_residual_ratio").number(1.23e-12) == "1.2e-12"
    assert kpi("lost_kwh").number(-0.01) == "0.0"
    assert kpi("lost_kwh").number(math.nan) == "–"


def test_a_figure_of_a_plug_in_is_shown_by_its_name_after_all_others() -> None:
    assert kpi("own_figure") == Kpi("own_figure", "", "strings", decimals=3, detail=True)
    groups = grouped(["own_figure", "full_cycles", "lost_kwh", "demand_kwh"])
    assert groups == {
        "Energy": ["demand_kwh"],
        "Losses": ["lost_kwh"],
        "Strings and inverters": ["full_cycles", "own_figure"],
    }


def test_what_carries_no_judgement_has_no_better_direction() -> None:
    assert better("lost_kwh") == "min"
    with pytest.raises(bess.InputError, match="demand_kwh: this KPI has no preferred direction"):
        better("demand_kwh")
