"""Training of a controller: a search for its weights on closed loops of a study and variations of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bess.arrays import Array
from bess.control.explicit import N_WEIGHTS, ExplicitController
from bess.control.policies import Decision, PolicyInput
from bess.control.policies.rule import RulePolicy
from bess.edge.distil.translate import places
from bess.optional_dependencies import extra
from bess.plant import PlantEnsemble
from bess.simulation.inputs import prepare
from bess.simulation.runner import run
from bess.study import Study
from bess.system import State, System


@dataclass(frozen=True)
class Variation:
    """A variation of a study, with its weight in the objective.

    ``scale`` is a factor on the demand; ``spread`` and ``spread_k`` are the maximum changes of initial SOC,
    as a share of the window, and temperature [K].
    """

    weight: float
    scale: float = 1.0
    spread: float = 0.0
    spread_k: float = 0.0


VARIATIONS: Final = (
    Variation(0.6),
    Variation(0.2, scale=0.85, spread=0.2, spread_k=5.0),
    Variation(0.2, scale=1.1, spread=0.1, spread_k=3.0),
)
"""The study itself has the largest weight; the others prevent overfitting to one demand."""


@dataclass(frozen=True)
class TrainingCase:
    """Inputs of a controller in each step of a study."""

    system: System
    dt_h: float
    """Control step [h]."""
    ahead_kw: Array
    """``(n_steps, steps_ahead)``: demand of each step and its forecast, at most the power of the inverters in
    service."""
    limit_kw: Array
    """``(n_steps, n_strings)``: power of each inverter in service."""
    ambient_c: Array
    """``(n_steps,)``: ambient temperature [degC]."""

    @classmethod
    def of(cls, study: Study) -> TrainingCase:
        """Run the study once with a rule and record its inputs.

        If the demand depends on the state of the plant, as in arbitrage, the demand under the rule is
        recorded.
        """
        inputs = prepare(study)
        rule = RulePolicy(inputs.system, inputs.grid.dt_h, "soc")
        told: list[PolicyInput] = []

        def listen(inputs: PolicyInput) -> Decision:
            told.append(inputs)
            return rule(inputs)

        run(study, policy=listen, progress=False)
        return cls(
            inputs.system,
            inputs.grid.dt_h,
            np.array([each.demand_kw for each in told]),
            np.array([each.limit_kw for each in told]),
            inputs.ambient_c,
        )


class TrainingSet:
    """Closed loops of a training case and its variations, for many controllers at once.

    ``controller`` supplies the tables, but not the weights.
    """

    def __init__(
        self,
        case: TrainingCase,
        controller: ExplicitController,
        variations: tuple[Variation, ...] = VARIATIONS,
    ) -> None:
        self._case = case
        self._law = controller.core
        self._shortfall = controller.tables.shortfall
        self._shares = np.array([each.weight for each in variations])
        total_kw = case.limit_kw.sum(axis=1)[:, None]
        scaled = [np.clip(each.scale * case.ahead_kw, -total_kw, total_kw) for each in variations]
        self._demand_kw = np.stack([ahead[:, 0] for ahead in scaled], axis=1)
        self._features = np.stack(
            [self._law.demand_features(np.ascontiguousarray(ahead)) for ahead in scaled], axis=1
        )
        random = np.random.default_rng(0)
        self._starts = [_start(case.system, each, random) for each in variations]

    def costs(self, weights: Array) -> Array:
        """Cost of each controller [kWh], for weights of shape ``(n_controllers, n_weights)``.

        It is ``shortfall`` times undelivered energy, plus losses: the weighted mean over the variations.
        """
        case, n_variations = self._case, self._shares.size
        n_controllers = len(weights)
        fleet = PlantEnsemble(case.system, self._starts * n_controllers)
        flows = self._law.run(
            fleet.core,
            np.repeat(weights, n_variations, axis=0),
            np.tile(self._demand_kw, (1, n_controllers)),
            np.tile(self._features, (1, n_controllers, 1)),
            case.limit_kw,
            np.repeat(case.ambient_c[:, None], n_controllers * n_variations, axis=1),
            case.dt_h * 3600.0,
        )
        missing = flows["availability_loss_kw"] + flows["derating_loss_kw"]
        lost = flows["inverter_loss_kw"] + flows["battery_loss_kw"]
        by_step = (self._shortfall * missing + lost).reshape(
            len(case.ambient_c), n_controllers, n_variations, -1
        )
        return np.asarray(by_step.sum(axis=(0, 3)) * case.dt_h @ self._shares)


def _start(system: System, variation: Variation, random: np.random.Generator) -> State:
    state = system.initial_state()
    low, high = system.soc_window
    soc = state.soc + variation.spread * (high - low) * random.uniform(-1.0, 1.0, state.n_strings)
    temperature_c = state.temperature_c + variation.spread_k * random.uniform(-1.0, 1.0, state.n_strings)
    return replace(state, soc=np.clip(soc, low, high), temperature_c=temperature_c)


POPULATION: Final = 32
"""Controllers of a generation, which run in parallel."""
GENERATIONS: Final = 150
"""Generations of a search."""
SPREAD: Final = 0.4
"""Standard deviation of the weights of the first generation."""


def first_weights() -> Array:
    """Start of the search: SOC balancing, a reserve near empty, half of the lost energy undelivered later."""
    weights, at = np.zeros(N_WEIGHTS), places()
    for side in (0, at["PER_SIDE"]):
        weights[side + at["W_BALANCE"]] = 1.0
        weights[side + at["W_RESERVE"] :][:3] = 1.0, 1.0, 0.1
        weights[side + at["W_RESERVE_LOWEST"] :][:3] = 0.5, 0.5, 0.0
        weights[side + at["W_FULL"]] = 0.1
        weights[side + at["W_WORTH"] : side + at["W_WORTH_SCARCE"] + 1] = 0.5, 1.0
    weights[at["W_KEEPS"]] = 0.85
    return weights


def fit(training: TrainingSet, generations: int, update: Callable[[int], None]) -> Array:
    """Find the best weights by covariance matrix adaptation (CMA-ES) [1]_.

    The cost over weights is not smooth, since a small change can switch on another string and change all
    later steps. The search is derivative-free and repeats bit for bit. ``update`` receives the number of
    generations.

    References
    ----------
    .. [1] Hansen, N.: The CMA evolution strategy: a tutorial. 2016, arXiv:1604.00772.
    """
    with extra("distil", "bess distil"):
        import cma

    start = first_weights()
    strategy = cma.CMAEvolutionStrategy(
        start, SPREAD, {"popsize": POPULATION, "seed": 1, "verbose": -9, "maxiter": generations}
    )
    for generation in range(generations):
        tried = strategy.ask()
        strategy.tell(tried, training.costs(np.array(tried)).tolist())
        update(generation + 1)
    found = strategy.best
    return np.asarray(found.x) if found.f < training.costs(start[None])[0] else start
