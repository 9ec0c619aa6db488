"""The power split of MODEL section 3 as a mixed-integer program, in whatever language a solver speaks.

Written once for all rivals, for states where nothing has to be shed (availability loss 0). Current is in
100 A and voltage in 100 V, so that all variables are of like size and their product is in 10 kW.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

import bess

Term = Any
"""A number, or an expression of the solver's language."""


class Program(Protocol):
    """What the equations ask of a solver's language, beside ``+``, ``-`` and ``*`` between terms."""

    def variable(self, upper: float) -> Term:
        """Return a new number from 0 to ``upper``."""

    def binary(self) -> Term:
        """Return a new 0 or 1."""

    def table(self, x: Term, knots: np.ndarray, values: np.ndarray) -> Term:
        """Return the table's value at a term; flat beyond its ends."""

    def named(self, expression: Term, lower: float, upper: float) -> Term:
        """Return an intermediate result, as a variable if the language wants one; bounds are implied."""

    def equal(self, left: Term, right: Term) -> None:
        """State an equation."""

    def below(self, left: Term, right: Term) -> None:
        """State ``left <= right``."""

    def minimise(self, objective: Term, gap: float, time_limit_s: float) -> tuple[float, bool]:
        """Solve; return the seconds it took and whether the gap was reached within the limit."""

    def value(self, term: Term) -> float:
        """Return a term's value in the solution."""


@dataclass(frozen=True)
class Answer:
    """A rival's split.

    Attributes
    ----------
    request_kw : ndarray, shape (n_strings, n_steps)
        Requests [kW], signed.
    objective : float
        By the solver's own variables.
    seconds : float
        Wall-clock time of the solve alone, without building the program.
    finished : bool
        The gap was reached; if not, this is the best split known when the search stopped.
    """

    request_kw: np.ndarray
    objective: float
    seconds: float
    finished: bool


def split(
    program: Program,
    system: bess.System,
    state: bess.State,
    demand_kw: np.ndarray,
    weights: tuple[float, float, float],
    *,
    gap: float = 1e-3,
    time_limit_s: float = 60.0,
    dt_h: float = 0.25,
) -> Answer:
    """State the split of ``demand_kw`` (n_steps) [kW, signed] in an empty program, and solve it.

    ``weights`` are those of derating, inverter and battery loss. Raises RuntimeError where no split is found.
    """
    requests = [
        [program.variable(string.inverter.nominal_kw) for _ in demand_kw] for string in system.strings
    ]
    objective: Term = 0.0
    for m, string in enumerate(system.strings):
        soc, tau = float(state.soc[m]), float(state.temperature_c[m])
        costs = np.array(weights) / nominal_losses_kw(string) / (system.n_strings * len(demand_kw))
        for request, demand in zip(requests[m], demand_kw, strict=True):
            losses, soc, tau = _step(
                program, string, request, demand > 0.0, soc, tau, system.ambient_c, dt_h * 3600.0
            )
            objective = objective + sum(cost * loss for cost, loss in zip(costs, losses, strict=True))
    for t, demand in enumerate(demand_kw):
        program.equal(sum(row[t] for row in requests), abs(demand))
    seconds, finished = program.minimise(objective, gap, time_limit_s)
    request_kw = np.array([[program.value(request) for request in row] for row in requests])
    return Answer(request_kw * np.sign(demand_kw), program.value(objective), seconds, finished)


def nominal_losses_kw(string: Any) -> np.ndarray:
    """Derating, inverter and battery loss [kW] of a string that the objective counts as 1."""
    battery, inverter = string.battery, string.inverter
    ohm = np.interp(25.0, battery.resistance_temperature.temperature_c, _ohm(battery))
    volt = np.interp(0.5, battery.ocv_v.soc, battery.ocv_v.discharge[0]) * battery.cells_series
    heat_kw = ohm * (inverter.nominal_kw * 1e3 / volt) ** 2 / 1e3
    return np.array([inverter.nominal_kw, inverter.loss_charge[-1] * inverter.nominal_kw, heat_kw])


def _step(
    program: Program,
    string: Any,
    request: Term,
    discharge: bool,
    soc: Term,
    tau: Term,
    ambient_c: float,
    seconds: float,
) -> tuple[tuple[Term, Term, Term], Term, Term]:
    """Add a string and interval; return derating, inverter, battery loss, next soc and temperature."""
    battery, inverter, derating = string.battery, string.inverter, string.derating
    nominal, ocv, thermal = inverter.nominal_kw, battery.ocv_v, string.thermal.lumped
    volt_100 = np.array((ocv.discharge if discharge else ocv.charge)[0]) * battery.cells_series / 100.0
    loss = np.array(inverter.loss_discharge if discharge else inverter.loss_charge) * nominal

    on, current = program.binary(), program.variable(4.0)
    v = program.table(soc, np.array(ocv.soc), volt_100)
    r = program.table(tau, np.array(battery.resistance_temperature.temperature_c), _ohm(battery))
    k = program.table(tau, np.array(derating.temperature_c), np.array(derating.factor))
    p = program.named(k * request, 0.0, nominal)
    program.below(p, nominal * on)
    over = program.table(p, np.array(inverter.load) * nominal, loss - loss[0])
    w = program.named(over + loss[0] * on, 0.0, nominal)
    drop = program.named(r * current, 0.0, 10.0)
    h = program.named(10.0 * drop * current, 0.0, nominal)
    # As power at the terminals: with V I and the heat instead, SCIP at times cut the optimum off.
    terminal = v - drop if discharge else v + drop
    program.equal(10.0 * terminal * current, p + w if discharge else p - w)

    charge_per_100_a = 100.0 * seconds / 3600.0 / (battery.cell_capacity_ah * battery.cells_parallel)
    soc = program.named(soc - (charge_per_100_a if discharge else -charge_per_100_a) * current, 0.0, 1.0)
    program.below(battery.low_soc_switch, soc)  # below it, the resistance is another
    program.below(soc, battery.soc_max)
    warming = thermal.k1_k_per_j * 1e3 * h - thermal.k2_per_s * (tau - ambient_c)
    return (request - p, w, h), soc, program.named(tau + seconds * warming, -20.0, 80.0)


def _ohm(battery: Any) -> np.ndarray:
    """Resistance of a string [Ohm] at the knots of its temperature table."""
    milliohm = np.array(battery.resistance_temperature.resistance_mohm) * battery.r_scale
    return milliohm * 1e-3 * battery.cells_series / battery.cells_parallel
