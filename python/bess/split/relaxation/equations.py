"""The convex relaxation of the power split, written once in CVXPY (docs/equations.md, equations 11 to 22).

One program for ``n_strings`` strings over ``n_steps`` steps. Everything that changes from call to call is a
parameter, so it is compiled once and re-used. It serves two data sets (:mod:`bess.split.relaxation.data`):
coefficients frozen along a schedule, which makes it the convexified program on which the search stops, and
their ranges over the reachable states, which makes its optimum a lower bound of the nonlinear control model.

All quantities are per unit: powers of the string's nominal power, losses of the string's loss at nominal
power (``w_N``, ``h_N``), temperature as ``theta = (tau - 25 degC) / 10 K``. Powers are magnitudes, ``sign``
is +1 in discharge and -1 in charge.
"""

# mypy: disable-error-code="attr-defined"
# (cvxpy exports its atoms in a way mypy does not see)

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cvxpy as cp

from bess.split.relaxation.conic import ConicProgram

LOSSES = ("a", "d", "w", "h")
"""Variables that cost: availability, derating, inverter, battery."""

INVERTER_PIECES = 6
"""Pieces of the inverter loss envelope; tables with more knots are underestimated by fewer chords."""


@dataclass(frozen=True)
class Equations:
    """The CVXPY problem with its variables and parameters by name."""

    problem: cp.Problem
    variables: dict[str, cp.Variable]
    parameters: dict[str, cp.Parameter]


def build(n_strings: int, n_steps: int, n_caps: int) -> Equations:
    """State the relaxation; ``n_caps`` earlier objectives are kept below a cap (lexicographic stages)."""
    shape = (n_strings, n_steps)
    parameters: dict[str, cp.Parameter] = {}
    variables: dict[str, cp.Variable] = {}

    def par(name: str, of: tuple[int, ...] = shape, **kind: bool) -> cp.Parameter:
        parameters[name] = cp.Parameter(of, name=name, **kind)
        return parameters[name]

    def var(name: str, steps: int = n_steps) -> cp.Variable:
        variables[name] = cp.Variable((n_strings, steps), name=name)
        return variables[name]

    on, full = var("on"), var("full")  # binaries: inverter on; full (charge) or empty (discharge) at the end
    p, a, d = var("p"), var("a"), var("d")  # delivered AC power; shed at the limit; lost to derating
    w, h = var("w"), var("h")  # inverter loss, battery loss
    P, z = var("P"), var("z")  # internal power V I; V^2/R of a string that runs, 0 of one that is off
    soc, theta = (
        var("soc", n_steps + 1),
        var("theta", n_steps + 1),
    )  # at step boundaries; column 0 is measured
    u = p + a + d  # the request
    sign = par("sign")
    taken = cp.multiply(sign, soc[:, :-1] - soc[:, 1:])  # charge moved, in units of soc, >= 0

    constraints = [
        # The strings share the demand.
        par("share", (n_strings,)) @ u == par("demand", (n_steps,)),
        p >= 0, a >= 0, d >= 0, u <= par("limit"), p <= cp.multiply(parameters["limit"], on), on <= 1,
        full >= 0, full <= 1,
        # Derating, d = (1 - k(tau)) u: interval of 1 - k, and McCormick with its convex underestimator in
        # theta.
        d >= cp.multiply(par("derating_lo"), u),
        d <= cp.multiply(par("derating_hi"), u),
        d >= cp.multiply(parameters["derating_hi"], u)
        + cp.multiply(par("derating_theta"), theta[:, :-1]) + par("derating_0"),
        # Power is shed only where the SOC limit is met at the end of the step.
        a <= cp.multiply(parameters["limit"], full),
        cp.multiply(sign, soc[:, 1:]) <= par("full_0") - cp.multiply(par("full_slack"), full),
        # Inverter loss: perspective of the convex envelope of its table, and the upper chord.
        *(w >= cp.multiply(par(f"inverter_slope_{j}"), p) + cp.multiply(par(f"inverter_0_{j}"), on)
          for j in range(INVERTER_PIECES)),
        w <= cp.multiply(par("inverter_chord_slope"), p) + cp.multiply(par("inverter_chord_0"), on),
        # Internal power V I: AC power plus losses in discharge, minus losses in charge.
        p + cp.multiply(par("inverter_share"), w) + cp.multiply(par("battery_share"), h) == P,
        # Battery loss, h V^2/R >= (V I)^2, in perspective form: z = on V^2/R; and h <= (R I / V) V I.
        cp.SOC(cp.vec(z + h, order="F"),
               cp.vstack([cp.vec(2 * P, order="F"), cp.vec(z - h, order="F")])),
        h <= cp.multiply(par("heat_chord"), P) + par("heat_0"),
        # V^2/R: its largest value in the box, and an affine overestimator in the state.
        z <= cp.multiply(par("y_hi"), on),
        z <= cp.multiply(par("y_lo"), on) + cp.multiply(par("y_soc"), soc[:, :-1])
        + cp.multiply(par("y_theta"), theta[:, :-1]) + par("y_0"),
        # Charge balance with the voltage in its range.
        taken >= cp.multiply(par("current_lo"), P) - par("current_0"),
        taken <= cp.multiply(par("current_hi"), P) + parameters["current_0"],
        soc[:, 1:] >= par("soc_lo"), soc[:, 1:] <= par("soc_hi"),
        # Heat balance.
        theta[:, 1:] == cp.multiply(par("keep"), theta[:, :-1]) + cp.multiply(par("heating"), h) + par("air"),
        # Step cuts: each step costs at least its one-step optimum, less what shedding can save.
        cp.sum(cp.multiply(par("cut_a"), a), axis=0)
        + par("cut_d", (n_strings,)) @ d + par("cut_w", (n_strings,)) @ w + par("cut_h", (n_strings,)) @ h
        >= par("cut_0", (n_steps,)),
    ]  # fmt: skip
    for cap in range(n_caps):
        total = sum(cp.sum(par(f"cap{cap}_{x}", (n_strings,)) @ variables[x]) for x in LOSSES)
        constraints.append(total <= par(f"cap{cap}", ()))
    objective = sum(cp.sum(par(f"cost_{x}", (n_strings,)) @ variables[x]) for x in LOSSES)
    return Equations(cp.Problem(cp.Minimize(objective), constraints), variables, parameters)


@lru_cache(maxsize=64)
def compiled(n_strings: int, n_steps: int, n_caps: int) -> ConicProgram:
    """Compile the relaxation for Clarabel, once per process and size."""
    stated = build(n_strings, n_steps, n_caps)
    return ConicProgram(stated.problem, stated.variables, stated.parameters)
