"""Set-points hold to every limit, whatever is wanted; they meet the demand wherever they can."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bess.edge.serve.constraints import PowerCapability, SetPointRange, set_point_range, share

POWER = st.floats(0.0, 100.0)
SIGNED = st.floats(-100.0, 100.0)


def free(n: int) -> PowerCapability:
    return PowerCapability(np.full(n, 90.0), np.full(n, 90.0))


@st.composite
def cases(draw: Any) -> dict[str, Any]:
    n = draw(st.integers(1, 5))

    def row(kind: Any) -> Any:
        return np.array(draw(st.lists(kind, min_size=n, max_size=n)))

    return {
        "demand": draw(st.floats(-400.0, 400.0)),
        "wanted": row(POWER),
        "running": row(st.booleans()),
        "charge": row(POWER),
        "discharge": row(POWER),
        "last": row(SIGNED),
        "ramp": draw(st.none() | st.floats(0.0, 50.0)),
        "minimum": row(st.floats(0.0, 30.0)) * draw(st.sampled_from([0.0, 1.0])),
    }


def shared(case: dict[str, Any]) -> tuple[SetPointRange, Any]:
    limits = set_point_range(PowerCapability(case["charge"], case["discharge"]), case["last"], case["ramp"])
    return limits, share(case["demand"], case["wanted"], case["running"], limits, case["minimum"])


@settings(max_examples=400, deadline=None)
@given(cases())
def test_no_set_point_is_beyond_a_limit_or_a_ramp(case: dict[str, Any]) -> None:
    (low_kw, high_kw), request = shared(case)
    assert (request >= low_kw - 1e-9).all()
    assert (request <= high_kw + 1e-9).all()
    assert (request >= -case["charge"] - 1e-9).all()
    assert (request <= case["discharge"] + 1e-9).all()


@settings(max_examples=400, deadline=None)
@given(cases())
def test_strings_never_work_against_each_other(case: dict[str, Any]) -> None:
    _, request = shared({**case, "ramp": None})
    assert (request * np.sign(case["demand"]) >= 0.0).all()
    # Nor on the way under a ramp, if they did not before.
    _, request = shared({**case, "last": np.abs(case["last"])})
    assert not ((request > 1e-9).any() and (request < -1e-9).any())


@settings(max_examples=400, deadline=None)
@given(cases())
def test_power_is_nothing_or_at_least_the_least_power(case: dict[str, Any]) -> None:
    if case["ramp"] is None:
        _, request = shared(case)
        small = (np.abs(request) > 0.0) & (np.abs(request) < case["minimum"] - 1e-9)
        assert not small.any()


@settings(max_examples=400, deadline=None)
@given(cases())
def test_without_ramps_and_least_powers_the_demand_is_met_as_far_as_running_strings_can(
    case: dict[str, Any],
) -> None:
    case = {**case, "ramp": None, "minimum": np.zeros_like(case["minimum"])}
    _, request = shared(case)
    able = case["discharge"] if case["demand"] >= 0.0 else case["charge"]
    most = float(able[case["running"]].sum())
    assert np.isclose(abs(request.sum()), min(abs(case["demand"]), most), rtol=1e-9, atol=1e-7)


@settings(max_examples=400, deadline=None)
@given(cases())
def test_a_demand_is_never_exceeded_unless_a_ramp_holds_a_string_up(case: dict[str, Any]) -> None:
    _, request = shared({**case, "ramp": None})
    assert abs(request.sum()) <= abs(case["demand"]) + 1e-7


def test_what_is_wanted_is_given_where_nothing_stands_against_it() -> None:
    limits = set_point_range(free(3), np.zeros(3), None)
    request = share(60.0, np.array([40.0, 20.0, 0.0]), np.array([True, True, False]), limits, np.zeros(3))
    np.testing.assert_allclose(request, [40.0, 20.0, 0.0])


def test_below_two_least_powers_one_string_takes_all() -> None:
    limits = set_point_range(free(2), np.zeros(2), None)
    request = share(15.0, np.array([8.0, 7.0]), np.ones(2, bool), limits, np.full(2, 10.0))
    np.testing.assert_allclose(request, [15.0, 0.0])


def test_a_reversal_under_a_ramp_goes_through_zero_with_all_strings_on_one_side() -> None:
    last = np.array([50.0, 0.0])
    requests = []
    for _ in range(12):
        limits = set_point_range(free(2), last, 20.0)
        last = share(-60.0, np.array([30.0, 30.0]), np.ones(2, bool), limits, np.zeros(2))
        assert not ((last > 0.0).any() and (last < 0.0).any())
        requests.append(last.sum())
    assert np.isclose(requests[-1], -60.0)
    assert (np.diff(requests) <= 1e-9).all()
