"""Claims about inverter tables: every way of publishing one leads to the same losses; bad rows are named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bess
from bess.system.components.knots import reduced_knots
from bess.system.components.loss_table import LossTable
from bess.system.sections import Inverter

LOAD = np.linspace(0.0, 1.0, 101)


def loss_of(x: np.ndarray) -> np.ndarray:
    return 0.012 + 0.004 * x + 0.0033 * x**2


def at(table: LossTable, x: np.ndarray, direction: str) -> np.ndarray:
    return np.interp(x, table.load, getattr(table, f"loss_{direction}"))


def published(direction: str, axis: str) -> tuple[np.ndarray, np.ndarray]:
    """Power on the axis and efficiency of an inverter whose loss over AC power is known."""
    ac, loss = LOAD[5:], loss_of(LOAD[5:])
    dc = ac + loss if direction == "discharge" else ac - loss
    output, source = (ac, dc) if direction == "discharge" else (dc, ac)
    return {"ac": ac, "dc": dc, "input": source, "output": output}[axis], output / source


@pytest.mark.parametrize("axis", ["ac", "dc", "input", "output"])
@pytest.mark.parametrize("direction", ["charge", "discharge"])
@pytest.mark.parametrize("percent", [False, True])
@pytest.mark.parametrize("unit", ["fraction", "percent", "kw", "w"])
def test_every_way_of_publishing_efficiency_gives_the_same_losses(
    axis: str, direction: str, percent: bool, unit: str
) -> None:
    power, efficiency = published(direction, axis)
    scale = {"fraction": 1.0, "percent": 100.0, "kw": 92.0, "w": 92_000.0}[unit]
    given: dict[str, Any] = {direction: efficiency * (100.0 if percent else 1.0)}
    table = bess.inverter_from_efficiency(
        power * scale,
        nominal_kw=92.0,
        power_unit=unit,
        axis=axis,
        max_error=1e-5,
        **given,  # type: ignore[arg-type]
    )
    np.testing.assert_allclose(at(table, LOAD, direction), loss_of(LOAD), atol=3e-5)
    Inverter.model_validate(table.section())


@pytest.mark.parametrize(
    ("unit", "values"),
    [
        ("nominal", loss_of(LOAD[5:])),
        ("nominal-percent", 100.0 * loss_of(LOAD[5:])),
        ("kw", 92.0 * loss_of(LOAD[5:])),
        ("w", 92_000.0 * loss_of(LOAD[5:])),
        ("axis", loss_of(LOAD[5:]) / LOAD[5:]),
        ("axis-percent", 100.0 * loss_of(LOAD[5:]) / LOAD[5:]),
    ],
)
def test_every_unit_of_loss_gives_the_same_losses(unit: str, values: np.ndarray) -> None:
    table = bess.inverter_from_loss(
        LOAD[5:],
        charge=values,
        nominal_kw=92.0,
        loss_unit=unit,
        max_error=1e-5,  # type: ignore[arg-type]
    )
    np.testing.assert_allclose(at(table, LOAD, "charge"), loss_of(LOAD), atol=3e-5)


def test_a_zero_by_zero_first_row_and_the_order_of_rows_do_not_matter() -> None:
    power, efficiency = published("discharge", "ac")
    plain = bess.inverter_from_efficiency(power, discharge=efficiency, nominal_kw=1.0)
    for first in (0.0, float("nan"), 1.0):
        shuffled = bess.inverter_from_efficiency(
            np.append(power, 0.0)[::-1], discharge=np.append(efficiency, first)[::-1], nominal_kw=1.0
        )
        np.testing.assert_array_equal(shuffled.loss_discharge, plain.loss_discharge)


def test_one_direction_serves_for_both_at_equal_ac_power() -> None:
    power, efficiency = published("charge", "ac")
    table = bess.inverter_from_efficiency(power, charge=efficiency, nominal_kw=1.0)
    np.testing.assert_array_equal(table.loss_charge, table.loss_discharge)


def test_no_load_loss_is_the_straight_line_through_the_first_rows_and_never_negative() -> None:
    table = bess.inverter_from_loss([0.1, 0.2, 1.0], charge=[0.02, 0.03, 0.05], nominal_kw=1.0, max_error=0.0)
    assert table.loss_charge[0] == pytest.approx(0.01)
    steep = bess.inverter_from_loss([0.1, 0.2, 1.0], charge=[0.01, 0.03, 0.05], nominal_kw=1.0, max_error=0.0)
    assert steep.loss_charge[0] == 0.0


def test_tables_that_are_neither_convex_nor_monotone_are_kept_as_they_are() -> None:
    power, loss = (
        np.linspace(0.0, 1.0, 11),
        [0.02, 0.01, 0.03, 0.02, 0.02, 0.05, 0.04, 0.04, 0.03, 0.03, 0.06],
    )
    table = bess.inverter_from_loss(power, charge=loss, nominal_kw=1.0, max_error=1e-6)
    np.testing.assert_allclose(at(table, power, "charge"), loss, atol=1e-6)


def test_a_table_beyond_nominal_power_is_cut_and_one_that_ends_early_is_refused() -> None:
    table = bess.inverter_from_loss([0.0, 0.5, 1.5], charge=[0.01, 0.02, 0.04], nominal_kw=1.0, max_error=0.0)
    assert table.load[-1] == 1.0
    assert table.loss_charge[-1] == pytest.approx(0.03)
    with pytest.raises(bess.InputError, match=r"ends at an AC power of 0\.5 of nominal, must reach"):
        bess.inverter_from_loss([0.1, 0.5], charge=[0.01, 0.02], nominal_kw=1.0)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"charge": [0.9, 1.02]}, r"row 2: charge efficiency is 1\.02, must be at least 0 and at most 1"),
        ({"charge": [95.0, 101.0]}, r"row 2: charge efficiency is 1\.01"),
        ({"charge": [0.9, float("nan")]}, "row 2: charge efficiency is nan"),
        ({"discharge": [0.0, 0.9]}, "row 1: discharge efficiency is 0, must be above 0"),
        ({"charge": [0.9]}, "charge has 1 rows, power has 2"),
        ({}, "give values of charge, of discharge, or of both"),
        ({"charge": [0.9, 0.9], "axis": "left"}, "axis 'left': allowed are"),
        ({"charge": [0.9, 0.9], "power_unit": "mw"}, "power_unit 'mw': allowed are"),
        ({"charge": [0.9, 0.9], "nominal_kw": -1.0}, "nominal_kw -1 kW"),
    ],
)
def test_bad_rows_and_choices_are_named(keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(bess.InputError, match=message):
        bess.inverter_from_efficiency([0.5, 1.0], **{"nominal_kw": 1.0, **keywords})


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=60, unique=True), st.floats(1e-6, 0.5), st.randoms()
)
def test_reduction_stays_within_its_error(knots: list[float], max_error: float, random: Any) -> None:
    x = np.sort(np.array(list(knots)))
    rows = np.array([[random.random() for _ in x] for _ in range(2)])
    kept, error = reduced_knots(x, rows, max_error)
    again = np.array([np.interp(x, x[kept], row[kept]) for row in rows])
    assert np.abs(again - rows).max() <= error + 1e-12
    assert error <= max_error


def test_sandia_model_returns_its_rating_and_its_self_consumption() -> None:
    """At rated AC power the model needs the rated DC power, at none the start-up power (SAND2007-5036)."""
    table = bess.inverter_from_sandia(
        paco_w=1e5,
        pdco_w=1.05e5,
        vdco_v=480.0,
        pso_w=1200.0,
        c0_per_w=-3e-7,
        c1_per_v=-6e-5,
        c2_per_v=-6e-4,
        c3_per_v=-9e-4,
    )
    assert table.nominal_kw == 100.0
    assert table.loss_discharge[0] == pytest.approx(0.012)
    assert table.loss_discharge[-1] == pytest.approx(0.05)
    # The forward model, DC to AC, undoes the table.
    a, b, c = 1.05e5, 1200.0, -3e-7
    dc = (table.load + table.loss_discharge) * 1e5
    ac = (1e5 / (a - b) - c * (a - b)) * (dc - b) + c * (dc - b) ** 2
    np.testing.assert_allclose(ac / 1e5, table.load, atol=1e-12)


def test_invalid_sandia_coefficients_are_refused() -> None:
    with pytest.raises(bess.InputError, match="need 0 < Paco < Pdco"):
        bess.inverter_from_sandia(
            paco_w=1e5,
            pdco_w=0.9e5,
            vdco_v=480.0,
            pso_w=1.0,
            c0_per_w=0.0,
            c1_per_v=0.0,
            c2_per_v=0.0,
            c3_per_v=0.0,
        )
