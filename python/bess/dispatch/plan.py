"""``bess.plan_dispatch``: one plan over prices, outside of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bess.arrays import one_number, require_positive
from bess.dispatch.arbitrage import calendar_days
from bess.dispatch.aware import DispatchInputs, DispatchPlan, DynamicProgramDispatch
from bess.dispatch.forecast import steps_in
from bess.dispatch.store_value import price_steps
from bess.errors import InputError
from bess.system import State, System
from bess.system.system import check_system, surroundings_of_steps
from bess.system.terms import SettlementTerms

if TYPE_CHECKING:
    import pandas as pd


def plan_dispatch(
    system: System,
    prices: pd.Series[float] | npt.ArrayLike,
    state: State,
    hours: float = 36.0,
    *,
    terms: SettlementTerms | None = None,
    ambient_c: npt.ArrayLike | None = None,
    cycles_per_day: float = 2.0,
    market_time_zone: str = "Europe/Berlin",
) -> DispatchPlan:
    r"""Plan the dispatch of a plant over prices, with its limits, losses and wear.

    With price :math:`\pi`, delivered power :math:`p` (:math:`p^+` discharge, :math:`p^-` charge), demand
    :math:`D`, fees :math:`f`, wear :math:`W`, and the remaining energy :math:`e_T` at its value :math:`v`,

    .. math:: \max_D\ \sum_t \bigl(p^+_t (\pi_t - f_d) - p^-_t (\pi_t + f_c)
       - (|D_t| - |p_t|)(|\pi_t| + s)\bigr)\,\Delta t - W + v\, e_T

    where :math:`p`, :math:`e` and the temperatures follow from :math:`D` by the control model (equations 1 to
    6 of ``docs/equations.md``). :class:`bess.dispatch.DynamicProgramDispatch` describes the
    solution.

    Parameters
    ----------
    system : System
        The plant; its sections ``[wear]`` price the wear.
    prices : pandas.Series or array_like
        Prices from now on [EUR/MWh]: a regular series with a time-zone aware index, as
        :func:`bess.read_prices` gives it, or one value for each control step of the system (15 min).
    state : State
        Measured state now.
    hours : float
        Horizon of the plan [h], a whole number of control steps that prices must cover.
    terms : Terms, optional
        Fees and the price of a shortfall (:class:`bess.system.terms.SettlementTerms`); the defaults of a
        study.
    ambient_c : float or array_like, shape (n_steps,), optional
        Ambient temperature [degC], by default that of the system; with a section ``[cooling]``, the reference
        temperature of the control model (:meth:`~bess.System.surroundings_c`).
    cycles_per_day : float
        Maximum full cycles per day.
    market_time_zone : str
        Of the trading day, to which ``cycles_per_day`` applies; without an index the plan begins at midnight.

    Returns
    -------
    DispatchPlan
        ``demand_kw``, ``expected_delivered_kw`` and ``expected_net_eur``, among others. The plan does not
        empty the store at its end: remaining energy has a value, which ``expected_net_eur`` excludes.

    Raises
    ------
    InputError
        Prices are not finite, too short, or of another step; ``state`` does not fit the system.

    Examples
    --------
    >>> import bess, numpy as np
    >>> system = bess.System.reference(2)
    >>> prices = np.repeat([20.0, 90.0, 30.0, 120.0], 24)
    >>> plan = bess.plan_dispatch(system, prices, system.initial_state(), hours=24)
    >>> bool(plan.demand_kw[:24].sum() < 0 < plan.demand_kw[24:48].sum())
    True
    """
    check_system(system)
    if not isinstance(terms, SettlementTerms | None):
        raise InputError(f"terms must be bess.system.terms.SettlementTerms, not {type(terms).__name__}")
    system.check_state(state)
    cycles_per_day = one_number("cycles_per_day", cycles_per_day)
    require_positive("plan_dispatch", cycles_per_day=(cycles_per_day, ""))
    dt_h = system.control.dt_h
    steps = steps_in(one_number("hours", hours), dt_h, "hours")
    values, days = _on_steps(prices, steps, dt_h, market_time_zone)
    inputs = DispatchInputs(values, surroundings_of_steps(system, ambient_c, steps, dt_h), days)
    dispatch = DynamicProgramDispatch(system, dt_h, terms or SettlementTerms(), cycles_per_day=cycles_per_day)
    return dispatch.plan(inputs, state)


def _on_steps(
    prices: pd.Series[float] | npt.ArrayLike, steps: int, dt_h: float, time_zone: str
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    import pandas as pd

    from bess.market.times import clock_of

    known, step_h = price_steps(prices.iloc[:steps] if isinstance(prices, pd.Series) else prices, dt_h)
    values = known.repeat(steps_in(step_h, dt_h, "prices: their step"))[:steps]
    if values.size < steps:
        raise InputError(
            f"prices: {values.size} values are less than the {steps} steps of {dt_h:g} h to be planned"
        )
    if not isinstance(prices, pd.Series):
        return values, (np.arange(steps) * dt_h // 24.0).astype(np.int64)
    if not isinstance(prices.index, pd.DatetimeIndex) or prices.index.tz is None:
        raise InputError("prices: the series needs a time-zone aware index")
    times = pd.date_range(prices.index[0], periods=steps, freq=pd.Timedelta(hours=dt_h))
    return values, calendar_days(times, clock_of(time_zone))
