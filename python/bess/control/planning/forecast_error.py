"""Tracking of the forecast error."""

from __future__ import annotations

import numpy as np

from bess.arrays import Array
from bess.checkpoints import Checkpointed

MEMORY_H = 24.0
"""Averaging time of forecast errors and of unannounced changes of limits [h]."""


class ForecastErrorTracker(Checkpointed):
    """Compares the demand and limits of each step with the previous forecast (docs/foresight.md).

    Parameters
    ----------
    nominal_kw : ndarray, shape (n_strings,)
        Nominal power of the inverters.
    dt_h : float
        Length of a step [h].

    Attributes
    ----------
    expected_limit_kw : ndarray, shape (n_strings, n_steps), or None
        Expected limits of the next steps; None before the first call.
    """

    _carried = ("expected_limit_kw", "_forecast_kw", "_error_kw", "_mean_kw", "_outage_share")

    def __init__(self, nominal_kw: Array, dt_h: float) -> None:
        self.expected_limit_kw: Array | None = None
        self._nominal_kw = nominal_kw
        self._weight = min(1.0, dt_h / MEMORY_H)
        self._forecast_kw: float | None = None
        self._error_kw = self._mean_kw = self._outage_share = 0.0

    @property
    def relative_error(self) -> float:
        """Forecast error, from 0 (perfect forecast) to 1.

        The sum of two averages over about a day: the relative error of the one-step demand forecast, and the
        share of the inverter power that failed or returned without notice.
        """
        error = self._error_kw / self._mean_kw if self._mean_kw > 0.0 else 0.0
        return min(error + self._outage_share, 1.0)

    def compare(self, demand_kw: Array, limit_kw: Array | None = None) -> bool:
        """Update the error with a step, or with several consecutive steps.

        Parameters
        ----------
        demand_kw : ndarray, shape (n_steps,)
            Demand of this step and forecast of the next ones [kW]; for several steps, a row for each.
        limit_kw : ndarray, shape (n_strings, n_steps), optional
            Limits of this step and the next ones [kW]; as expected if omitted.

        Returns
        -------
        bool
            Whether limits differ from those expected.
        """
        expected = self.expected_limit_kw
        known = expected if limit_kw is None else limit_kw
        limits_kw = self._nominal_kw[:, None] if known is None else known
        rows_kw = np.atleast_2d(demand_kw)[:, :2].tolist()
        for row, (now_kw, *next_kw) in enumerate(rows_kw):
            # Demand above the inverters in service is unmet and is not allocated.
            max_kw = float(limits_kw[:, min(row, limits_kw.shape[1] - 1)].sum())
            now = min(max(now_kw, -max_kw), max_kw)
            if self._forecast_kw is not None:
                forecast_kw = min(max(self._forecast_kw, -max_kw), max_kw)
                self._error_kw += self._weight * (abs(now - forecast_kw) - self._error_kw)
                self._mean_kw += self._weight * (abs(now) - self._mean_kw)
            self._forecast_kw = next_kw[0] if next_kw else None
            self._outage_share *= 1.0 - self._weight
        if known is not None:
            n_steps = known.shape[1]
            self.expected_limit_kw = known[:, np.minimum(np.arange(n_steps) + len(rows_kw), n_steps - 1)]
        if limit_kw is None or expected is None:
            return False
        change_kw = np.abs(limit_kw - expected)
        self._outage_share += float(change_kw[:, 0].sum() / self._nominal_kw.sum())
        # The last step was beyond the horizon of the last call.
        return bool(change_kw[:, : max(1, change_kw.shape[1] - 1)].any())
