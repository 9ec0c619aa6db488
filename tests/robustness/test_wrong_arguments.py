"""Planning functions answer wrong arguments with one sentence, not with an error of NumPy or a plan."""

import numpy as np
import pandas as pd
import pytest

import bess

SYSTEM = bess.System.reference(2)
STATE = SYSTEM.initial_state()
PRICES = [50.0, 80.0] * 48


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cycles_per_day": -1.0}, "cycles_per_day -1.0 must be finite and above 0"),
        ({"cycles_per_day": float("nan")}, "cycles_per_day nan must be finite"),
        ({"cycles_per_day": "two"}, "cycles_per_day must be .*texts"),
        ({"hours": None}, "hours must be .*NoneType"),
        ({"hours": "24"}, "hours must be .*texts"),
        ({"terms": "cheap"}, r"terms must be bess\.system\.terms\.SettlementTerms, not str"),
        ({"market_time_zone": "Mars"}, "time_zone 'Mars' is unknown"),
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
    with pytest.raises(bess.InputError, match="demand_kw is a single value"):
        bess.plan_power(SYSTEM, STATE, 50.0)
    for function in (bess.plan_power, bess.split_power):
        with pytest.raises(bess.InputError, match=r"dt_h .* must be a number in"):
            function(SYSTEM, STATE, [50.0], dt_h=np.timedelta64(15, "m"))
    with pytest.raises(bess.InputError, match=r"system must be a bess\.System, not str"):
        bess.rollout("reference", STATE, [[1.0], [1.0]])
    with pytest.raises(bess.InputError, match=r"state must be a bess\.State"):
        bess.rollout(SYSTEM, None, [[1.0], [1.0]])
