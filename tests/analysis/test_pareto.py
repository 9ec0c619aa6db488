"""Claims about Pareto tools, against enumeration, closed forms, sampling and (where installed) moocore."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bess.errors import InputError
from bess.simulation.analysis.pareto import hypervolume, knee_point, non_dominated

# Few distinct values, so that ties and copies occur often.
clouds = st.integers(1, 4).flatmap(
    lambda width: arrays(np.float64, st.tuples(st.integers(1, 9), st.just(width)), elements=st.integers(0, 4))
)


def union_of_boxes(points: np.ndarray, reference: np.ndarray) -> float:
    """Inclusion-exclusion over all subsets: exact, exponential, shares nothing with the slicing."""
    total = 0.0
    for size in range(1, len(points) + 1):
        for subset in itertools.combinations(points, size):
            total -= (-1) ** size * float(np.prod(np.maximum(reference - np.max(subset, axis=0), 0.0)))
    return total


@given(clouds)
def test_a_point_is_on_the_front_exactly_if_no_other_dominates_it(points: np.ndarray) -> None:
    expected = [
        not any(all(b <= a for a, b in zip(p, q, strict=True)) and tuple(q) != tuple(p) for q in points)
        for p in points
    ]
    assert non_dominated(points).tolist() == expected


@given(clouds)
def test_hypervolume_is_the_volume_of_the_union_of_boxes(points: np.ndarray) -> None:
    reference = np.full(points.shape[1], 3.5)
    assert hypervolume(points, reference) == pytest.approx(union_of_boxes(points, reference), abs=1e-9)


@given(clouds)
def test_directions_only_mirror_the_problem(points: np.ndarray) -> None:
    width = points.shape[1]
    up = ["max"] * width
    np.testing.assert_array_equal(non_dominated(-points, up), non_dominated(points))
    reference = np.full(width, 5.0)
    assert hypervolume(-points, -reference, up) == pytest.approx(hypervolume(points, reference))
    assert knee_point(-points, up) == knee_point(points)


@given(clouds)
def test_dominated_points_never_change_the_hypervolume(points: np.ndarray) -> None:
    reference = np.full(points.shape[1], 5.0)
    front = points[non_dominated(points)]
    assert hypervolume(front, reference) == pytest.approx(hypervolume(points, reference))


def test_hypervolume_agrees_with_moocore_on_random_fronts() -> None:
    moocore = pytest.importorskip(
        "moocore", reason="moocore, an independent implementation, is not installed"
    )
    rng = np.random.default_rng(7)
    for width in (2, 3, 4):
        points = rng.random((40, width))
        assert hypervolume(points, np.ones(width)) == pytest.approx(
            moocore.hypervolume(points, ref=np.ones(width))
        )
        np.testing.assert_array_equal(non_dominated(points), moocore.is_nondominated(points))


def test_the_knee_of_a_circle_is_at_45_degrees() -> None:
    angle = np.linspace(0.0, np.pi / 2, 91)
    front = 1.0 - np.column_stack([np.cos(angle), np.sin(angle)])
    assert knee_point(front) == 45


def test_the_knee_is_the_point_farthest_from_the_chord_whatever_the_units() -> None:
    rng = np.random.default_rng(3)
    x = np.sort(rng.random(30))
    front = np.column_stack([x, (1.0 - np.sqrt(x)) ** 2]) * [1000.0, 0.01]
    scaled = (front - front.min(axis=0)) / np.ptp(front, axis=0)
    start, chord = scaled[0], scaled[-1] - scaled[0]
    offset = scaled - start
    distance = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0]) / np.hypot(*chord)
    assert knee_point(front) == int(np.argmax(distance))


def test_a_dominated_point_is_never_the_knee() -> None:
    assert knee_point([[0.0, 1.0], [0.45, 0.45], [0.4, 0.4], [1.0, 0.0]]) == 2


@pytest.mark.parametrize(
    ("points", "directions", "message"),
    [
        ([[1.0, np.nan]], None, r"points\[0, 1\] = nan is not a finite number"),
        ([1.0, 2.0], None, r"shape \(n_points, n_objectives\)"),
        ([[1.0, 2.0]], ["min"], "1 directions for 2 objectives"),
        ([[1.0]], ["up"], "'up' is neither"),
    ],
)
def test_bad_points_are_refused(points: list, directions: list | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        non_dominated(points, directions)
