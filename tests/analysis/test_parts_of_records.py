"""KPIs, ledger and hindsight of what is not a whole run: a part of it, a selection, another system."""

import numpy as np
import pytest
from test_settlement import record as priced

import bess
from bess.simulation.analysis.services import service_kpis

QUICK = {"run.days": 0.25, "policy.name": "soc"}


@pytest.fixture(scope="module")
def result() -> bess.Result:
    return bess.run(bess.load_study("case1", QUICK), progress=False)


def test_a_later_part_of_a_run_starts_from_its_own_first_state(result):
    """Cycles counted the way from the initial state of the run to that of the part."""
    part = result.dataset.isel(time=slice(10, 20))
    soc = part["soc"].values
    assert bess.kpis(part)["full_cycles"] == pytest.approx(
        np.abs(np.diff(soc, axis=0)).sum(axis=0).mean() / 2
    )
    assert bess.kpis(part)["soc_spread_start"] == np.ptp(soc[0])
    first = result.dataset.isel(time=slice(0, 10))
    assert bess.kpis(first)["full_cycles"] > np.abs(np.diff(first["soc"].values, axis=0)).sum() / 4


def test_hindsight_of_a_later_part_is_refused(result):
    with pytest.raises(bess.InputError, match="a later part of a run"):
        bess.hindsight(result.dataset.isel(time=slice(4, None)))
    assert bess.hindsight(result.dataset.isel(time=slice(4))).bound_kwh > 0.0


@pytest.mark.parametrize(
    ("select", "message"),
    [
        (lambda data: data.isel(time=slice(0)), "has no steps"),
        (lambda data: data.isel(time=slice(None, None, 2)), "not 900 s apart.*whole periods"),
        (lambda data: data.isel(time=slice(None, None, -1)), "not 900 s apart"),
        (lambda data: data.isel(string=[0]), "has 1 of 2 strings"),
        (lambda data: data.isel(string=0), "has 0 of 2 strings"),
        (lambda data: data.drop_vars(["request_kw", "chemical_kw"]), r"has no .*(request|chemical)_kw"),
    ],
)
def test_selections_that_are_no_record_are_refused_with_what_they_lack(result, select, message):
    for function in (bess.kpis, bess.hindsight):
        with pytest.raises(bess.InputError, match=message):
            function(select(result.dataset))


def test_kpis_without_the_length_of_a_step_say_so(result):
    with pytest.raises(bess.InputError, match="no attribute step_h"):
        bess.kpis(result.dataset.drop_attrs())
    with pytest.raises(bess.InputError, match="no attribute step_h"):
        bess.ledger(priced().drop_attrs())
    for value in (None, 3, "results"):
        with pytest.raises(bess.InputError, match="ledger needs a result"):
            bess.ledger(value)


def test_hindsight_is_that_of_the_system_that_ran(result, tmp_path):
    """A system given to the run was replaced by that of the study: another bound, or an error of NumPy."""
    resistive = bess.load_study("case1", QUICK | {"system.parameters.battery.r_scale": 2.0})
    expected = bess.hindsight(bess.run(resistive, progress=False))
    document = dict(bess.System.reference(2).document)
    document["battery"] = document["battery"] | {"r_scale": 2.0}
    own = bess.System(document, name="own")
    given = bess.run(bess.load_study("case1", QUICK), system=own, progress=False, out=tmp_path / "run")
    assert bess.hindsight(given) == expected
    for data in (given.dataset, bess.open_result(tmp_path / "run")):
        with pytest.raises(
            bess.InputError, match=r"another system than system\.file = 'reference'.*bess report"
        ):
            bess.hindsight(data)


def test_curtailed_generation_is_not_consumed():
    """100 kW of sun, no load, a limit of 40 kW: 60 % of self-consumption was said."""
    data = priced(load_kw=("time", np.zeros(4)), generation_kw=("time", np.full(4, 100.0)))
    data["export_limit_kw"] = ("time", np.full(4, 40.0))
    data["delivered_kw"] = 0.0 * data["delivered_kw"]
    kpis = dict(service_kpis(data))
    assert kpis["self_consumption_pct"] == 0.0
    assert kpis["curtailed_kwh"] == 60.0
