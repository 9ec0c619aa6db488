"""Exchanges between two steps of a schedule."""

import numpy as np
import pytest

from bess.split.exchanges import exchanges, swapped

DEMAND = np.array([30.0, 90.0, 80.0, 60.0])
LIMIT = np.full((2, 4), 92.0)
REQUEST = np.array([[0.0, 60.0, 5.0, 2.0], [30.0, 30.0, 75.0, 58.0]])
DELIVERED = np.array([[0.0, 55.0, 1.0, 1.0], [10.0, 1.0, 1.0, 1.0]])


def made(most, request=REQUEST, delivered=DELIVERED, demand=DEMAND, limit=LIMIT, seed=1):
    return exchanges(request, delivered, demand, limit, np.random.default_rng(seed), most)


def test_a_string_does_in_one_step_what_it_did_in_another_and_the_other_takes_the_rest():
    rows = {tuple(schedule[0]) for schedule in made(100)}
    assert (0.0, 1.0, 55.0, 1.0) in rows
    assert (0.0, 1.0, 1.0, 55.0) in rows
    np.testing.assert_allclose(made(100).sum(axis=1), np.broadcast_to(DEMAND, (8, 4)))


def test_steps_in_which_a_string_does_the_same_are_not_exchanged():
    # Steps 2 and 3 of the first string are alike, steps 1, 2 and 3 of the second: 5 + 3 pairs are left.
    assert len(made(100)) == 8


def test_no_more_are_made_than_asked_for_and_the_same_ones_again():
    assert len(made(3)) == 3
    np.testing.assert_array_equal(made(3), made(3))


@pytest.mark.parametrize("n_strings", [1, 2, 3, 8])
def test_limits_hold_and_a_step_that_only_one_string_can_serve_is_left_to_it(n_strings):
    rng = np.random.default_rng(n_strings)
    limit = rng.uniform(20.0, 92.0, (n_strings, 6)) * rng.choice([0.0, 1.0], (n_strings, 6), p=[0.2, 0.8])
    limit[0, :2] = 50.0
    limit[1:, 0] = 0.0
    demand = limit.sum(axis=0) * rng.uniform(0.1, 1.0, 6)
    request = limit * demand / limit.sum(axis=0).clip(1e-9)
    for schedule in made(30, request, request * rng.uniform(0.0, 1.0, limit.shape), demand, limit):
        assert (schedule >= 0.0).all()
        assert (schedule <= limit + 1e-9).all()
        np.testing.assert_allclose(schedule.sum(axis=0), demand)
        assert schedule[0, 0] == pytest.approx(demand[0])


def test_neighbours_in_the_order_change_places_from_every_step_on():
    request = np.arange(12.0).reshape(3, 4)
    found = swapped(request, np.array([2, 0, 1]), 100)
    assert found.shape == (8, 3, 4)
    np.testing.assert_array_equal(found[0], request[[2, 1, 0]])
    np.testing.assert_array_equal(found[2], [[0, 1, 10, 11], [4, 5, 6, 7], [8, 9, 2, 3]])
    np.testing.assert_array_equal(found[4], request[[1, 0, 2]])


def test_of_many_swaps_some_all_over_the_plant_are_tried():
    found = swapped(np.arange(32.0 * 96).reshape(32, 96), np.arange(32), 64)
    assert 32 <= len(found) <= 64
    changed = (found != np.arange(32.0 * 96).reshape(32, 96)).any(axis=(0, 2))
    assert changed.mean() > 0.9
