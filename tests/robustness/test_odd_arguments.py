"""Claim: whatever a plant or a power split is given in place of its arguments, it says what it wants."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

import bess
from bess.dispatch import read_profile
from bess.plant import PlantEnsemble

SYSTEM = bess.System.reference(2)
START = SYSTEM.initial_state()
ODD: tuple[Any, ...] = (
    *(1 + 2j, 10**400, -(10**400), float("nan"), "x", None, b"ab", {}, [], {1}),
    *([1 + 2j, 1], [10**400, 1], [1.5, 10**400], [[10**400, 1], [2]], [1, [2]], [np.nan, 1]),
    *([np.longdouble("1e4000")] * 2, np.longdouble("1e4000"), np.complex128(1.0), [Decimal("sNaN"), 1]),
)


def _warm(value: Any) -> None:
    bess.PowerSplit(SYSTEM, 2).warm_start = value


CALLS: dict[str, Callable[[Any], Any]] = {
    "system": lambda value: bess.Plant(value, START),
    "state": lambda value: bess.Plant(SYSTEM, value),
    "states": lambda value: PlantEnsemble(SYSTEM, value),
    "derating_law": lambda value: bess.Plant(SYSTEM, START, derating_law=value),
    "request_kw": lambda value: bess.Plant(SYSTEM, START).step(value),
    "snapshot": lambda value: bess.Plant(SYSTEM, START).restore(value),
    "soc": lambda value: bess.State(value, [25.0, 25.0]),
    "demand_kw": lambda value: bess.split_power(SYSTEM, START, value),
    "state of a split": lambda value: bess.PowerSplit(SYSTEM, 1)(value, [1.0]),
    "limit_kw": lambda value: bess.PowerSplit(SYSTEM, 1)(START, [1.0], None, value),
    "dt_h": lambda value: bess.split_power(SYSTEM, START, [1.0], dt_h=value),
    "warm_start": _warm,
}
NONE_MEANS_THE_DEFAULT = {"limit_kw", "warm_start"}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", CALLS)
def test_odd_arguments_are_refused(name: str) -> None:
    for value in ODD:
        if value is None and name in NONE_MEANS_THE_DEFAULT:
            continue
        with pytest.raises(bess.InputError):
            CALLS[name](value)


@pytest.mark.parametrize("read", [bess.read_prices, bess.read_weather, read_profile])
def test_a_file_without_a_name_is_said_to_have_none(read: Callable[..., Any]) -> None:
    with pytest.raises(bess.InputError, match=r"a file is named by an empty text; give its path"):
        read("")


@pytest.mark.parametrize("name", ["soc", "node_temperature_c", "derating_integral_k", "ageing"])
def test_odd_numbers_of_a_snapshot_are_refused(name: str) -> None:
    plant = bess.Plant(SYSTEM, START)
    before = plant.snapshot()
    for value in ODD:
        with pytest.raises(bess.InputError, match=r"plant: "):
            plant.restore(dataclasses.replace(before, **{name: value}))
    np.testing.assert_array_equal(plant.snapshot().soc, before.soc)


def test_a_snapshot_above_the_limit_of_a_run_is_refused() -> None:
    plant = bess.Plant(SYSTEM, START)
    hot_c = np.full_like(plant.snapshot().node_temperature_c, 150.1)
    with pytest.raises(bess.InputError, match=r"node temperature 150.1 degC is outside \[-60, 150\]"):
        plant.restore(dataclasses.replace(plant.snapshot(), node_temperature_c=hot_c))


@pytest.mark.parametrize("strings", [np.array([0]), [1, 0], [True] * 3, True, [[True], [True, False]]])
def test_strings_to_renew_are_truth_values(strings: Any) -> None:
    """``[1, 0]`` as integers, or the index of a string, renewed others or none."""
    with pytest.raises(bess.InputError, match=r"strings must be .*truth values"):
        bess.Plant(SYSTEM, START).renew(strings)


def test_a_snapshot_of_another_shape_is_refused() -> None:
    """Transposed node temperatures, which are as many, were taken, and 2 or NaN as an inverter that is on."""
    plant = bess.Plant(SYSTEM, START)
    before = plant.snapshot()
    with pytest.raises(bess.InputError, match=r"node_temperature_c has shape \(40, 2\), needs \(2, 40\)"):
        plant.restore(dataclasses.replace(before, node_temperature_c=before.node_temperature_c.T))
    with pytest.raises(bess.InputError, match=r"inverter_on must be truth values of shape \(2,\)"):
        plant.restore(dataclasses.replace(before, inverter_on=np.array([np.nan, 2.0])))  # type: ignore[arg-type]
    plant.restore(before)


@pytest.mark.parametrize("ambient_c", [298.0, np.nan])
def test_the_ambient_temperature_of_a_plant_is_checked_at_once(ambient_c: float) -> None:
    with pytest.raises(bess.InputError, match=r"ambient_c .* degC is outside \[-60, 150\] degC"):
        bess.Plant(SYSTEM, START, ambient_c=ambient_c)
