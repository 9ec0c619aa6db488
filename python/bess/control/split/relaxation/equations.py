"""The convex relaxation of the power split, written once in CVXPY (docs/equations.md, equations 11 to 22).

One program for ``n_strings`` strings over ``n_steps`` steps. Data that change between calls or nodes are
parameters, so the program is compiled once. Its coefficients are defined in
:mod:`bess.control.split.relaxation.data`. With coefficients frozen along a schedule, it is the convexified
program of the stopping criterion. With ranges of coefficients over the states of a node, its optimum is a
lower bound of the nonlinear control model.

All quantities are per unit. Powers are relative to the nominal power of the string, losses to its loss at
nominal power (``w_N``, ``h_N``), and stored energy to the energy of one step at nominal power. Temperature is
``theta = (tau - 25 degC) / 10 K``. Powers are magnitudes; ``sign`` is +1 in discharge and -1 in charge.
"""

# mypy: disable-error-code="attr-defined"
# (cvxpy exports its atoms in a way mypy does not see)

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bess.control.split.relaxation.conic import ConicProgram

if TYPE_CHECKING:
    import cvxpy as cp

LOSSES = ("a", "d", "w", "h")
"""Variables with costs: availability, derating, inverter, battery."""

BINARIES = ("on", "full", "low")
"""Inverter on; full (charge) or empty (discharge) at the end of the step; SOC below the switch of the
resistance at its start."""

INVERTER_LINES = 6
"""Number of lines below the inverter loss; tables with more knots are underestimated by fewer chords."""


