"""Claims about straight lines below and above tables."""

import numpy as np
import pytest

from bess.convexity import chord_above, convex_below, line_above, lines_above, lines_below, lower_hull


def table(seed: int, size: int = 40) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return np.sort(rng.uniform(0.0, 1.0, size)), rng.uniform(0.0, 1.0, size)


@pytest.mark.parametrize("seed", range(5))
def test_the_hull_is_convex_below_the_points_and_touches_them(seed: int) -> None:
    x, y = table(seed)
    kept = lower_hull(x, y)
    hull = np.interp(x, x[kept], y[kept])
    assert kept[0] == 0 and kept[-1] == x.size - 1
    assert (hull <= y + 1e-12).all()
    # Slopes rise at every knot; a chord between knots is the highest that a convex function can be there.
    assert (np.diff(np.diff(y[kept]) / np.diff(x[kept])) > 0.0).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_highest_line_below_is_the_hull_and_the_lowest_above_that_of_the_table_upside_down(
    seed: int,
) -> None:
    x, y = table(seed)
    kept, upside_down = lower_hull(x, y), lower_hull(x, -y)
    for (intercept, slope), highest, expected in (
        (lines_below(x, y), np.max, np.interp(x, x[kept], y[kept])),
        (lines_above(x, y), np.min, np.interp(x, x[upside_down], y[upside_down])),
    ):
        np.testing.assert_allclose(highest(slope * x[:, None] + intercept, axis=1), expected, atol=1e-12)
    np.testing.assert_allclose(convex_below(x, y), np.interp(x, x[kept], y[kept]), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_raised_chord_touches_the_table_from_above(seed: int) -> None:
    x, y = table(seed)
    intercept, slope = chord_above(x, y)
    assert slope == pytest.approx((y[-1] - y[0]) / (x[-1] - x[0]))
    assert (intercept + slope * x - y).min() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_lowest_line_above_touches_the_left_end_and_another_point(seed: int) -> None:
    x, y = table(seed)
    intercept, slope = line_above(x, y)
    above = intercept + slope * x - y
    assert above[0] == pytest.approx(0.0, abs=1e-12) and above.min() >= -1e-12
    assert above[1:].min() == pytest.approx(0.0, abs=1e-12)


def test_a_table_of_one_point_has_that_value_as_its_bound() -> None:
    x, y = np.array([3.0]), np.array([0.4])
    assert [part.tolist() for part in lines_above(x, y)] == [[0.4], [0.0]]
    assert chord_above(x, y) == (0.4, 0.0)
    assert convex_below(x, y) is y
