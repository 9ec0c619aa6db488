"""No bound leaves a schedule out: random schedules lie in every box, cut and row that a bound is made of.

The problems reach to the ends of what a call takes: full, empty and hot strings, demands and limits of watts,
boxes that are points and boxes that are wide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from control_cases import DT_H, Case, box, differing, points, sheds
from control_oracle import ocv_v
from numpy.typing import NDArray

import bess
from bess import _core
from bess.control.objectives import Costs
from bess.control.problem import SplitProblem
from bess.control.split.relaxation.branching import MIN_KW
from bess.control.split.relaxation.data import THETA_UNIT_K, THETA_ZERO_C, PlantConstants
from bess.control.split.relaxation.group import RelaxedGroup

SIZES = [(1, 2), (2, 3), (3, 2)]
"""Strings and steps: few sizes, because each is compiled once."""
SCHEDULES = 24
NODES = 3
"""Parts of a problem, cut at random."""
ROUNDING = 1e-9
BOX = ("soc_low", "soc_high", "temperature_low_c", "temperature_high_c")


def wild(seed: int) -> tuple[SplitProblem, Case]:
    """A problem from anywhere in the domain."""
    rng = np.random.default_rng(seed)
    n_strings, n_steps = SIZES[seed % len(SIZES)]
    system = bess.System.reference(n_strings) if rng.random() < 0.5 else differing(n_strings, rng)
    low, high = (
        np.array([getattr(s.battery, name) for s in system.strings]) for name in ("soc_min", "soc_max")
    )
    near = 10.0 ** rng.uniform(-6.0, -1.0, n_strings)
    place = np.choose(
        rng.integers(0, 5, n_strings),
        [np.zeros(n_strings), near, rng.random(n_strings), 1.0 - near, np.ones(n_strings)],
    )
    state = bess.State(low + place * (high - low), rng.uniform(-10.0, 62.0, n_strings))
    nominal = system.nominal_kw[:, None]
    share = np.choose(
        rng.integers(0, 3, (n_strings, n_steps)),
        [1.0, rng.random((n_strings, n_steps)), 10.0 ** rng.uniform(-5.0, 0.0, (n_strings, n_steps))],
    )
    limit = nominal * share
    load = np.where(rng.random(n_steps) < 0.5, rng.random(n_steps), 10.0 ** rng.uniform(-5.0, 0.0, n_steps))
    demand = rng.choice([-1.0, 1.0], n_steps) * load * limit.sum(axis=0)
    problem = SplitProblem.check(
        system, n_steps, DT_H, state, demand, rng.uniform(-10.0, 45.0, n_steps), limit
    )
    cost = np.zeros((2, n_strings, 4))
    cost[0, :, 0] = cost[1, :, 1:] = 1e-2
    horizon = problem.control(Costs(cost, cost), np.full(2, 1e-7), np.full(2, 1e-6))
    return problem, Case(system, state, problem.demand_kw, problem.limit_kw, cost, horizon)


@dataclass(frozen=True)
class Schedules:
    """Roll-outs of some schedules; states are ``(n, n_strings, n_steps + 1)``."""

    problem: SplitProblem
    case: Case
    requests: NDArray[np.float64]
    roll: bess.Rollout
    soc: NDArray[np.float64]
    temperature_c: NDArray[np.float64]

    @classmethod
    def random(cls, problem: SplitProblem, case: Case, rng: np.random.Generator) -> Schedules:
        requests = case.random_requests(rng, SCHEDULES)
        roll = bess.rollout(problem.system, problem.state, requests, DT_H, problem.ambient_c)
        along = []
        for start, later in (
            (problem.state.soc, roll.soc),
            (problem.state.temperature_c, roll.temperature_c),
        ):
            first = np.broadcast_to(start[None, :, None], (*later.shape[:2], 1))
            along.append(np.concatenate([first, later], axis=2))
        return cls(problem, case, requests, roll, *along)

    @property
    def sheds(self) -> NDArray[np.bool_]:
        return sheds(self.problem.system, self.roll)

    def inside(self, boxes: _core.StateBoxes) -> NDArray[np.bool_]:
        """Whether all states of a schedule are in the boxes, ``(n,)``."""
        held = (self.soc >= boxes.soc_low) & (self.soc <= boxes.soc_high)
        held &= self.temperature_c >= boxes.temperature_low_c
        held &= self.temperature_c <= boxes.temperature_high_c
        return np.asarray(held.all(axis=(1, 2)))

    def random_boxes(self, rng: np.random.Generator) -> _core.StateBoxes:
        """Boxes around some of the schedules: touching them, or wider; the measured state stays a point."""
        some = rng.choice(SCHEDULES, rng.integers(1, SCHEDULES), replace=False)
        shape = self.soc.shape[1:]
        window = [
            np.array([getattr(s.battery, name) for s in self.problem.system.strings])[:, None]
            for name in ("soc_min", "soc_max")
        ]
        wider = rng.choice([0.0, 0.01, 0.2]) * rng.random((4, *shape)) * (np.arange(shape[1]) > 0)
        soc_low = np.maximum(self.soc[some].min(axis=0) - wider[0], window[0])
        soc_high = np.minimum(self.soc[some].max(axis=0) + wider[1], window[1])
        cool = self.temperature_c[some].min(axis=0) - 50.0 * wider[2]
        return box(soc_low, soc_high, cool, self.temperature_c[some].max(axis=0) + 50.0 * wider[3])


def points_of_relaxation(schedules: Schedules, constants: PlantConstants) -> dict[str, NDArray[np.float64]]:
    """The variables of the relaxation along each schedule, per unit, but those that one row each settles."""
    roll, nominal = schedules.roll, constants.nominal_kw[:, None]
    sign = np.where(schedules.problem.demand_kw >= 0.0, 1.0, -1.0)
    scale_kw, volt = np.empty(roll.soc.shape), np.empty(roll.soc.shape)
    model = _core.ControlModel(schedules.problem.system.core)
    for n, (soc, temperature_c) in enumerate(zip(schedules.soc, schedules.temperature_c, strict=True)):
        at = (np.ascontiguousarray(soc[:, :-1]), np.ascontiguousarray(temperature_c[:, :-1]))
        ways = zip(model.coefficients(*at, True), model.coefficients(*at, False), strict=True)
        volt[n], ohm = (np.where(sign > 0.0, *each) for each in ways)
        scale_kw[n] = volt[n] ** 2 / ohm / 1e3
    on = (roll.delivered_kw != 0.0).astype(float)
    battery = constants.battery_kw[:, None]
    switch = np.array([s.battery.low_soc_switch for s in schedules.problem.system.strings])[:, None]
    return {
        "on": on,
        "full": schedules.sheds.astype(float),
        "low": (schedules.soc[:, :, :-1] < switch).astype(float),
        "p": np.abs(roll.delivered_kw) / nominal,
        "a": roll.availability_loss_kw / nominal,
        "d": roll.derating_loss_kw / nominal,
        "w": roll.inverter_loss_kw / constants.inverter_kw[:, None],
        "h": roll.battery_loss_kw / battery,
        "P": sign * roll.current_a * volt / 1e3 / nominal,
        "z": on * scale_kw * battery / nominal**2,
        "soc": schedules.soc,
        "theta": (schedules.temperature_c - THETA_ZERO_C) / THETA_UNIT_K,
        "e": stored(schedules, constants),
    }


def stored(schedules: Schedules, constants: PlantConstants) -> NDArray[np.float64]:
    """Integral over SOC, from the start on, of the open-circuit voltage of the first direction, per unit."""
    problem = schedules.problem
    first = next((power for power in problem.demand_kw if power != 0.0), 1.0)
    out = np.empty(schedules.soc.shape)
    for m, string in enumerate(problem.system.strings):
        knots = np.array(string.battery.ocv_v.soc)
        voltage = np.array([ocv_v(string, first < 0.0, soc, problem.state.temperature_c[m]) for soc in knots])
        steps = 0.5 * (voltage[1:] + voltage[:-1]) * np.diff(knots)
        integral = np.concatenate([[0.0], np.cumsum(steps)])
        soc = schedules.soc[:, m]
        i = np.clip(np.searchsorted(knots, soc, side="right") - 1, 0, knots.size - 2)
        total = integral[i] + 0.5 * (np.interp(soc, knots, voltage) + voltage[i]) * (soc - knots[i])
        capacity_ah = problem.system.capacity_ah[m] * problem.state.soh_capacity[m]
        out[:, m] = (total - total[:, :1]) / (constants.nominal_kw[m] * 1e3 * DT_H / capacity_ah)
    return out


def random_part(
    schedules: Schedules, boxes: _core.StateBoxes, known: int, rng: np.random.Generator
) -> _core.Node:
    """A part of all schedules with states in the boxes, cut at random around one of them."""
    magnitude = np.abs(schedules.requests[known])
    node = schedules.case.horizon.root(boxes)
    for _ in range(rng.integers(0, 8)):
        m, t = (int(rng.integers(n)) for n in magnitude.shape)
        kind = rng.random()
        if kind < 0.2:
            tightened = schedules.case.horizon.tighten_node(node, np.inf)
            assert tightened is not None
            node = tightened.branch_on_full(m, t)[int(schedules.sheds[known, m, t])]
        elif kind < 0.6:
            own, low, high = magnitude[m, t], node.request_low_kw[m, t], node.request_high_kw[m, t]
            at = float(rng.choice([own, low + rng.random() * (high - low), MIN_KW]))
            node = node.branch_on_request(m, t, at)[0 if own <= at else 1]
        else:
            own, low, high = schedules.soc[known, m, t], node.boxes.soc_low[m, t], node.boxes.soc_high[m, t]
            at = float(rng.choice([own, low + rng.random() * (high - low)]))
            node = node.branch_on_soc(m, t, at)[0 if own <= at else 1]
    return node


def check_node(schedules: Schedules, boxes: _core.StateBoxes, rng: np.random.Generator) -> None:
    """Every schedule in a part of the problem is still in it once it is tightened, and is a point of its
    relaxation, at what it costs."""
    horizon = schedules.case.horizon
    known = int(rng.choice(np.flatnonzero(schedules.inside(boxes))))
    node = random_part(schedules, boxes, known, rng)
    shed_kw = schedules.roll.availability_loss_kw.sum(axis=(1, 2))
    budget_kw = float(rng.choice([np.inf, shed_kw[known]]))
    tightened = horizon.tighten_node(node, budget_kw)
    assert tightened is not None

    def requested(of: _core.Node, slack: float = 0.0) -> NDArray[np.bool_]:
        magnitude, slack_kw = np.abs(schedules.requests), slack * schedules.case.system.nominal_kw[:, None]
        held = (magnitude >= of.request_low_kw - slack_kw) & (magnitude <= of.request_high_kw + slack_kw)
        return np.asarray(held.all(axis=(1, 2)))

    sheds_where_it_may = ~np.any(schedules.sheds & ~node.may_shed, axis=(1, 2))
    inside = schedules.inside(node.boxes) & requested(node) & sheds_where_it_may & (shed_kw <= budget_kw)
    inside[known] = True
    assert schedules.inside(tightened.boxes)[inside].all()
    assert requested(tightened, ROUNDING)[inside].all()
    check_rows(schedules, inside, tightened, budget_kw)


def check_rows(schedules: Schedules, inside: NDArray[np.bool_], node: _core.Node, budget_kw: float) -> None:
    """Every schedule inside a tightened node is a point of its program."""
    problem, case = schedules.problem, schedules.case
    objectives = case.horizon.evaluate(schedules.requests)[inside]
    near = points(schedules.soc[inside][0], schedules.temperature_c[inside][0])
    constants = PlantConstants.of(problem.system, DT_H)
    limits = [objectives[:, 0].max()], np.inf
    relaxed = RelaxedGroup(
        problem, case.horizon, constants, case.costs, *limits, near, lambda request_pu, on: None
    )
    _, (data, fixed, settled) = relaxed.instance(node, budget_kw)
    program = relaxed.program
    shape = data.b.size, program.n_columns
    matrix = sp.csr_array((data.values, (data.pattern.rows, data.pattern.columns)), shape=shape)
    zero, cones = data.pattern.n_zero, data.pattern.n_zero + data.pattern.n_nonneg
    variables = points_of_relaxation(schedules, constants.at(problem.state))
    for n, objective in zip(np.flatnonzero(inside), objectives[:, 1], strict=True):
        x = np.zeros(program.n_columns)
        for name, values in variables.items():
            x[program.slices[name]] = values[n].ravel(order="F")
        np.testing.assert_allclose(x[fixed], settled[fixed], atol=ROUNDING)
        slack = data.b - matrix @ x
        allowed = ROUNDING * (1.0 + np.abs(data.b) + np.abs(matrix) @ np.abs(x))
        assert np.all(np.abs(slack[:zero]) <= allowed[:zero])
        assert np.all(slack[zero:cones] >= -allowed[zero:cones])
        cone = slack[cones:].reshape(-1, 3)
        assert np.all(cone[:, 0] + allowed[cones::3] >= np.hypot(cone[:, 1], cone[:, 2]))
        assert (data.q @ x + data.offset) * relaxed.unit == pytest.approx(objective, rel=1e-9, abs=1e-12)


def check(seed: int) -> None:
    """Boxes, cuts and rows of one problem against random schedules of it."""
    rng = np.random.default_rng(seed)
    problem, case = wild(seed)
    schedules = Schedules.random(problem, case, rng)
    if not np.allclose(
        np.abs(schedules.requests).sum(axis=1), np.abs(problem.demand_kw), rtol=ROUNDING, atol=0.0
    ):
        return  # A demand of a watt or two that no set-points of at least a watt can meet within the limits.
    horizon = case.horizon
    reachable = horizon.reachable()
    assert schedules.inside(reachable).all()

    boxes = schedules.random_boxes(rng)
    cost = case.cost_by_group(schedules.roll, slice(1, 4))[:, 1]
    shed_kw = schedules.roll.availability_loss_kw.sum(axis=1)
    for of, budget_kw in ((boxes, np.inf), (boxes, 1.0), (reachable, np.inf)):
        inside = schedules.inside(of)
        at_start = box(*(getattr(of, name)[:, :-1] for name in BOX))
        budgets = np.full(problem.demand_kw.size, budget_kw)
        cuts = horizon.step_bounds(at_start, case.costs[1], budgets)
        assert np.all(cost[inside] + cuts.shed_slope * shed_kw[inside] >= cuts.phi * (1.0 - ROUNDING))
    for of in (boxes, reachable):
        for _ in range(NODES):
            check_node(schedules, of, rng)

    known = int(rng.integers(SCHEDULES))
    total, shed = cost.sum(axis=1), shed_kw.sum(axis=1)
    bound, boxes, may_shed = horizon.tighten(schedules.requests[known], case.costs[1], shed[known])
    allowed = shed <= shed[known]
    assert np.all(total[allowed] >= bound)
    no_worse = allowed & (total <= total[known])
    assert schedules.inside(boxes)[no_worse].all()
    assert not np.any(schedules.sheds[no_worse] & ~may_shed)


@pytest.mark.parametrize("seed", [*range(150), 1133])
def test_every_schedule_satisfies_every_box_cut_and_row_of_a_bound(seed):
    check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 21_000, 1000))
def test_every_schedule_satisfies_the_bounds_of_twenty_thousand_problems(first):
    for seed in range(first, first + 1000):
        check(seed)
