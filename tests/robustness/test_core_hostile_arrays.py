"""Claim: whatever arrays the core is given, it answers or raises ValueError or TypeError; no panic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bess
from bess import _core

CORE = bess.System(bess.System.reference(2).document | {"wear": {"model": "kokam-75ah"}}).core
N, STEPS, NODES = 2, 3, 40
SOC, TEMPERATURE = np.array([0.5, 0.4]), np.array([25.0, 30.0])
DEMAND, AMBIENT = np.array([50.0, -40.0, 0.0]), np.full(STEPS, 25.0)
STATE = {
    "soc": SOC,
    "node_temperature_c": np.full(N * NODES, 25.0),
    "derating_integral_k": np.zeros(N),
    "inverter_on": np.zeros(N, dtype=np.bool_),
    "soh_capacity": np.ones(N),
    "soh_resistance": np.ones(N),
}
LIMIT = np.full((N, STEPS), 92.0)
COSTS = np.ones((2, N, 4))


def plant(state: dict[str, Any] | None = None) -> _core.Plant:
    return _core.Plant(CORE, 1, 10.0, "table", STATE if state is None else state)


def horizon(**changes: Any) -> _core.ControlHorizon:
    given_ = {
        "soc": SOC,
        "temperature_c": TEMPERATURE,
        "demand_kw": DEMAND,
        "ambient_c": AMBIENT,
        "dt_h": 0.25,
        "limit_kw": LIMIT,
        "costs": COSTS,
        "search_costs": COSTS,
        "tol_abs": np.full(2, 1e-6),
        "tol_rel": np.full(2, 1e-4),
    } | changes
    return _core.ControlHorizon(MODEL, *given_.values())


def _step(request: Any) -> Any:
    return plant().run(request, np.array([25.0]), 900.0, True)


def _state(name: str) -> Callable[[Any], Any]:
    return lambda value: plant({**STATE, name: value}).run(np.zeros(N), np.array([25.0]), 900.0, True)


def _set_state(name: str) -> Callable[[Any], Any]:
    return lambda value: plant().set_state({**STATE, name: value})


def _searched(name: str) -> Callable[[Any], Any]:
    def call(value: Any) -> Any:
        made = horizon(**{name: value})
        return made.greedy(), made.reachable(), made.split(None, 40)

    return call


MODEL = _core.ControlModel(CORE)
BOX = [np.full((N, STEPS), value) for value in (0.2, 0.8, 20.0, 40.0)]
STATES = _core.StateBoxes(*BOX)


def _box(index: int) -> Callable[[Any], Any]:
    def call(value: Any) -> Any:
        boxes = _core.StateBoxes(*(value if i == index else each for i, each in enumerate(BOX)))
        return horizon().step_bounds(boxes, np.ones((N, 4)), np.full(STEPS, np.inf))

    return call


PLAN: dict[str, Any] = {
    "soc": SOC,
    "temperature_c": TEMPERATURE,
    "running": np.zeros(N, dtype=np.bool_),
    "demand_kw": DEMAND,
    "ambient_c": AMBIENT,
    "limit_kw": LIMIT,
    "loss_prices": np.ones((STEPS, 4)),
    "wear": np.zeros(N),
    "previous_kw": np.zeros((N, STEPS)),
    "reactive_kvar": np.zeros(STEPS),
}
PRICES: dict[str, Any] = {"start_cost": 0.1, "balance": 0.01, "end_charge": -0.01}
EFFORT: dict[str, Any] = {
    "rollouts": 20,
    "restart_rollouts": 20,
    "price_passes": 2,
    "proof_cells": 20,
    "turn": 0,
}
SHARES = np.linspace(0.0, 92.0, 5)[:, None] * np.ones(N)


def _planned(name: str) -> Callable[[Any], Any]:
    return lambda value: _core.plan(MODEL, dt_h=0.25, **{**PLAN, name: value}, **PRICES, **EFFORT)


def _priced(name: str) -> Callable[[float], Any]:
    return lambda value: _core.plan(MODEL, dt_h=0.25, **PLAN, **{**PRICES, name: value}, **EFFORT)


def _followed(demand_kw: Any, ambient_c: Any, soc: Any = SOC, temperature_c: Any = TEMPERATURE) -> Any:
    shares = _core.BestShares(SHARES, SHARES, LIMIT[:, 0])
    return MODEL.track_demand(soc, temperature_c, demand_kw, ambient_c, 0.25, 2, shares)


AGEING, POINTS = _core.Ageing(CORE), np.full((N, 3), 0.5)
REQUEST = np.zeros((1, N, STEPS))
CALLS: dict[str, Callable[[Any], Any]] = {
    "plant.run request": _step,
    "plant.run ambient": lambda value: plant().run(np.zeros(N), value, 900.0, False),
    **{f"plant state {name}": _state(name) for name in STATE},
    **{f"plant set_state {name}": _set_state(name) for name in STATE},
    "plant state ageing": _state("ageing"),
    "system aged capacity": lambda value: CORE.aged(value, np.ones(N)),
    "system aged resistance": lambda value: CORE.aged(np.ones(N), value),
    "ageing loss": lambda value: AGEING.calendar_rate(value, POINTS, POINTS),
    "ageing depth": lambda value: AGEING.cyclic_rate(np.zeros(N), value, POINTS, POINTS, POINTS),
    "rainflow": _core.rainflow,
    "rollout soc": lambda value: MODEL.rollout(value, TEMPERATURE, REQUEST, AMBIENT, 0.25),
    "rollout temperature": lambda value: MODEL.rollout(SOC, value, REQUEST, AMBIENT, 0.25),
    "rollout request": lambda value: MODEL.rollout(SOC, TEMPERATURE, value, AMBIENT, 0.25),
    "rollout ambient": lambda value: MODEL.rollout(SOC, TEMPERATURE, REQUEST, value, 0.25),
    "deliverable soc": lambda value: MODEL.deliverable_kw(value, TEMPERATURE, True, 0.25),
    "deliverable temperature": lambda value: MODEL.deliverable_kw(SOC, value, False, 0.25),
    **{
        f"horizon {name}": _searched(name)
        for name in (
            "soc",
            "temperature_c",
            "demand_kw",
            "ambient_c",
            "limit_kw",
            "costs",
            "search_costs",
            "tol_abs",
            "tol_rel",
        )
    },
    **{f"plan {name}": _planned(name) for name in PLAN},
    "follow soc": lambda value: _followed(DEMAND, AMBIENT, soc=value),
    "follow temperature": lambda value: _followed(DEMAND, AMBIENT, temperature_c=value),
    "follow demand": lambda value: _followed(value, AMBIENT),
    "follow ambient": lambda value: _followed(DEMAND, value),
    "shares charge": lambda value: _core.BestShares(value, SHARES, LIMIT[:, 0]),
    "shares discharge": lambda value: _core.BestShares(SHARES, value, LIMIT[:, 0]),
    "shares limit": lambda value: _core.BestShares(SHARES, SHARES, value),
    "reactive request": lambda value: MODEL.share_reactive(value, 50.0, LIMIT[:, 0], np.zeros(N)),
    "reactive limit": lambda value: MODEL.share_reactive(np.zeros(N), 50.0, value, np.zeros(N)),
    "reactive start": lambda value: MODEL.share_reactive(np.zeros(N), 50.0, LIMIT[:, 0], value),
    "horizon evaluate": lambda value: horizon().evaluate(value),
    "horizon split": lambda value: horizon().split(value, 40),
    "horizon best_of": lambda value: horizon().best_of(horizon().split(None, 40).incumbent, value),
    **{f"states {i}": _box(i) for i in range(4)},
    "horizon step_bounds costs": lambda value: horizon().step_bounds(STATES, value, np.zeros(STEPS)),
    "horizon step_bounds budget": lambda value: horizon().step_bounds(STATES, np.ones((N, 4)), value),
    "horizon tighten request": lambda value: horizon().tighten(value, np.ones((N, 4)), 0.0),
    "horizon tighten costs": lambda value: horizon().tighten(np.zeros((N, STEPS)), value, 0.0),
}
SCALARS: dict[str, Callable[[float], Any]] = {
    "plant step": lambda value: _core.Plant(CORE, 1, value, "table", STATE),
    "plant duration": lambda value: plant().run(np.zeros(N), np.array([25.0]), value, False),
    "rollout dt": lambda value: MODEL.rollout(SOC, TEMPERATURE, REQUEST, AMBIENT, value),
    "deliverable dt": lambda value: MODEL.deliverable_kw(SOC, TEMPERATURE, True, value),
    "tighten budget": lambda value: horizon().tighten(np.zeros((N, STEPS)), np.ones((N, 4)), value),
    "horizon dt": lambda value: horizon(dt_h=value).greedy(),
    "plan dt": lambda value: _core.plan(MODEL, dt_h=value, **PLAN, **PRICES, **EFFORT),
    **{f"plan {name}": _priced(name) for name in PRICES},
}
SHAPES = [(), (0,), (1,), (N,), (STEPS,), (N * NODES,), (4,), (0, STEPS), (N, STEPS), (STEPS, N), (2, 4)]
SHAPES += [(1, N, STEPS), (0, N, STEPS), (2, N, STEPS), (2, N, 4), (1, N, 0), (N, 0), (1, 1, 1, 1)]
SHAPES += [(N,), (STEPS,), (N, STEPS), (1, N, STEPS)] * 2
VALUES = st.sampled_from(
    [
        np.nan,
        np.inf,
        -np.inf,
        -0.0,
        0.0,
        1e-320,
        1e300,
        -1e300,
        -1.0,
        0.5,
        1.0,
        1.0 + 1e-12,
        25.0,
        90.0,
        150.0,
    ]
)


@st.composite
def arrays(draw: st.DrawFn) -> Any:
    shape = draw(st.sampled_from(SHAPES))
    size = int(np.prod(shape))
    pool = draw(st.lists(VALUES, min_size=1, max_size=4))
    values: Any = np.array([pool[i % len(pool)] for i in range(size)], dtype=np.float64).reshape(shape)
    form = draw(
        st.sampled_from(["plain"] * 4 + ["strided", "fortran", "reversed", "f4", "int", "object", "list"])
    )
    with np.errstate(all="ignore"):
        if form == "strided" and shape:
            values = np.repeat(values, 2, axis=-1)[..., ::2]
        elif form == "fortran":
            values = np.asfortranarray(values)
        elif form == "reversed" and shape:
            values = values[::-1]
        elif form == "f4":
            values = values.astype(np.float32)
        elif form == "int":
            values = np.zeros(shape, dtype=np.int64)
        elif form == "object":
            values = values.astype(object)
        elif form == "list":
            values = values.tolist()
    return values


def answers_or_refuses(call: Callable[[Any], Any], value: Any) -> None:
    try:
        call(value)
    except (ValueError, TypeError) as error:
        assert str(error)


def test_the_calls_are_answered_when_nothing_is_hostile() -> None:
    """So that what follows tries the arrays, not a mistake of the test."""
    fitting: dict[str, Any] = {
        "plant.run request": np.zeros(N),
        "plant.run ambient": np.array([25.0]),
        **{
            f"plant {kind}{name}": value for kind in ("state ", "set_state ") for name, value in STATE.items()
        },
        "plant state ageing": plant().state()["ageing"],
        "ageing depth": POINTS,
        "horizon costs": COSTS,
        "horizon limit_kw": LIMIT,
        "horizon demand_kw": DEMAND,
        "horizon ambient_c": AMBIENT,
        "horizon tol_abs": np.full(2, 1e-6),
        "horizon tol_rel": np.full(2, 1e-4),
        "rollout request": REQUEST,
        "rollout ambient": AMBIENT,
        "horizon evaluate": REQUEST,
        "horizon search_costs": COSTS,
        "horizon split": REQUEST[0],
        "horizon best_of": REQUEST,
        "horizon step_bounds costs": COSTS[0],
        "horizon step_bounds budget": np.zeros(STEPS),
        "horizon tighten costs": COSTS[0],
        "horizon tighten request": REQUEST[0],
        **{f"plan {name}": value for name, value in PLAN.items()},
        "follow demand": DEMAND,
        "follow ambient": AMBIENT,
        "shares charge": SHARES,
        "shares discharge": SHARES,
    }
    for name, call in CALLS.items():
        temperature = "temperature" in name or name[-1] in "23"
        box = np.full((N, STEPS), 30.0 if temperature else 0.5)
        alone = TEMPERATURE if temperature else SOC
        boxed = name[-1].isdigit() and name[-2] == " "
        call(fitting.get(name, box if boxed else alone))


@pytest.mark.parametrize("name", CALLS)
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
@given(value=arrays())
def test_a_hostile_array_is_answered_or_refused(name: str, value: Any) -> None:
    answers_or_refuses(CALLS[name], value)


@pytest.mark.slow
@pytest.mark.parametrize("name", CALLS)
@settings(max_examples=1000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(value=arrays())
def test_a_thousand_hostile_arrays_are_answered_or_refused(name: str, value: Any) -> None:
    answers_or_refuses(CALLS[name], value)


@pytest.mark.parametrize("name", SCALARS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-320, 1e-9, 7.0, 1e300])
def test_a_hostile_number_is_answered_or_refused(name: str, value: float) -> None:
    answers_or_refuses(SCALARS[name], value)


@pytest.mark.parametrize(
    "name",
    [
        "plant.run request",
        "plant state soc",
        "rollout request",
        "horizon demand_kw",
        "deliverable temperature",
        "plan ambient_c",
    ],
)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_refused_not_computed_with(name: str, bad: float) -> None:
    shapes = {"rollout request": (1, N, STEPS), "horizon demand_kw": (STEPS,), "plan ambient_c": (STEPS,)}
    with pytest.raises(ValueError, match=r"\w"):
        CALLS[name](np.full(shapes.get(name, (N,)), bad))


@pytest.mark.parametrize("count", [0, 2**40])
def test_an_impossible_number_of_scenarios_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        _core.Plant(CORE, count, 10.0, "table", STATE)


def test_a_state_without_a_key_or_of_another_type_is_refused() -> None:
    with pytest.raises((KeyError, ValueError, TypeError)):
        plant({"soc": SOC})
    with pytest.raises((KeyError, ValueError, TypeError)):
        plant({**STATE, "inverter_on": np.zeros(N)})


@pytest.mark.parametrize("document", ["", "{", "null", "[]", '{"x": 1}', "\x00", "[" * 10_000])
def test_a_document_that_is_none_is_refused(document: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        _core.System(document)


def test_what_does_not_fit_together_is_refused() -> None:
    """Each of these calls panicked, or answered for something else."""
    small, large = horizon(), _core.ControlHorizon(
        _core.ControlModel(bess.System.reference(N + 1).core),
        *(np.full(N + 1, value) for value in (0.5, 25.0)),
        np.full(STEPS + 1, 40.0), np.full(STEPS + 1, 25.0), 0.25, np.full((N + 1, STEPS + 1), 92.0),
        *[np.ones((2, N + 1, 4))] * 2, *[np.full(2, 1e-6)] * 2,
    )  # fmt: skip
    nodes = [each.root(each.reachable()) for each in (small, large)]
    narrow = [each.tighten_node(node, 1e9) for each, node in zip((small, large), nodes, strict=True)]
    assert narrow[0] is not None
    calls: dict[str, Callable[[], Any]] = {
        "demand: needs": lambda: _core.ControlHorizon(
            MODEL, SOC, TEMPERATURE, np.zeros(0), np.zeros(0), 0.25, np.zeros((N, 0)),
            COSTS, COSTS, np.full(2, 1e-6), np.full(2, 1e-4),
        ),
        "node: needs": lambda: small.tighten_node(nodes[1], 1e9),
        "node": lambda: large.step_bounds_of(narrow[0], np.ones((N + 1, 4)), np.zeros(STEPS + 1)),
        "shed_budget_kw": lambda: small.tighten_node(nodes[0], np.nan),
        "ceilings and objective": lambda: small.priced_bound(np.zeros(0), np.nan, 8),
        "parts": lambda: MODEL.track_demand(
            SOC, TEMPERATURE, DEMAND, AMBIENT, 0.25, 0, _core.BestShares(SHARES, SHARES, LIMIT[:, 0])
        ),
        "groups": lambda: _core.plan(
            MODEL, dt_h=0.25, **PLAN, **PRICES, **EFFORT, groups=np.full(N, -1)
        ),
    }  # fmt: skip
    for says, call in calls.items():
        with pytest.raises(ValueError, match=says):
            call()
