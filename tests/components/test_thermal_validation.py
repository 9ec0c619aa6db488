"""Claims about the measured Leaf cell: temperatures that were not fitted are predicted."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data" / "thermal"
pytestmark = [
    pytest.mark.golden,
    pytest.mark.skipif(not DATA.is_dir(), reason=f"measured discharges are not at {DATA}"),
]


@pytest.fixture(scope="module")
def validation() -> ModuleType:
    sys.path.insert(0, str(ROOT / "examples"))
    try:
        import thermal_validation
    finally:
        sys.path.pop(0)
    module: ModuleType = thermal_validation
    return module


@pytest.mark.parametrize(("trained", "bound_k"), [((0, 1), 1.0), ((1,), 1.0)])
def test_temperatures_of_unseen_c_rates_are_predicted_within_a_kelvin(
    validation: ModuleType, trained: tuple[int, ...], bound_k: float
) -> None:
    """Index 0, 1, 2 is 1C, 2C, 3C. Trained at 1C alone the model misses 3C by 1.4 K; the page says why."""
    tests = validation.leaf_tests(DATA)
    system = validation.fit_plant([tests[index] for index in trained])
    plain = validation.fit_lumped([tests[index] for index in trained])
    for index, test in enumerate(tests):
        if index in trained:
            continue
        error = validation.rmse(validation.predict(validation.with_electrics_of(system, test), test), test)
        assert error <= bound_k, test.name
        assert error <= validation.rmse(validation.lumped(plain, test), test) + 0.05, test.name


def test_one_cell_in_still_air_is_the_same_with_any_number_of_nodes(validation: ModuleType) -> None:
    """Nothing varies along such a cell: the one-dimensional model does not help here."""
    test = validation.leaf_tests(DATA)[2]
    coarse, fine = (
        validation.predict(
            validation.cell_system([test], specific_heat_j_kgk=1866.0, film_w_m2k=21.2, nodes=nodes), test
        )
        for nodes in (2, 20)
    )
    np.testing.assert_allclose(coarse, fine, atol=1e-6)


def test_reversible_heat_fitted_at_1c_predicts_2c_and_3c_within_half_a_kelvin(validation: ModuleType) -> None:
    """Without it the same fit misses them by 0.68 and 1.39 K (docs/validation-thermal.md)."""
    tests = validation.leaf_tests(DATA)
    system = validation.fit_plant(tests[:1], "fitted")
    errors = [
        validation.rmse(validation.predict(validation.with_electrics_of(system, test), test), test)
        for test in tests
    ]
    np.testing.assert_allclose(errors, [0.08, 0.20, 0.50], atol=0.01)


def test_the_entropy_of_another_cell_does_not_predict_this_one(validation: ModuleType) -> None:
    tests = validation.leaf_tests(DATA)
    system = validation.fit_plant(tests[:1], "published")
    test = tests[2]
    error = validation.rmse(validation.predict(validation.with_electrics_of(system, test), test), test)
    assert error == pytest.approx(1.82, abs=0.02)
