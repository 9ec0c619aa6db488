"""The grid connection of a plant that trades: load and generation behind its meter, and its monthly peak."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from bess.arrays import Array, ByValue
from bess.checkpoints import Checkpointed
from bess.dispatch.forecast import Forecast
from bess.dispatch.program import StoreProgram
from bess.units import KWH_PER_MWH, SECONDS_PER_HOUR

QUARTER_S: Final = 900
"""Averaging time of the grid import under a peak tariff [s]."""


@dataclass(frozen=True, eq=False)
class PeakTariff(ByValue):
    """A price of the highest quarter-hour mean of the grid import in each calendar month.

    Attributes
    ----------
    eur_kw : float
        Price for each month.
    month : ndarray of int, shape (n_steps,)
        Number of the month of each step, ascending.
    quarter : ndarray of int, shape (n_steps,)
        Number of its quarter of an hour.
    """

    eur_kw: float
    month: npt.NDArray[np.int64]
    quarter: npt.NDArray[np.int64]


def monthly_peaks_kw(import_kw: Array, tariff: PeakTariff) -> Array:
    """Return the highest quarter-hour mean of the month so far at the end of each step, at least 0.

    A quarter of an hour counts from its last step on.
    """
    first = np.flatnonzero(np.diff(tariff.quarter, prepend=tariff.quarter[0] - 1))
    steps = int(np.diff(first, append=import_kw.size).max())
    mean_kw = np.zeros(import_kw.size)
    last = np.r_[first[1:], import_kw.size] - 1
    mean_kw[last] = np.maximum(np.add.reduceat(import_kw, first) / steps, 0.0)
    begins = np.flatnonzero(np.diff(tariff.month, prepend=tariff.month[0] - 1))
    parts = [np.maximum.accumulate(part) for part in np.split(mean_kw, begins[1:])]
    return np.concatenate(parts)


class GridConnection(Checkpointed):
    r"""Constraints and costs at the meter for a dispatch over prices, and the peak of the month so far.

    With load less generation :math:`n_t` behind the meter, import :math:`i_t`, the fee :math:`f` on it, the
    peak :math:`L_m` of each month :math:`m`, its price :math:`\kappa`, generation :math:`k_t` that the limit
    :math:`X` of the export curtails, and the limit :math:`I` of the import, the program of a store gets

    .. math:: \min\ \dots + \sum_t (f\, i_t + \pi_t^+ k_t)\,\Delta t + \kappa \sum_m (L_m - L^0_m)^+
       \quad\text{s. t.}\quad n_t + c_t - d_t \le i_t \le \min(L_m, \max(I, n_t)),\quad
       d_t - c_t - n_t - k_t \le X,\quad 0 \le k_t \le \max(0, -n_t - X) .

    A plan covers a part of a month, but a higher peak can also be used on later days. The peak is therefore
    chosen once a day by the same program over the last week and the plan together, at the monthly price
    times the ratio of their hours to the remaining hours: the rest of the month is assumed to be like them.
    In plans :math:`L^0` is this peak, or that of the month so far if it is higher.

    Parameters
    ----------
    net_kw : Forecast
        Load less generation [kW].
    dt_h : float
        Control step [h].
    max_import_kw, max_export_kw : float
        Limits at the meter; infinite without.
    import_fee_eur_mwh : float
        Fees on the import in addition to the price, >= 0.
    tariff : PeakTariff or None
        Price of the peak.
    """

    _carried = ("_quarter_kw", "_peak_kw", "_chosen_kw", "_planned_kw", "_last_kw")

    def __init__(
        self,
        net_kw: Forecast,
        dt_h: float,
        *,
        max_import_kw: float = np.inf,
        max_export_kw: float = np.inf,
        import_fee_eur_mwh: float = 0.0,
        tariff: PeakTariff | None = None,
    ):
        self._net_kw, self._dt_h = net_kw, dt_h
        self._max_import_kw, self._max_export_kw = max_import_kw, max_export_kw
        self._import_fee_eur_mwh, self.tariff = import_fee_eur_mwh, tariff
        self._quarter_kw = 0.0
        self._peak_kw, self._chosen_kw, self._planned_kw = 0.0, 0.0, np.inf
        self._last_kw: float | None = None

    def advance(self, step: int, delivered_kw: float) -> None:
        """Count the step before ``step``, in which the plant delivered this power (positive = discharge)."""
        tariff = self.tariff
        if tariff is not None and self._last_kw is not None:
            self._quarter_kw += self._last_kw - delivered_kw
            if tariff.quarter[step] != tariff.quarter[step - 1]:
                steps = round(QUARTER_S / (SECONDS_PER_HOUR * self._dt_h))
                self._peak_kw = max(self._peak_kw, self._quarter_kw / max(1, steps))
                self._quarter_kw = 0.0
            if tariff.month[step] != tariff.month[step - 1]:
                self._peak_kw = self._chosen_kw = 0.0
        self._last_kw = float(self._net_kw.ahead(step, 1)[0])

    def net_kw(self, step: int, n: int) -> Array:
        """Return load less generation of the next ``n`` steps [kW]; the last value is held after the end."""
        values = self._net_kw.ahead(step, n)
        return np.concatenate([values, np.full(n - values.size, values[-1])])

    def constrain(
        self,
        program: StoreProgram,
        price_eur_mwh: Array,
        net_kw: Array,
        month: npt.NDArray[np.int64],
        power_kw: float,
        weight: float,
        share: float = 1.0,
    ) -> None:
        """Add columns and rows to a program in per unit of ``power_kw``, whose cost is ``weight`` EUR/MWh h.

        ``share`` scales the monthly price. The last columns are the increases of the peaks, by month.
        """
        net, cost = net_kw / power_kw, weight * self._dt_h
        max_import, max_export = self._max_import_kw / power_kw, self._max_export_kw / power_kw
        imported = program.add(
            net.size, cost=cost * self._import_fee_eur_mwh, upper=np.maximum(max_import, net)
        )
        program.at_most(-net, (program.charge, 1.0), (program.discharge, -1.0), (imported, -1.0))
        if np.isfinite(max_export):
            curtailed = program.add(
                net.size,
                cost=cost * np.maximum(price_eur_mwh, 0.0),
                upper=np.maximum(0.0, -net - max_export),
            )
            program.at_most(
                max_export + net,
                (program.discharge, 1.0),
                (program.charge, -1.0),
                (curtailed, -1.0),
            )
        if self.tariff is not None:
            numbers, period = np.unique(month, return_inverse=True)
            known = np.zeros(numbers.size)
            known[0] = max(self._peak_kw, self._chosen_kw) / power_kw
            higher = program.add(numbers.size, cost=weight * KWH_PER_MWH * share * self.tariff.eur_kw)
            program.at_most(known[period], (imported, 1.0), (higher[period], -1.0))

    def raise_peak(self, higher_kw: float) -> None:
        """Raise the chosen peak of the month."""
        self._chosen_kw = max(self._peak_kw, self._chosen_kw) + higher_kw

    def set_plan(self, step: int, demand_kw: Array) -> None:
        """Store the peak of a plan, which holds until the next plan."""
        if self.tariff is not None:
            month = self.tariff.month[step : step + demand_kw.size]
            planned_kw = self.net_kw(step, demand_kw.size) - demand_kw
            self._planned_kw = float(planned_kw[month == month[0]].max())

    def limited(self, step: int, demand_kw: float, discharge_kw: float) -> float:
        """Return the demand within the limits of import, export and peak.

        ``discharge_kw`` is the largest power that the stored energy allows.
        """
        net_kw = float(self._net_kw.ahead(step, 1)[0])
        min_power_kw = min(net_kw - self._max_import_kw, 0.0)
        if self.tariff is not None:
            above_kw = net_kw - max(0.0, self._peak_kw, self._chosen_kw, self._planned_kw)
            min_power_kw = max(min_power_kw, min(above_kw, discharge_kw))
        return min(max(demand_kw, min_power_kw), max(net_kw + self._max_export_kw, 0.0))
