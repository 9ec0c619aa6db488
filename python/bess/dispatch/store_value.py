"""``bess.store_value``: maximum income of an ideal store on a price series."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bess.arrays import Array, ByValue, finite_array, one_number, require_positive, step_of_times
from bess.dispatch.program import StoreProgram
from bess.display import as_table, one_line
from bess.errors import InputError
from bess.units import KWH_PER_MWH

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class StoreValue(ByValue):
    """Income of an ideal store with perfect foresight.

    Attributes
    ----------
    net_eur : float
        Income of the whole series; stored energy at its end has no value.
    power_kw : ndarray, shape (n_steps,)
        AC power, positive = discharge.
    stored_kwh : ndarray, shape (n_steps,)
        Stored energy at the end of each step.
    cycle_price_eur : float
        Marginal income of a cycle: the dual value of the budget, 0 if the budget does not bind.
    """

    net_eur: float
    power_kw: Array
    stored_kwh: Array
    cycle_price_eur: float

    def _facts(self) -> dict[str, str]:
        return {
            "steps": str(self.power_kw.size),
            "net": f"{self.net_eur:.2f} EUR",
            "cycle price": f"{self.cycle_price_eur:.3g} EUR",
        }

    __repr__ = one_line
    _repr_html_ = as_table


def store_value(
    prices: pd.Series[float] | npt.ArrayLike,
    energy_kwh: float = 1000.0,
    power_kw: float = 500.0,
    round_trip: float = 0.86,
    cycles: float | None = 365.0,
    initial_kwh: float = 0.0,
    *,
    dt_h: float = 0.25,
    fees_eur_mwh: tuple[float, float] = (0.0, 0.0),
) -> StoreValue:
    r"""Return the maximum income of an ideal store on a price series, by one linear program.

    The program of :class:`bess.dispatch.Arbitrage` without cycle limits of days: with charging :math:`c` and
    discharging :math:`d` (AC), the fee :math:`f` of each, stored energy :math:`e` and :math:`\eta` the root
    of the round trip,

    .. math:: \max \sum_t \bigl((\pi_t - f_d)\, d_t - (\pi_t + f_c)\, c_t\bigr)\,\Delta t
       \quad\text{s. t.}\quad
       e_t = e_{t-1} + \eta c_t \Delta t - d_t \Delta t / \eta,\quad 0 \le e_t \le E,\quad
       0 \le c_t, d_t \le P,\quad d_t \Delta t / \eta \le e_{t-1},\quad
       \sum_t \eta c_t \Delta t \le n E .

    Energy discharged in a step must be stored at its start. This binds only at negative prices, which reward
    simultaneous charging and discharging. The program reproduces the 19 values that [1]_ publishes for German
    ID3 prices of 2021.

    Parameters
    ----------
    prices : pandas.Series or array_like
        Prices [EUR/MWh]: a series with a regular index of times, which gives the step, or values every
        ``dt_h``.
    energy_kwh : float
        Usable energy, > 0.
    power_kw : float
        AC power of charging and of discharging, > 0.
    round_trip : float
        Efficiency AC to AC, in (0, 1].
    cycles : float or None
        Maximum cycles over the whole series, charged (stored) energy over ``energy_kwh``; None for no limit.
    initial_kwh : float
        Stored energy at the start.
    dt_h : float
        Step of prices without times [h].
    fees_eur_mwh : pair of float
        Fees on each MWh charged and discharged (AC).

    Raises
    ------
    InputError
        An argument is outside its range, prices are not finite, or their times are not regular.

    References
    ----------
    .. [1] leloq: Rolling Intrinsic BESS Intraday Trading,
       https://github.com/leloq/Rolling-Intrinsic-BESS-Intraday-Trading

    Examples
    --------
    >>> import bess, numpy as np
    >>> value = bess.store_value(np.tile([20.0, 100.0], 12), cycles=2.0, dt_h=1.0)
    >>> round(value.net_eur, 2), round(value.cycle_price_eur, 2)
    (142.34, 71.17)
    """
    given = {"energy_kwh": energy_kwh, "power_kw": power_kw, "round_trip": round_trip}
    given |= {"initial_kwh": initial_kwh, "dt_h": dt_h}
    energy_kwh, power_kw, round_trip, initial_kwh, dt_h = (
        one_number(f"store_value: {name}", value) for name, value in given.items()
    )
    require_positive(
        "store_value",
        energy_kwh=(energy_kwh, " kWh"),
        power_kw=(power_kw, " kW"),
        dt_h=(dt_h, " h"),
        cycles=(cycles, ""),
    )
    if not 0.0 < round_trip <= 1.0:
        raise InputError(f"store_value: round_trip {round_trip} is outside (0, 1]")
    if not 0.0 <= initial_kwh <= energy_kwh:
        raise InputError(f"store_value: initial_kwh {initial_kwh:g} kWh is outside [0, {energy_kwh:g}] kWh")
    fees = finite_array("store_value: fees_eur_mwh", fees_eur_mwh)
    if fees.shape != (2,):
        raise InputError(f"store_value: fees_eur_mwh has shape {fees.shape}; give two numbers")
    charge_fee, discharge_fee = fees.tolist()
    if dt_h > 24.0:
        raise InputError(f"store_value: steps of {dt_h:g} h are longer than 24 h; give dt_h in hours")
    price, dt_h = price_steps(prices, dt_h)
    # In per unit: power over power_kw, energy over power_kw times 1 h, prices over the largest.
    one_way, capacity, initial = float(np.sqrt(round_trip)), energy_kwh / power_kw, initial_kwh / power_kw
    largest = float(np.abs(price).max()) or 1.0
    unit_eur, unit = largest * power_kw / KWH_PER_MWH, dt_h / largest
    program = StoreProgram(
        np.full(price.size, dt_h),
        one_way,
        initial,
        cost=(unit * (price + charge_fee), unit * (discharge_fee - price)),
        max_power=(1.0, 1.0),
        capacity=capacity,
    )
    burns = np.flatnonzero(price < 0.0)
    later = burns > 0
    program.at_most(
        np.where(later, 0.0, initial),
        (program.discharge[burns], dt_h / one_way),
        (program.stored[burns[later] - 1], -1.0, np.flatnonzero(later)),
    )
    if cycles is not None:
        program.at_most(cycles * capacity, (program.charge, one_way * dt_h))
    best = program.solve()
    return StoreValue(
        net_eur=0.0 - best.cost * unit_eur,  # not -0.0
        power_kw=power_kw * (best.discharge - best.charge),
        stored_kwh=power_kw * best.stored,
        cycle_price_eur=0.0 if cycles is None else float(best.duals[-1]) * capacity * unit_eur,
    )


def price_steps(prices: Any, dt_h: float) -> tuple[Array, float]:
    """Return prices as an array, and the step [h] of their times; ``dt_h`` for prices without times."""
    price = finite_array("prices", prices)
    if price.ndim != 1 or price.size == 0:
        raise InputError(f"prices have shape {price.shape}; give one value for each step, at least one")
    step_h = step_of_times("prices", prices)
    return price, dt_h if step_h is None else step_h
