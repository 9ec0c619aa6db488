"""A lower bound of the cost of every schedule, independent of the search."""

from __future__ import annotations

import numpy as np

from bess import _core
from bess.arrays import Array
from bess.control.objectives import Costs
from bess.control.problem import SplitProblem


def proven_bound(problem: SplitProblem, loss_prices: Array) -> float:
    """Return the sum of the minimum costs of single steps over all reachable states of the control model.

    Parameters
    ----------
    problem : SplitProblem
        State, demand, limits.
    loss_prices : ndarray, shape (4,)
        Minimum price of availability, derating, inverter and battery loss [cost/kWh].

    Returns
    -------
    float
        Lower bound of the cost of losses; it does not include starts and wear.
    """
    n_strings, n_steps = problem.limit_kw.shape
    costs = np.broadcast_to(loss_prices, (1, n_strings, 4)).copy()
    control = problem.control(Costs(costs, costs), np.zeros(1), np.zeros(1))
    reach = control.reachable()

    def over_the_step(values: Array, minimum: bool) -> Array:
        """States at the start and the end of a step; the coefficients of the step lie between."""
        after = np.append(values[:, 1:], values[:, -1:], axis=1)
        return np.asarray(np.minimum(values, after) if minimum else np.maximum(values, after))

    boxes = _core.StateBoxes(
        over_the_step(reach.soc_low, minimum=True),
        over_the_step(reach.soc_high, minimum=False),
        over_the_step(reach.temperature_low_c, minimum=True),
        over_the_step(reach.temperature_high_c, minimum=False),
    )
    cuts = control.step_bounds(boxes, costs[0], np.abs(problem.demand_kw))
    # cost + slope x shed >= phi: if a shed kW costs less than the slope, shedding all of it is optimal.
    share = np.divide(loss_prices[0], cuts.shed_slope, out=np.ones(n_steps), where=cuts.shed_slope > 0.0)
    return float((cuts.phi * np.minimum(1.0, share)).sum() * problem.dt_h)
