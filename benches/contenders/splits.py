"""One solver on seeded regular states: time and objective of each power split.

    python splits.py bess|gurobi|bonmin|scip STATES [STEPS]

States and weights are the same for every solver: SOC 0.35 to 0.65, 25 to 40 degC, 20 to 150 kW, so that
nothing has to be shed, which the rivals' programs cannot. The objective is that of the control model under
the requests, also for the rivals; what a rival's own variables say is given beside it.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np

import bess

sys.path.insert(0, str(Path(__file__).parents[1]))

from contenders.equations import Answer, nominal_losses_kw, split

WEIGHTS = {"ones": (1.0, 1.0, 1.0), "S1": (1.0, 1.0, 0.0), "S2": (1.0, 0.5, 0.5), "S3": (1.0, 0.0, 1.0)}
REPEATS = 5
CRUMB_KW = 1e-2

Weights = tuple[float, float, float]
Solve = Callable[[bess.State, np.ndarray], Answer]


def regular(seed: int, strings: int, steps: int) -> tuple[bess.State, np.ndarray]:
    """State and demand [kW]; one direction, so that the steps depend on each other."""
    rng = np.random.default_rng(seed)
    state = bess.State(rng.uniform(0.35, 0.65, strings), rng.uniform(25.0, 40.0, strings))
    return state, strings / 2.0 * rng.uniform(20.0, 150.0, steps) * rng.choice([-1.0, 1.0])


def ours(system: bess.System, steps: int, weights: Weights) -> Solve:
    """Compiled once, then solved from a cold start: median time of some repetitions."""
    goals = bess.Objectives(derating=weights[0], inverter=weights[1], battery=weights[2])
    splitter = bess.PowerSplit(system, steps, goals)

    def solve(state: bess.State, demand_kw: np.ndarray) -> Answer:
        times = []
        for _ in range(1 + REPEATS):
            splitter.warm_start = None
            started = time.perf_counter()
            found = splitter(state, demand_kw)
            times.append(time.perf_counter() - started)
        finished = max(group.search_gap for group in found.groups) <= splitter.settings.gap
        return Answer(found.request_kw, found.objective, float(np.median(times[1:])), finished)

    return solve


def rival(name: str, system: bess.System, weights: Weights) -> Solve:
    """Another solver on the same equations."""
    module = import_module(f"contenders.{name}_split")

    def solve(state: bess.State, demand_kw: np.ndarray) -> Answer:
        found = split(module.Program(), system, state, demand_kw, weights)
        return replace(found, request_kw=without_crumbs(found.request_kw))

    return solve


def without_crumbs(request_kw: np.ndarray) -> np.ndarray:
    """Give requests of the size of a solver's tolerance to the other string: they would start an inverter."""
    crumbs = np.where(np.abs(request_kw) < CRUMB_KW, request_kw, 0.0)
    return request_kw - crumbs + crumbs[::-1]


def objective(
    system: bess.System, state: bess.State, request_kw: np.ndarray, weights: Weights
) -> tuple[float, float]:
    """Second group and availability loss [kW] of requests by the control model, whoever made them."""
    losses = bess.rollout(system, state, request_kw)
    total = 0.0
    for m, string in enumerate(system.strings):
        kinds = (losses.derating_loss_kw, losses.inverter_loss_kw, losses.battery_loss_kw)
        shares = [kind[m].sum() / worst for kind, worst in zip(kinds, nominal_losses_kw(string), strict=True)]
        total += float(np.dot(weights, shares))
    return total / request_kw.size, float(losses.availability_loss_kw.sum())


def main(solver: str, states: int, steps: int = 4) -> None:
    """Solve every state with every weighting and print a line for each."""
    system = bess.System.reference(n_strings=2)
    for label, weights in WEIGHTS.items():
        solve = ours(system, steps, weights) if solver == "bess" else rival(solver, system, weights)
        for seed in range(states):
            entry: dict[str, object] = {"weights": label, "seed": seed}
            try:
                state, demand_kw = regular(seed, 2, steps)
                found = solve(state, demand_kw)
                value, shed_kw = objective(system, state, found.request_kw, weights)
                missed_kw = float(np.abs(found.request_kw.sum(axis=0) - demand_kw).max())
                entry |= {"seconds": found.seconds, "finished": found.finished}
                entry |= {"objective": value, "own_objective": found.objective}
                entry |= {"availability_loss_kw": shed_kw, "demand_missed_kw": missed_kw}
            except RuntimeError as error:  # no split found: a result, too
                entry["missing"] = str(error)
            print("RESULT", json.dumps(entry), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
