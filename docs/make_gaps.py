"""Write the tables of ``gaps.md`` and sizes of ``algorithm.md`` (12 CPU min): ``python docs/make_gaps.py``.

Seeded fresh problems, 2 to 4 strings that may differ over 3 to 5 steps, in every kind of state and order of
priorities. Each is solved from a cold start and by a far longer search, and the two are compared group by
group. ``python docs/make_gaps.py 40`` prints the tables of the first forty and writes nothing.
"""

import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, permutations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tables import markdown_table

import bess
from bess import _core
from bess.control.objectives import Costs
from bess.control.problem import SplitProblem
from bess.control.split.result import SplitStatus

DOCS = Path(__file__).parent
STORED = DOCS / "_cases" / "gaps.json"
TABLE = DOCS / "_cases" / "gaps.md"
TABLE_OF_SIZES = DOCS / "_cases" / "gap-sizes.md"

N_PROBLEMS = 400
N_STRINGS, N_STEPS = (2, 3, 4), (3, 4, 5)
STATES = {
    "half full": ((0.3, 0.7), (20.0, 40.0)),
    "full": ((0.93, 1.0), (20.0, 40.0)),
    "empty": ((0.0, 0.09), (20.0, 40.0)),
    "hot": ((0.3, 0.7), (45.5, 54.0)),
}
"""Ranges of SOC and temperature [degC]; in a mixed problem every string has one of them."""
KINDS = (*STATES, "mixed", "mixed")
MISSED = 1e-3
SHARE_OF_TOLERANCE = 1e-2
"""A schedule this little above an answer in a group, in tolerances, is no worse than it there."""

SIZES, PROBLEMS_OF_SIZE, STEPS_OF_SIZE = (8, 32, 64, 256, 1000), 6, 8

ORDERS = 6
"""Cold searches of the strings in as many other orders, which draw other random numbers."""
ROLLOUTS = 20_000
"""Effort of their descents, ten times that of a call."""
CLIMBS, GENERATIONS = 48, 400
"""Hill climbs from random schedules, and changes that each of them tries."""
POLISHED = 4
"""The best of them, which a descent then ends."""

ROUNDING = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fresh:
    """One problem."""

    kind: str
    system: bess.System
    state: bess.State
    objectives: bess.Objectives
    demand_kw: Array

    @classmethod
    def of(cls, seed: int) -> "Fresh":
        """The problem of a seed."""
        rng = np.random.default_rng((11, seed))
        n_strings, n_steps = int(rng.choice(N_STRINGS)), int(rng.choice(N_STEPS))
        system = _system(n_strings, rng, differ=rng.random() < 0.5)
        kind = str(rng.choice(KINDS))
        kinds = rng.choice(list(STATES), n_strings) if kind == "mixed" else [kind] * n_strings
        soc, warm = np.array([[rng.uniform(*bounds) for bounds in STATES[str(k)]] for k in kinds]).T
        sign = rng.choice([-1.0, 1.0]) * np.array(
            [np.ones(n_steps), (-1.0) ** np.arange(n_steps), rng.choice([-1.0, 1.0], n_steps)]
        )
        demand = rng.choice(sign) * rng.uniform(0.05, 1.0, n_steps) * system.nominal_kw.sum()
        return cls(kind, system, bess.State(soc, warm), _objectives(rng), demand)

    @cached_property
    def splitter(self) -> bess.PowerSplit:
        """A split that was never called."""
        return bess.PowerSplit(self.system, self.demand_kw.size, self.objectives)

    def control(self, order: Sequence[int]) -> _core.ControlHorizon:
        """The control model with its strings in some order, and the costs that a search minimises."""
        document = self.system.document
        system = bess.System(document | {"string": [document["string"][m] for m in order]}, name="fresh")
        state = bess.State(self.state.soc[list(order)], self.state.temperature_c[list(order)])
        problem = SplitProblem.check(
            system, self.demand_kw.size, self.splitter.dt_h, state, self.demand_kw, None, None
        )
        searched = self.splitter._costs.searched
        return problem.control(Costs(searched, searched), *self.objectives.tolerances)


def _system(n_strings: int, rng: np.random.Generator, *, differ: bool) -> bess.System:
    """Strings of the reference system, like or differing in size, resistance and inverter."""
    document = bess.System.reference(n_strings).document
    document["string"] = [
        {
            "battery": {"cells_parallel": int(rng.integers(3, 6)), "r_scale": float(rng.uniform(0.3, 1.6))},
            "inverter": {"nominal_kw": float(rng.uniform(60.0, 110.0))},
        }
        if differ
        else {}
        for _ in range(n_strings)
    ]
    return bess.System(document, name="fresh")


