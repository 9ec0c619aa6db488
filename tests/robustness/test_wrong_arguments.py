"""Public functions answer wrong arguments with one sentence, not with an error of NumPy or a plan."""

from threading import Thread

import numpy as np
import pandas as pd
import pytest

import bess
from bess.control import wear

SYSTEM = bess.System.reference(2)
STATE = SYSTEM.initial_state()
PRICES = [50.0, 80.0] * 48


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cycles_per_day": -1.0}, "cycles_per_day -1.0 must be finite and above 0"),
        ({"cycles_per_day": float("nan")}, "cycles_per_day is nan; every value must be finite"),
        ({"cycles_per_day": "two"}, "cycles_per_day must be .*texts"),
        ({"cycles_per_day": None}, "cycles_per_day must be .*NoneType"),
        ({"hours": None}, "hours must be .*NoneType"),
        ({"hours": "24"}, "hours must be .*texts"),
        ({"terms": "cheap"}, r"terms must be bess\.system\.terms\.SettlementTerms, not str"),
        ({"market_time_zone": "Mars"}, "time_zone 'Mars' is unknown"),
        ({"market_time_zone": 1}, "time_zone 1 is unknown"),
        ({"system": "reference"}, r"system must be a bess\.System, not str"),
    ],
)
def test_plan_dispatch(change, message):
    """A limit of -1 or NaN cycles a day was planned without a discharge."""
    index = pd.date_range("2024-01-01", periods=96, freq="15min", tz="UTC")
    given = {"system": SYSTEM, "prices": pd.Series(PRICES, index), "state": STATE, "hours": 24.0} | change
    with pytest.raises(bess.InputError, match=message):
        bess.plan_dispatch(**given)


@pytest.mark.parametrize("name", ["energy_kwh", "power_kw", "round_trip", "initial_kwh", "dt_h", "cycles"])
def test_store_value(name):
    for value in ("1", [1.0, 2.0]) if name == "cycles" else ("1", None, [1.0, 2.0]):
        with pytest.raises(bess.InputError, match=f"store_value: {name} "):
            bess.store_value(PRICES, **{name: value})


def test_splits_plans_and_roll_outs():
    with pytest.raises(bess.InputError, match=r"objectives must be bess\.Objectives, not str"):
        bess.plan_power(SYSTEM, STATE, [50.0], objectives="energy")
    for function in (bess.plan_power, bess.split_power):
        for demand_kw in (50.0, [], [[50.0, 60.0]]):
            with pytest.raises(bess.InputError, match=r"demand_kw has shape .* give one value for each step"):
                function(SYSTEM, STATE, demand_kw)
        for demand_kw in (None, [[50.0], [60.0, 70.0]]):
            with pytest.raises(bess.InputError, match="demand_kw must be an array of numbers"):
                function(SYSTEM, STATE, demand_kw)
        with pytest.raises(bess.InputError, match=r"dt_h must be .*timedelta64"):
            function(SYSTEM, STATE, [50.0], dt_h=np.timedelta64(15, "m"))
    with pytest.raises(bess.InputError, match=r"system must be a bess\.System, not str"):
        bess.rollout("reference", STATE, [[1.0], [1.0]])
    with pytest.raises(bess.InputError, match=r"system must be a bess\.System, not NoneType"):
        wear.marginal(None, STATE)
    with pytest.raises(bess.InputError, match=r"state must be a bess\.State"):
        bess.rollout(SYSTEM, None, [[1.0], [1.0]])


@pytest.mark.parametrize(
    "key",
    ["run.days", "policy.rollouts", "system.n_strings", "settlement.shortfall_eur_mwh", "system.ambient_c"],
)
def test_true_is_no_number_of_a_study(key):
    """``run.days = true`` was a run of one day."""
    with pytest.raises(bess.InputError, match=rf"{key} = True: must be a (whole )?number"):
        bess.load_study("case1", {key: True})


def test_studies_and_runs():
    with pytest.raises(bess.InputError, match="values must be a table of keys, not str"):
        bess.load_study("case1", "run.days = 2")
    with pytest.raises(bess.InputError, match="3: unknown key"):
        bess.load_study("case1", {3: 1})
    with pytest.raises(bess.InputError, match="a study is a bundled name or a path, not int"):
        bess.load_study(1)
    with pytest.raises(
        bess.InputError, match=r"system must be a bess\.System, not str; see bess\.load_system"
    ):
        bess.run("case1", system="m5bat")


