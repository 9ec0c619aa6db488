"""Claims about the ledger: what each EUR is for, and that nothing is counted twice or lost."""

import math

import numpy as np
import pytest
import xarray as xr

import bess
from bess.errors import InputError
from bess.simulation.analysis.settlement import COSTS

STUDY = """
name = "settled"
[demand]
kind = "arbitrage"
[settlement]
shortfall_eur_mwh = 30.0
charge_fee_eur_mwh = 4.0
discharge_fee_eur_mwh = 6.0
start_eur = 0.25
"""


def record(steps: int = 4, study: str = STUDY, seed: int = 0, **changes: object) -> xr.Dataset:
    """Flows of two strings that share each step's direction, at any price."""
    rng = np.random.default_rng(seed)
    direction = rng.choice([-1.0, 0.0, 1.0], steps)[:, None]
    delivered = direction * rng.uniform(0.0, 92.0, (steps, 2))
    values: dict[str, object] = {
        "demand_kw": ("time", delivered.sum(axis=1) + direction[:, 0] * rng.uniform(0.0, 9.0, steps)),
        "price_eur_mwh": ("time", rng.normal(60.0, 90.0, steps)),
        "delivered_kw": (("time", "string"), delivered),
        "standby_kw": (("time", "string"), np.where(delivered == 0.0, 0.03, 0.0)),
        "wear_eur": (("time", "string"), rng.uniform(0.0, 0.3, (steps, 2))),
        "inverter_starts": (("time", "string"), rng.integers(0, 3, (steps, 2))),
    }
    time = np.datetime64("2024-01-01T00:00", "ns") + np.arange(steps) * np.timedelta64(15, "m")
    return xr.Dataset(values | changes, {"time": time}, {"step_h": 0.25, "study": study})


def test_each_entry_follows_its_definition() -> None:
    data = record(
        demand_kw=("time", [100.0, -100.0, 0.0, 10.0]),
        price_eur_mwh=("time", [200.0, -40.0, 100.0, -20.0]),
        delivered_kw=(("time", "string"), [[50.0, 40.0], [-50.0, -50.0], [0.0, 0.0], [10.0, 0.0]]),
        standby_kw=(("time", "string"), [[0.0, 0.0], [0.0, 0.0], [2.0, 2.0], [0.0, 2.0]]),
        wear_eur=(("time", "string"), [[0.5, 0.25], [0.0, 0.0], [0.125, 0.0], [0.0, 1.0]]),
        inverter_starts=(("time", "string"), [[1, 1], [0, 0], [0, 0], [1, 0]]),
    )
    ledger = bess.ledger(data)
    mwh = 0.25 / 1000.0
    expected = {
        "discharge_revenue_eur": [90 * mwh * 194, 0.0, 0.0, 10 * mwh * -26],
        "charge_cost_eur": [0.0, 100 * mwh * -36, 0.0, 0.0],
        "shortfall_eur": [10 * mwh * 230, 0.0, 0.0, 0.0],
        "wear_eur": [0.75, 0.0, 0.125, 1.0],
        "start_eur": [0.5, 0.0, 0.0, 0.25],
        "auxiliary_eur": [0.0, 0.0, 4 * mwh * 104, 2 * mwh * -16],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(ledger[name], values, atol=1e-12, err_msg=name)
    net = np.array(expected["discharge_revenue_eur"]) - sum(
        np.array(expected[name]) for name in COSTS if name in expected
    )
    np.testing.assert_allclose(ledger["net_eur"], net, atol=1e-12)
    assert set(ledger.data_vars) == {*expected, "net_eur"}


def test_without_terms_a_record_is_settled_at_the_defaults_of_a_study() -> None:
    data = record(study='name = "plain"\n[demand]\nkind = "arbitrage"\n')
    assert bess.ledger(data).attrs == {
        "shortfall_eur_mwh": 50.0,
        "charge_fee_eur_mwh": 0.0,
        "discharge_fee_eur_mwh": 0.0,
        "start_eur": 0.0,
        "discount_rate": 0.05,
        "capacity_penalty": 2.0,
    }


def test_the_net_of_a_year_is_the_sum_of_its_entries_to_less_than_a_cent() -> None:
    """Against exact fractions: 35,040 steps, prices of both signs."""
    from fractions import Fraction

    from bess.simulation.analysis.settlement import settlement_kpis

    data = record(35_040)
    kpis = dict(settlement_kpis(data))
    ledger = bess.ledger(data)
    exact = {name: sum(map(Fraction, ledger[name].values.tolist())) for name in ledger.data_vars}
    for name, value in exact.items():
        assert abs(kpis[str(name)] - value) < 1e-6, name
    assert kpis["net_eur"] == pytest.approx(
        kpis["discharge_revenue_eur"] - math.fsum(kpis[name] for name in COSTS if name in kpis), abs=1e-9
    )


def test_old_records_without_wear_and_standby_are_settled_without() -> None:
    ledger = bess.ledger(record().drop_vars(["wear_eur", "standby_kw"]))
    assert not ledger["wear_eur"].values.any()
    assert not ledger["auxiliary_eur"].values.any()


def test_a_record_without_prices_cannot_be_settled() -> None:
    with pytest.raises(InputError, match="settlement: the record has no prices"):
        bess.ledger(record().drop_vars("price_eur_mwh"))


def test_a_study_says_what_its_terms_may_be() -> None:
    with pytest.raises(InputError, match=r"settlement.start_eur"):
        bess.load_study("arbitrage-2024", {"settlement.start_eur": -1.0})
    with pytest.raises(InputError, match=r"wear.model"):
        bess.load_study("arbitrage-2024", {"wear.model": "rust"})
    with pytest.raises(InputError, match=r"did you mean 'settlement.charge_fee_eur_mwh'"):
        bess.load_study("arbitrage-2024", {"settlement.charge_fee_mwh": 1.0})


def test_cooling_is_bought_at_the_price_and_fee_of_charging_beside_standby() -> None:
    plain = record()
    cooled = record(auxiliary_kw=("time", [1.0, 0.0, 2.5, 4.0]))
    extra_eur = bess.ledger(cooled)["auxiliary_eur"] - bess.ledger(plain)["auxiliary_eur"]
    price = plain["price_eur_mwh"].values + 4.0
    np.testing.assert_allclose(extra_eur, np.array([1.0, 0.0, 2.5, 4.0]) * 0.25e-3 * price, rtol=1e-9)
    np.testing.assert_allclose(bess.ledger(cooled)["net_eur"] + extra_eur, bess.ledger(plain)["net_eur"])