def _objectives(rng: np.random.Generator) -> bess.Objectives:
    """Priorities and weights of every kind."""
    weights = {name: float(rng.choice([0.0, 0.5, 1.0])) for name in ("derating", "inverter")}
    return [
        bess.Objectives(),
        bess.Objectives(**weights),
        bess.Objectives(derating=bess.Objective(priority=int(rng.choice([0, 3])))),
        bess.Objectives(availability=bess.Objective(weight=10.0, priority=1)),
        bess.Objectives.energy(),
    ][rng.integers(5)]


def long_search(problem: Fresh, seed: int) -> Array:
    """Objectives ``(n, n_groups)`` of the best schedules of a search far longer than that of a call."""
    rng = np.random.default_rng((12, seed))
    orders = list(islice(permutations(range(problem.system.n_strings)), ORDERS))
    found = [problem.control(order).split(None, ROLLOUTS).incumbent.objectives for order in orders]
    control = problem.control(orders[0])
    starts_kw = _climbed(problem, control, rng)[:POLISHED]
    found += [control.split(start_kw, ROLLOUTS).incumbent.objectives for start_kw in starts_kw]
    return np.array(found)


def _climbed(problem: Fresh, control: _core.ControlHorizon, rng: np.random.Generator) -> Array:
    """Schedules ``(CLIMBS, n_strings, n_steps)`` [kW, signed] of hill climbs from random ones, best first.

    Each shifts power between two strings in a step, or lets them change places from a step on."""
    limit = np.repeat(problem.system.nominal_kw[:, None], problem.demand_kw.size, axis=1)
    demand, sign = np.abs(problem.demand_kw), np.sign(problem.demand_kw)
    abs_tol, rel_tol = problem.objectives.tolerances
    share = rng.random((CLIMBS, *limit.shape)) ** rng.choice([0.0, 1.0, 9.0], (CLIMBS, 1, 1))
    here = _fitted(share * limit, demand, limit)
    costs = control.evaluate(here * sign)
    every = np.arange(CLIMBS)
    for generation in range(GENERATIONS):
        first, second = rng.permuted(np.tile(np.arange(len(limit)), (CLIMBS, 1)), axis=1)[:, :2].T
        step = rng.integers(demand.size, size=CLIMBS)
        trial = here.copy()
        if generation % 4:
            most = np.minimum(trial[every, first, step], limit[second, step] - trial[every, second, step])
            moved = most * np.minimum(1.0, 2.0 * 10.0 ** rng.uniform(-5.0, 0.0, CLIMBS))
            trial[every, first, step] -= moved
            trial[every, second, step] += moved
        else:
            inside = np.arange(demand.size) >= step[:, None]
            a, b = trial[every, first], trial[every, second]
            trial[every, first], trial[every, second] = np.where(inside, b, a), np.where(inside, a, b)
            trial = _fitted(trial, demand, limit)
        tried = control.evaluate(trial * sign)
        better = np.zeros(CLIMBS, dtype=bool)
        tied = np.ones(CLIMBS, dtype=bool)
        for group, lowest in enumerate(costs.min(axis=0)):
            ceiling = lowest + max(abs_tol[group], rel_tol[group] * lowest)
            floor = ceiling if group + 1 < costs.shape[1] else -np.inf
            new, old = np.maximum(tried[:, group], floor), np.maximum(costs[:, group], floor)
            better |= tied & (new < old)
            tied &= new == old
        here[better], costs[better] = trial[better], tried[better]
    rounded = np.round(costs / np.maximum(abs_tol, 1e-9))
    return np.asarray((here * sign)[np.lexsort(rounded.T[::-1])])


def _fitted(wanted: Array, demand: Array, limit: Array) -> Array:
    """Schedules that meet the demand in proportion to what is wanted, then to what room is."""
    out = np.minimum(wanted * (demand / np.maximum(wanted.sum(axis=1), 1e-9))[:, None], limit)
    room = limit - out
    missing = np.maximum(demand - out.sum(axis=1), 0.0)
    return np.asarray(out + room * np.minimum(missing / np.maximum(room.sum(axis=1), 1e-9), 1.0)[:, None])