def build(
    n_strings: int, n_steps: int, n_caps: int
) -> tuple[cp.Problem, dict[str, cp.Variable], dict[str, cp.Parameter]]:
    """Return the relaxation with its variables and parameters by name.

    ``n_caps`` earlier objectives have caps (lexicographic stages).
    """
    # CVXPY takes half a second to load, and most calls need no relaxation.
    import cvxpy as cp

    shape = (n_strings, n_steps)
    parameters: dict[str, cp.Parameter] = {}
    variables: dict[str, cp.Variable] = {}

    def par(name: str, of: tuple[int, ...] = shape) -> cp.Parameter:
        if name not in parameters:
            parameters[name] = cp.Parameter(of, name=name)
        return parameters[name]

    def times(name: str, x: Any) -> Any:
        return cp.multiply(par(name), x)

    def var(name: str, steps: int = n_steps) -> cp.Variable:
        variables[name] = cp.Variable((n_strings, steps), name=name)
        return variables[name]

    on, full, low = (var(name) for name in BINARIES)
    p, a, d = var("p"), var("a"), var("d")  # delivered AC power; availability loss; derating loss
    w, h = var("w"), var("h")  # inverter loss, battery loss
    P, z = var("P"), var("z")  # internal power V I; V^2/R of a string that runs, 0 of one that is off
    # At step boundaries, the first of them measured: SOC, temperature, stored energy.
    soc, theta, e = (var(name, n_steps + 1) for name in ("soc", "theta", "e"))
    u = p + a + d  # the request
    before, after = slice(None, -1), slice(1, None)
    moved = soc[:, before] - soc[:, after]

    constraints = [
        # Power balance.
        par("share", (n_strings,)) @ u == par("demand", (n_steps,)),
        a >= 0, d >= 0, u >= par("u_lo"), u <= par("u_hi"),
        p >= times("p_lo", on), p <= times("p_hi", on), on <= 1, full >= 0, full <= 1, low >= 0, low <= 1,
        # Symmetry breaking: identical strings have decreasing requests in the first step.
        cp.multiply(par("ordered", (n_strings,)), u[:, 0] - np.eye(n_strings, k=1) @ u[:, 0]) >= 0,
        # Derating, d = (1 - k(tau)) u: interval of 1 - k, and McCormick with its convex underestimator in
        # theta.
        d >= times("derating_lo", u),
        d <= times("derating_hi", u),
        d >= times("derating_hi", u) + times("derating_theta", theta[:, before]) + par("derating_0"),
        d >= times("derating_lo", u) + times("derated_theta", theta[:, before]) + par("derated_0"),
        # Availability loss requires the SOC limit at the end of the step, or is below the minimum power.
        a <= times("a_hi", full) + par("a_off") - times("a_off", on),
        times("sign", soc[:, after]) <= par("full_0") - times("full_slack", full),
        # Inverter loss: perspective of the convex envelope of its table, and a chord above it.
        *(w >= times(f"inverter_slope_{j}", p) + times(f"inverter_0_{j}", on) for j in range(INVERTER_LINES)),
        w <= times("inverter_chord_slope", p) + times("inverter_chord_0", on),
        # Internal power V I: AC power plus losses in discharge, minus losses in charge.
        p + times("inverter_share", w) + times("battery_share", h) == P,
        # Battery loss, h V^2/R >= (V I)^2, in perspective form: z = on V^2/R; and a chord above it.
        cp.SOC(cp.vec(z + h, order="F"),
               cp.vstack([cp.vec(2 * P, order="F"), cp.vec(z - h, order="F")])),
        h <= times("heat_chord", P) + times("heat_0", on),
        # V^2/R: its largest value in the box, above and below the switch, and a plane above it.
        z <= times("y_hi", on),
        z <= par("y_above") + times("y_below", low),
        z <= times("y_lo", on) + times("y_soc", soc[:, before]) + times("y_theta", theta[:, before])
        + par("y_0"),
        soc[:, before] >= par("switch_lo") - times("switch_0", low),
        soc[:, before] <= par("switch_hi") - times("switch_1", low),
        # Charge balance, with the voltage in its range.
        times("sign", moved) <= times("current_hi", P) + par("current_0"),
        times("sign", moved) >= times("current_lo", P) - par("current_0"),
        soc[:, after] >= par("soc_lo"), soc[:, after] <= par("soc_hi"),
        # Energy balance: a string delivers the decrease of its stored energy, and more as its voltage falls.
        times("sign", e[:, before] - e[:, after]) + times("potential_hi", moved) + par("potential_0") >= P,
        times("sign", e[:, before] - e[:, after]) + times("potential_lo", moved) - par("potential_0") <= P,
        e[:, after] <= times("stored_hi_soc", soc[:, after]) + par("stored_hi_0"),
        *(e[:, after] >= times(f"stored_lo_soc_{j}", soc[:, after]) + par(f"stored_lo_0_{j}")
          for j in (0, 1)),
        # Heat balance.
        theta[:, after] == times("retained", theta[:, before]) + times("heating", h) + par("air"),
        # Step cuts: each step costs at least its one-step optimum, less the saving by availability loss.
        cp.sum(times("cut_a", a), axis=0)
        + par("cut_d", (n_strings,)) @ d + par("cut_w", (n_strings,)) @ w + par("cut_h", (n_strings,)) @ h
        >= par("cut_0", (n_steps,)),
    ]  # fmt: skip
    for cap in range(n_caps):
        total = sum(cp.sum(par(f"cap{cap}_{x}", (n_strings,)) @ variables[x]) for x in LOSSES)
        constraints.append(total <= par(f"cap{cap}", ()))
    objective = sum(cp.sum(par(f"cost_{x}", (n_strings,)) @ variables[x]) for x in LOSSES)
    return cp.Problem(cp.Minimize(objective), constraints), variables, parameters


@lru_cache(maxsize=64)
def compiled(n_strings: int, n_steps: int, n_caps: int) -> ConicProgram:
    """Compile the relaxation for Clarabel, once per process and size.

    Strings share the balance, the step cuts and the caps; identical ones also have ordered requests.
    """
    shared = ("demand", "cut_0", *(f"cap{cap}" for cap in range(n_caps)))
    return _of_one_string(n_steps, n_caps).repeated(n_strings, shared, "ordered")


@lru_cache(maxsize=64)
def _of_one_string(n_steps: int, n_caps: int) -> ConicProgram:
    return ConicProgram(*build(1, n_steps, n_caps))
