"""Claims about the record of a run: balances, limits, KPIs, events, unmet demand, and repeatability."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bess
from bess.control.policies import POLICIES, Decision, PolicyInput
from bess.control.policies.rule import RulePolicy


def run(values: dict[str, Any] | None = None) -> bess.Result:
    return bess.run(bess.load_study("case1", {"policy.name": "equal", **(values or {})}), progress=False)


@pytest.fixture(scope="module")
def case1() -> bess.Result:
    return run()


def check_invariants(data: xr.Dataset) -> None:
    """What holds in every step of every run."""
    request, demand = data.request_kw, data.demand_kw
    shed = data.availability_loss_kw + data.derating_loss_kw
    np.testing.assert_allclose(np.abs(data.delivered_kw) + shed, np.abs(request), atol=1e-9)
    np.testing.assert_allclose(np.abs(request.sum("string")) + data.unmet_kw, np.abs(demand), atol=1e-9)
    for name in (
        "availability_loss_kw",
        "derating_loss_kw",
        "inverter_loss_kw",
        "battery_loss_kw",
        "unmet_kw",
    ):
        assert (data[name] >= 0.0).all(), name
    assert ((data.soc >= 0.0) & (data.soc <= 1.0)).all()
    assert (data.node_max_c >= data.temperature_c - 1e-9).all()
    throughput_kwh = float(np.abs(data.delivered_kw).sum()) * 0.25
    assert float(np.abs(data.ledger_residual_kwh).sum()) <= 1e-9 * throughput_kwh


WITHOUT_FILE = [name for name in POLICIES if name != "distilled"]  # that is tried in tests/distil


@pytest.mark.parametrize("name", WITHOUT_FILE)
def test_every_policy_keeps_the_balances(name: str) -> None:
    study: dict[str, Any] = {"policy.name": name, "system.file": "unequal-4", "demand.scale": 2.5}
    if name == "mpc":
        study |= {"run.days": 0.25, "policy.horizon_steps": 2}
    check_invariants(run(study).dataset)


def test_the_record_has_the_documented_variables_units_and_times(case1: bess.Result) -> None:
    data = case1.dataset
    assert dict(data.sizes) == {"time": 192, "string": 2}
    assert data.time.values[0] == np.datetime64("2024-01-01T00:00")
    assert data.time.values[1] - data.time.values[0] == np.timedelta64(15, "m")
    for name, variable in data.data_vars.items():
        assert variable.attrs["units"] and variable.attrs["long_name"], name
    assert data.attrs["time_zone"] == "UTC"
    np.testing.assert_array_equal(data.attrs["initial_soc"], [0.5, 0.5])
    np.testing.assert_array_equal(data.limits.attrs["flag_masks"], [1, 2, 4, 8, 16, 32])
    assert len(data.limits.attrs["flag_meanings"].split()) == 6
    assert "node_temperature_c" not in data
    assert "price_eur_mwh" not in data


def test_the_demand_of_case1_is_the_published_profile(case1: bess.Result) -> None:
    demand = case1.dataset.demand_kw.values
    assert sorted(set(demand)) == [-78.0, -30.0, 0.0, 30.0, 78.0]
    np.testing.assert_array_equal(demand[:96], demand[96:])
    np.testing.assert_array_equal(demand[:14], [-78.0] * 10 + [-30.0] * 2 + [0.0] * 2)


def test_the_equal_split_of_case1_lands_near_the_published_figures(case1: bess.Result) -> None:
    """MODEL.md section 4, lumped plant: 98.7 / 100 / 96.5 / 99.0 / 95.6 %, 40.5 degC."""
    kpis = case1.kpis
    assert kpis["availability_pct"] == pytest.approx(98.7, abs=0.5)
    assert kpis["derating_efficiency_pct"] == pytest.approx(100.0, abs=0.01)
    assert kpis["inverter_efficiency_pct"] == pytest.approx(96.5, abs=0.3)
    assert kpis["battery_efficiency_pct"] == pytest.approx(99.0, abs=0.1)
    assert kpis["system_efficiency_pct"] == pytest.approx(95.6, abs=0.3)
    assert kpis["peak_mean_temperature_c"] == pytest.approx(40.5, abs=1.0)


def test_kpis_follow_their_definitions() -> None:
    time = np.arange(4) * np.timedelta64(15, "m") + np.datetime64("2024-01-01T00:00", "s")
    per_step = {
        "demand_kw": [100.0, -50.0, 0.0, 30.0],
        "unmet_kw": [20.0, 0.0, 0.0, 0.0],
        "price_eur_mwh": [40.0, 10.0, 0.0, 100.0],
        "ledger_residual_kwh": [1e-12, -1e-12, 0.0, 0.0],
        "solver_gap": [0.1, 0.3, np.nan, 0.2],
        "solver_search_gap": [0.01, 0.03, np.nan, 0.02],
        "solver_nodes": [1, 5, 0, 3],
        "solver_status": [1, 3, 0, 1],
        "fallback": [0, 1, 0, 0],
    }
    per_string = {
        "request_kw": [[40, 40], [-25, -25], [0, 0], [30, 0]],
        "delivered_kw": [[30, 40], [-25, -20], [0, 0], [30, 0]],
        "availability_loss_kw": [[6, 0], [0, 5], [0, 0], [0, 0]],
        "derating_loss_kw": [[4, 0], [0, 0], [0, 0], [0, 0]],
        "inverter_loss_kw": [[1, 1], [1, 0], [0, 0], [1, 0]],
        "battery_loss_kw": [[2, 1], [0, 0], [0, 0], [1, 0]],
        "soc": [[0.4, 0.5], [0.5, 0.6], [0.5, 0.6], [0.4, 0.6]],
        "temperature_c": [[30, 20], [34, 30], [32, 28], [31, 27]],
        "node_max_c": [[36, 25], [35, 31], [33, 29], [32, 28]],
        "inverter_starts": [[1, 1], [0, 0], [0, 0], [1, 0]],
    }
    data = xr.Dataset(
        {name: ("time", values) for name, values in per_step.items()}
        | {name: (("time", "string"), np.array(values)) for name, values in per_string.items()},
        coords={"time": time},
        attrs={
            "step_h": 0.25,
            "initial_soc": np.array([0.6, 0.6]),
            "initial_temperature_c": np.array([25.0, 25.0]),
        },
    )
    kpis = bess.kpis(data)
    assert kpis["availability_pct"] == pytest.approx(100 * (1 - 11 / 180))
    assert kpis["derating_efficiency_pct"] == pytest.approx(100 * (1 - 4 / 160))
    assert kpis["inverter_efficiency_pct"] == pytest.approx(100 * (1 - 4 / 160))
    assert kpis["battery_efficiency_pct"] == pytest.approx(100 * (1 - 4 / 160))
    assert kpis["system_efficiency_pct"] == pytest.approx(100 * (1 - 8 / 160))
    assert kpis["fulfilment_pct"] == pytest.approx(100 * 145 / 180)
    assert kpis["unmet_kwh"] == pytest.approx(5.0)
    assert kpis["peak_mean_temperature_c"] == 32.0
    assert kpis["peak_string_temperature_c"] == 34.0
    assert kpis["peak_node_temperature_c"] == 36.0
    assert kpis["soc_spread_max"] == pytest.approx(0.2)
    assert kpis["full_cycles"] == pytest.approx((0.4 + 0.2) / 2 / 2)
    assert (kpis["inverter_starts_mean"], kpis["inverter_starts_max"]) == (1.5, 2.0)
    assert kpis["revenue_eur"] == pytest.approx((70 * 40 - 45 * 10 + 30 * 100) * 0.25 / 1000)
    assert (kpis["fallback_steps"], kpis["solver_steps"]) == (1.0, 3.0)
    assert (kpis["solver_gap_median"], kpis["solver_gap_max"]) == (0.2, 0.3)
    assert all(isinstance(value, float) for value in kpis.values())


def profile_file(folder: Path, power_kw: list[float]) -> str:
    """A demand profile of its own, 15 min, from 2024-06-01 (UTC)."""
    index = pd.date_range("2024-06-01", periods=len(power_kw), freq="15min", tz="UTC")
    path = folder / "profile.csv"
    pd.DataFrame({"time": index, "power_kw": power_kw}).to_csv(path, index=False)
    return str(path)


def test_nothing_asked_is_a_hundred_per_cent(tmp_path: Path) -> None:
    values = {"demand.file": profile_file(tmp_path, [0.0] * 4), "demand.repeat": False, "run.days": 1 / 24}
    kpis = run(values).kpis
    assert kpis["demand_kwh"] == 0.0
    for name in ("availability_pct", "system_efficiency_pct", "fulfilment_pct"):
        assert kpis[name] == 100.0


def test_a_profile_from_a_file_is_the_demand_at_its_own_times(tmp_path: Path) -> None:
    power_kw = [10.0, -20.0, 0.0, 30.0, 40.0, 50.0]
    values = {
        "demand.file": profile_file(tmp_path, power_kw),
        "demand.repeat": False,
        "run.start": "2024-06-01T00:15:00Z",
        "run.days": 1 / 24,
    }
    data = run(values).dataset
    np.testing.assert_array_equal(data.demand_kw.values, power_kw[1:5])
    assert data.time.values[0] == np.datetime64("2024-06-01T00:15")


def test_the_same_study_gives_the_same_bits(case1: bess.Result) -> None:
    assert run().dataset.identical(case1.dataset)


def test_permuting_strings_permutes_the_record() -> None:
    forth = run({"system.initial_soc": [0.2, 0.7], "system.initial_temperature_c": [25, 35]}).dataset
    back = run({"system.initial_soc": [0.7, 0.2], "system.initial_temperature_c": [35, 25]}).dataset
    for name in ("request_kw", "soc", "temperature_c", "current_a"):
        np.testing.assert_array_equal(forth[name].values[:, ::-1], back[name].values)


def test_demand_above_the_plant_is_split_at_full_power_and_the_rest_is_unmet() -> None:
    data = run({"demand.scale": 3.0, "run.days": 0.5}).dataset
    check_invariants(data)
    above = np.abs(data.demand_kw.values) > 184.0
    assert above.any()
    np.testing.assert_allclose(np.abs(data.request_kw.values[above]), 92.0)
    np.testing.assert_allclose(data.unmet_kw.values[above], 3.0 * 78.0 - 184.0)


def test_a_string_out_of_service_gets_nothing_and_the_others_take_over() -> None:
    event = {"string": 1, "start": "2024-01-01T00:30:00Z", "end": "2024-01-01T01:10:00Z"}
    data = run({"event": [event], "run.days": 0.25}).dataset
    check_invariants(data)
    np.testing.assert_array_equal(data.request_kw.values[2:5], [[-78.0, 0.0]] * 3)
    np.testing.assert_array_equal(data.request_kw.values[[1, 5]], [[-39.0, -39.0]] * 2)


def test_a_limited_inverter_keeps_its_limit_and_what_is_missing_is_unmet() -> None:
    limits = [
        {"string": string, "start": "2024-01-01T00:00:00Z", "end": "2024-01-01T01:00:00Z", "limit_kw": 30.0}
        for string in (0, 1)
    ]
    data = run({"event": limits, "run.days": 0.25}).dataset
    check_invariants(data)
    np.testing.assert_array_equal(data.request_kw.values[:4], -30.0)
    np.testing.assert_array_equal(data.unmet_kw.values[:5], [18.0] * 4 + [0.0])


def test_node_temperatures_are_recorded_if_asked_for() -> None:
    data = run({"output.node_temperatures": True, "run.days": 0.25}).dataset
    nodes = data.node_temperature_c
    assert nodes.dims == ("time", "string", "node") and nodes.dtype == np.float32
    np.testing.assert_allclose(nodes.mean("node"), data.temperature_c, rtol=1e-6)


def test_the_pi_law_derates_otherwise_than_the_table() -> None:
    hot = {"system.initial_temperature_c": 50.0, "run.days": 0.25}
    table, pi = run(hot).dataset, run({**hot, "run.derating_law": "pi"}).dataset
    assert (table.derating_loss_kw.values[0] > 0.0).all()
    assert not np.array_equal(table.derating_factor.values, pi.derating_factor.values)


def test_a_finer_plant_step_changes_the_result_a_little() -> None:
    coarse, fine = run({"run.days": 0.5}), run({"run.days": 0.5, "run.plant_step_s": 5.0})
    difference = np.abs(coarse.dataset.temperature_c.values - fine.dataset.temperature_c.values).max()
    assert 0.0 < difference < 0.01


def test_without_weather_the_ambient_is_that_of_the_system() -> None:
    assert (run({"system.ambient_c": 12.0, "run.days": 0.25}).dataset.ambient_c == 12.0).all()


def test_real_prices_and_weather_make_a_demand_that_earns_money() -> None:
    prices = (
        Path(__file__).parents[3] / "shared/data/prices/smard_de_viertelstunde_2024_berechnet_resaved.csv"
    )
    weather = Path(__file__).parents[3] / "shared/data/weather/weather_dwd_duesseldorf_15min_2024.parquet"
    if not prices.exists():
        pytest.skip(f"{prices} is not there")
    values = {
        "policy.name": "temperature",
        "demand.prices": str(prices),
        "weather.file": str(weather),
        "run.start": "2024-03-30T12:00:00Z",  # over the spring change of clocks
        "run.days": 3,
    }
    result = bess.run(bess.load_study("arbitrage-2024", values), progress=False)
    check_invariants(result.dataset)
    index = pd.DatetimeIndex(result.dataset.time.values).tz_localize("UTC")
    expected = bess.read_prices(prices).reindex(index)
    np.testing.assert_array_equal(result.dataset.price_eur_mwh.values, expected.to_numpy())
    assert result.kpis["revenue_eur"] > 0.0
    assert result.kpis["full_cycles"] > 1.0
    assert result.dataset.ambient_c.values.std() > 0.0


def test_scenarios_read_a_price_file_once_and_a_changed_file_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []
    original = bess.market.read_prices

    def counted(file: str, *arguments: Any, **keywords: Any) -> pd.Series:
        read.append(file)
        return original(file, *arguments, **keywords)

    monkeypatch.setattr(bess.market, "read_prices", counted)
    hours = pd.date_range("2024-03-01", periods=48, freq="h", tz="UTC")

    def earned(level: float) -> list[np.ndarray]:
        prices = pd.DataFrame({"time": hours, "price": level + 20.0 * np.sin(np.arange(48) / 4)})
        prices.to_csv(tmp_path / "prices.csv", index=False)
        values = {
            "demand.prices": str(tmp_path / "prices.csv"),
            "demand.plan": "linear",
            "run.start": hours[0].isoformat(),
            "run.days": 1,
        }
        studies = [
            bess.load_study("arbitrage-2024", values | {"policy.name": name}) for name in ("equal", "soc")
        ]
        runs = [bess.run(study, progress=False) for study in studies]
        return [run.dataset.price_eur_mwh.to_numpy() for run in runs]

    first, second = earned(60.0)
    assert len(read) == 1
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(earned(90.0)[0], first + 30.0)
    assert len(read) == 2


@pytest.mark.parametrize(
    ("name", "broken", "expected"),
    [("soc", np.nan, "step 3: the plant returned soc"), ("delivered_kw", np.inf, "returned delivered_kw")],
)
def test_a_plant_that_returns_no_number_ends_the_run(
    name: str, broken: float, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    follow = bess.Plant.run_controller

    def failing(plant: bess.Plant, *arguments: Any) -> Any:
        request_kw, flows = follow(plant, *arguments)
        getattr(flows, name)[3] *= broken
        return request_kw, flows

    monkeypatch.setattr(bess.Plant, "run_controller", failing)
    with pytest.raises(bess.BessError, match=expected):
        run({"run.days": 0.25})


def test_a_policy_that_misses_the_demand_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def half(policy: RulePolicy, policy_input: PolicyInput) -> Decision:
        return Decision(np.full(2, policy_input.demand_kw[0] / 4.0))

    monkeypatch.setattr(RulePolicy, "__call__", half)
    monkeypatch.setattr(RulePolicy, "controller", None)
    with pytest.raises(
        bess.BessError, match=r"step 0: the policy requested \[-19\.5, -19\.5\] kW for -78 kW"
    ):
        run({"run.days": 0.25})