def compare(problem: Fresh, found: Array) -> dict[str, float | str]:
    """Compare the cold answer with the best found: in each group, of what is no worse in those before."""
    split = problem.splitter(problem.state, problem.demand_kw)
    answer = problem.control(range(problem.system.n_strings)).evaluate(split.request_kw[None])[0]
    abs_tol, rel_tol = problem.objectives.tolerances
    missed, above, best = 0.0, 0.0, np.vstack([found, answer])
    for group, (value, bound) in enumerate(zip(answer, (g.bound for g in split.groups), strict=True)):
        tolerance = max(abs_tol[group], rel_tol[group] * value)
        least = best[:, group].min()
        # What the tolerance lets an answer lose to groups after this one is not missed.
        granted = 0.0 if group + 1 == len(answer) else 2.0 * tolerance
        if value > abs_tol[group]:
            missed = max(missed, (value - least - granted) / value)
        above = max(above, bound - least * (1.0 + ROUNDING))
        best = best[best[:, group] <= value + SHARE_OF_TOLERANCE * tolerance]
    return {
        "kind": problem.kind,
        "missed": float(missed),
        "bound above": float(above),
        "gap": float(split.gap),
        "optimal": float(split.status is SplitStatus.OPTIMAL),
    }


def measure(n: int) -> list[dict[str, float | str]]:
    """Compare so many problems."""
    problems = [Fresh.of(seed) for seed in range(n)]
    return [compare(problem, long_search(problem, seed)) for seed, problem in enumerate(problems)]


def table(rows: Sequence[Mapping[str, float | str]]) -> str:
    """One line for each kind of state, and one for all."""
    lines = [
        ["state", "problems", "suboptimal by more than 0.1 %", "worst excess [%]",
         "bounds above best known", "median rigorous gap [%]", "OPTIMAL"]
    ]  # fmt: skip
    for kind in (*dict.fromkeys(row["kind"] for row in rows), "all"):
        of_kind = [row for row in rows if kind in ("all", row["kind"])]
        missed, gap, above, optimal = (
            np.array([row[name] for row in of_kind], dtype=float)
            for name in ("missed", "gap", "bound above", "optimal")
        )
        lines.append(
            [str(kind), str(len(of_kind)), str(np.count_nonzero(missed > MISSED)),
             f"{100 * missed.max():.2f}", str(np.count_nonzero(above > 0.0)), f"{100 * np.median(gap):.2f}",
             f"{optimal.sum():.0f}"]
        )  # fmt: skip
    return markdown_table(lines)


def sizes() -> str:
    """Time and gaps of like strings without undelivered energy: median, and worst."""
    rows = [["strings", "CPU s", "search gap", "rigorous gap"]]
    for n in SIZES:
        rng, system = np.random.default_rng((13, n)), bess.System.reference(n)
        splitter = bess.PowerSplit(system, STEPS_OF_SIZE)
        measured: list[tuple[float, float, float]] = []
        while len(measured) < PROBLEMS_OF_SIZE:
            soc = rng.uniform(*[(0.35, 0.65), (0.08, 0.92)][rng.integers(2)], n)
            state = bess.State(soc, rng.uniform(20.0, rng.choice([35.0, 45.0]), n))
            load = rng.choice([-1.0, 1.0]) * rng.uniform(0.15, 0.95, STEPS_OF_SIZE)
            splitter.warm_start, began_s = None, time.process_time()
            split = splitter(state, load * system.nominal_kw.sum())
            if split.availability_loss_kw <= 1e-6 * system.nominal_kw.sum():
                cpu_s = time.process_time() - began_s
                measured.append((cpu_s, 100.0 * split.search_gap, 100.0 * split.gap))
        cells = zip(*measured, (" s", " %", " %"), strict=True)
        rows.append(
            [f"{n:,}", *(f"{np.median(x):.2g}{unit}, at most {max(x):.2g}{unit}" for *x, unit in cells)]
        )
    return markdown_table(rows)


def stored() -> list[dict[str, float | str]]:
    """What was measured for the page."""
    return list(json.loads(STORED.read_text(encoding="utf-8")))


def main() -> None:
    """Measure, and write or print the table."""
    if len(sys.argv) > 1:
        print(table(measure(int(sys.argv[1]))))
        return
    rows = measure(N_PROBLEMS)
    STORED.write_text(json.dumps(rows, indent=0) + "\n", encoding="utf-8")
    TABLE.write_text(table(rows), encoding="utf-8")
    TABLE_OF_SIZES.write_text(sizes(), encoding="utf-8")


if __name__ == "__main__":
    main()