@pytest.mark.parametrize(("name", "value"), [("zone", None), ("product", ["id1"]), ("time_zone", 1)])
def test_prices(tmp_path, name, value):
    with pytest.raises(
        bess.InputError, match=f"read_prices: {name} must be a text, not {type(value).__name__}"
    ):
        bess.read_prices(tmp_path / "prices.csv", **{name: value})


def test_inverters():
    for value in (None, "90", 10**400):
        with pytest.raises(bess.InputError, match="nominal_kw must be an array of numbers"):
            bess.inverter_from_efficiency([0.1, 1.0], discharge=[0.9, 0.97], nominal_kw=value)
    coefficients = dict.fromkeys(("paco_w", "pdco_w", "vdco_v", "pso_w", "c0_per_w", "c1_per_v"), 1.0)
    with pytest.raises(bess.InputError, match=r"Sandia coefficients: C2 must be .*NoneType"):
        bess.inverter_from_sandia(**coefficients, c2_per_v=None, c3_per_v=0.0)


def test_a_plant_belongs_to_one_thread():
    """Calls of a second thread failed with a RuntimeError of the binding, "Already borrowed"."""
    plant = bess.Plant(SYSTEM, STATE)
    month = Thread(target=plant.run, args=(np.zeros((2880, 2)),))
    month.start()
    with pytest.raises(bess.BessError, match="another thread is advancing it"):
        while month.is_alive():
            plant.state  # noqa: B018
    month.join()


def test_a_split_has_no_prices():
    """Objectives in EUR were minimised in kWh."""
    for function in (bess.split_power, lambda *given, **more: bess.PowerSplit(given[0], 1, **more)):
        with pytest.raises(bess.InputError, match='objectives of kind "money" need plans and prices'):
            function(SYSTEM, STATE, [50.0], objectives=bess.Objectives.money())


def test_integers_of_numpy_are_whole_numbers():
    """``node_limit = np.int64(3): must be a whole number``, said the message."""
    three = bess.split_power(SYSTEM, STATE, [50.0], node_limit=np.int64(3))
    assert three == bess.split_power(SYSTEM, STATE, [50.0], node_limit=3)
    assert bess.Objective(priority=np.int64(2)) == bess.Objective(priority=2)


@pytest.mark.parametrize("value", [None, 5, b"folder", ""])
def test_folders_are_named_by_texts_or_paths(value):
    """A result in place of its folder was a TypeError of pathlib; an empty text was the current folder."""
    day = bess.load_study("case1", {"run.days": 0.125, "policy.name": "equal"})
    calls = [bess.open_result, bess.write_report, lambda out: bess.run_sweep(day, out)]
    if value is not None:
        calls += [lambda out: bess.run(day, out=out), lambda out: bess.run_scenarios(day, out=out)]
    for call in calls:
        with pytest.raises(bess.InputError, match="a folder is named by"):
            call(value)
    with pytest.raises(bess.InputError, match="a file is named by"):
        bess.read_inverter(value)


@pytest.mark.parametrize("workers", [0, "2", 1.5])
def test_workers_are_whole_numbers(tmp_path, workers):
    with pytest.raises(bess.InputError, match=rf"workers = {workers!r}: must be a whole number, at least 1"):
        bess.run_sweep("pareto", tmp_path / "sweep", workers=workers, progress=False)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"max_error": -1.0}, "max_error -1 must be at least 0"),
        ({"max_error": "a"}, "max_error must be .*texts"),
        ({"max_error": float("nan")}, "max_error is nan"),
        ({"off_loss": None}, "off_loss must be .*NoneType"),
    ],
)
def test_tolerances_of_loss_tables(changed, message):
    with pytest.raises(bess.InputError, match=message):
        bess.inverter_from_loss([0.1, 0.5, 1.0], discharge=[0.01, 0.02, 0.04], nominal_kw=60.0, **changed)


def test_a_transposed_record_has_the_same_figures():
    """``dataset.transpose()`` was an error of NumPy, or another record if steps and strings are as many."""
    for days in (0.125, 2 / 96):
        result = bess.run(
            bess.load_study("case1", {"run.days": days, "policy.name": "equal"}), progress=False
        )
        assert bess.kpis(result.dataset.transpose()) == bess.kpis(result.dataset)
