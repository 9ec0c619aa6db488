"""What a controller is trained on: closed loops over the study's demand and over variations of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bess.arrays import Array
from bess.control.explicit import ExplicitController
from bess.control.policies import Decision, PolicyInput, build_policy
from bess.plant import PlantEnsemble
from bess.simulation.inputs import prepare
from bess.simulation.runner import run
from bess.study import Study
from bess.study.policy_settings import policy_settings
from bess.system import State, System


@dataclass(frozen=True)
class Variation:
    """How a lesson differs from the study.

    Attributes
    ----------
    weight : float
        Its share in what is minimised.
    scale : float
        Factor on the demand.
    spread : float
        Largest change of each string's SOC at the start, as a share of its window.
    spread_k : float
        Largest change of its temperature [K].
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
"""The study as it is counts most; the others keep a controller from learning one course by heart."""


@dataclass(frozen=True)
class TrainingCase:
    """What a study asks of a plant, step by step.

    Attributes
    ----------
    system : System
        The plant.
    dt_h : float
        Control step [h].
    ahead_kw : ndarray, shape (n_steps, steps_ahead)
        Demand of each step and as foreseen for the next ones, at most what the inverters in service can take.
    limit_kw : ndarray, shape (n_steps, n_strings)
        Power of each inverter in service.
    ambient_c : ndarray, shape (n_steps,)
        Ambient temperature [degC].
    """

    system: System
    dt_h: float
    ahead_kw: Array
    limit_kw: Array
    ambient_c: Array

    @classmethod
    def of(cls, study: Study) -> TrainingCase:
        """Run the study once with a rule and keep what it was told.

        A demand that depends on the plant's state, such as that of a dispatch over prices, is that of the
        rule.
        """
        inputs = prepare(study)
        rule = build_policy("soc", inputs.system, policy_settings(study, inputs.system))
        told: list[PolicyInput] = []

        def listen(situation: PolicyInput) -> Decision:
            told.append(situation)
            return rule(situation)

        run(study, policy=listen, progress=False)
        return cls(
            inputs.system,
            inputs.grid.dt_h,
            np.array([situation.demand_kw for situation in told]),
            np.array([situation.limit_kw for situation in told]),
            inputs.ambient_c,
        )


class TrainingSet:
    """Closed loops of a course and its variations, for many controllers at once.

    Parameters
    ----------
    course : Course
        What is asked.
    controller : ExplicitController
        Gives the tables; its weights are not used.
    variations : tuple of Variation
        Lessons.
    seed : int
        Of the states at the start of the variations.
    """

    def __init__(
        self,
        course: TrainingCase,
        controller: ExplicitController,
        variations: tuple[Variation, ...] = VARIATIONS,
        seed: int = 0,
    ) -> None:
        self._course = course
        self._law = controller.core
        self._shortfall = controller.tables.shortfall
        self._shares = np.array([each.weight for each in variations])
        total_kw = course.limit_kw.sum(axis=1)[:, None]
        scaled = [np.clip(each.scale * course.ahead_kw, -total_kw, total_kw) for each in variations]
        self._demand_kw = np.stack([ahead[:, 0] for ahead in scaled], axis=1)
        self._outlook = np.stack([self._law.look(np.ascontiguousarray(ahead)) for ahead in scaled], axis=1)
        random = np.random.default_rng(seed)
        self._starts = [_start(course.system, each, random) for each in variations]

    def costs(self, weights: Array) -> Array:
        """Cost of each controller [kWh]: ``shortfall`` times what is not delivered, and losses.

        Parameters
        ----------
        weights : ndarray, shape (n_controllers, n_weights)
            One row for each controller.

        Returns
        -------
        ndarray, shape (n_controllers,)
            Mean over the lessons, by their weights.
        """
        course, n_lessons = self._course, self._shares.size
        n_controllers = len(weights)
        fleet = PlantEnsemble(course.system, self._starts * n_controllers)
        flows = self._law.run(
            fleet.core,
            np.repeat(weights, n_lessons, axis=0),
            np.tile(self._demand_kw, (1, n_controllers)),
            np.tile(self._outlook, (1, n_controllers, 1)),
            course.limit_kw,
            np.repeat(course.ambient_c[:, None], n_controllers * n_lessons, axis=1),
            course.dt_h * 3600.0,
        )
        missing = flows["availability_loss_kw"] + flows["derating_loss_kw"]
        lost = flows["inverter_loss_kw"] + flows["battery_loss_kw"]
        by_step = (self._shortfall * missing + lost).reshape(
            len(course.ambient_c), n_controllers, n_lessons, -1
        )
        return np.asarray(by_step.sum(axis=(0, 3)) * course.dt_h @ self._shares)


def _start(system: System, variation: Variation, random: np.random.Generator) -> State:
    state = system.initial_state()
    window = np.array([(string.battery.soc_min, string.battery.soc_max) for string in system.strings])
    moved = variation.spread * (window[:, 1] - window[:, 0]) * random.uniform(-1.0, 1.0, state.n_strings)
    return State(
        np.clip(state.soc + moved, window[:, 0], window[:, 1]),
        state.temperature_c + variation.spread_k * random.uniform(-1.0, 1.0, state.n_strings),
        state.soh_capacity,
        state.soh_resistance,
    )
