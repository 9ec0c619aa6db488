"""The loss table of an inverter as a system file has it, made from one measured curve for each direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from bess.arrays import Array, ByValue, one_number
from bess.errors import InputError
from bess.system.components.knots import reduced_knots

Curve = tuple[Array, Array]
"""AC power and loss of one direction, as fractions of nominal AC power."""

_MAX_EXTRAPOLATION = 0.1
_MAX_KW = 1e6


@dataclass(frozen=True, eq=False)
class LossTable(ByValue):
    """Inverter losses over delivered AC power, in the units of a system file.

    Attributes
    ----------
    nominal_kw : float
        Nominal AC power [kW].
    load : ndarray
        Delivered AC power / nominal, from 0 to 1.
    loss_charge, loss_discharge : ndarray
        Loss / nominal at each load; the value at 0 is the no-load loss of an inverter that is on.
    off_loss : float
        Loss / nominal of an inverter that is off.
    max_error : float
        Largest distance between this table and the points it was reduced from, as a fraction of nominal
        power.
    """

    nominal_kw: float
    load: Array
    loss_charge: Array
    loss_discharge: Array
    off_loss: float
    max_error: float

    def section(self) -> dict[str, Any]:
        """Section ``[inverter]`` of a system file."""
        return {
            "nominal_kw": self.nominal_kw,
            "load": self.load.tolist(),
            "loss_charge": self.loss_charge.tolist(),
            "loss_discharge": self.loss_discharge.tolist(),
            "off_loss": self.off_loss,
        }


def check_nominal(nominal_kw: float) -> None:
    """Raise :class:`InputError` unless ``nominal_kw`` is a power that an inverter can have."""
    if not 0.0 < one_number("nominal_kw", nominal_kw) <= _MAX_KW:
        raise InputError(f"nominal_kw {nominal_kw:g} kW must be in (0, {_MAX_KW:g}] kW")


def check_losses(load: ArrayLike, loss: ArrayLike, direction: Literal["charge", "discharge"]) -> None:
    """Raise ``ValueError`` where more AC power would mean less DC power, or a loss is outside [0, 1)."""
    x, w = np.asarray(load, dtype=np.float64), np.asarray(loss, dtype=np.float64)
    if not ((w >= 0.0) & (w < 1.0)).all():
        raise ValueError(f"{direction} loss must be in [0, 1) of nominal power everywhere")
    dc = x + w if direction == "discharge" else x - w
    if (falling := np.flatnonzero(np.diff(dc) <= 0.0)).size:
        i = int(falling[0])
        raise ValueError(
            f"{direction} loss goes from {w[i]:g} at load {x[i]:g} to {w[i + 1]:g} at load {x[i + 1]:g}, so "
            "that more AC power would mean less DC power; a loss may not change faster than the load"
        )


def table_from_curves(
    charge: Curve | None, discharge: Curve | None, *, nominal_kw: float, off_loss: float, max_error: float
) -> LossTable:
    """Bring both directions onto the fewest knots from 0 to 1 that keep each within ``max_error``.

    A direction without a curve gets the losses of the other at the same AC power.
    """
    check_nominal(nominal_kw)
    if not 0.0 <= one_number("off_loss", off_loss) < 0.1:
        raise InputError(f"off_loss {off_loss:g} must be in [0, 0.1) of nominal power")
    if charge is None and discharge is None:
        raise InputError("inverter table: give values of charge, of discharge, or of both")
    curves = [_completed(curve) for curve in (charge or discharge, discharge or charge) if curve is not None]
    load = np.unique(np.concatenate([curves[0][0], curves[1][0]]))
    rows = np.array([np.interp(load, *curve) for curve in curves])
    kept, error = reduced_knots(load, rows, max_error)
    try:
        check_losses(load[kept], rows[0, kept], "charge")
        check_losses(load[kept], rows[1, kept], "discharge")
    except ValueError as refusal:
        raise InputError(f"inverter table: {refusal}") from refusal
    return LossTable(nominal_kw, load[kept], rows[0, kept], rows[1, kept], off_loss, error)


def _completed(curve: Curve) -> Curve:
    """Sort by AC power, continue to no load and to nominal power."""
    order = np.lexsort((-curve[1], curve[0]))
    load, loss = curve[0][order], curve[1][order]
    # Rows that deliver nothing: the largest of their losses is the no-load loss of an inverter that is on.
    first = int(np.searchsorted(load, 0.0, side="right")) - 1
    load, loss = (np.delete(each, slice(1, first + 1)) for each in (load, loss))
    if load.size < 2:
        raise InputError(f"inverter table: {load.size} rows with power are too few; give at least 2")
    if (repeated := np.flatnonzero(np.diff(load) <= 0.0)).size:
        raise InputError(
            f"inverter table: two rows give the same AC power, {load[repeated[0]]:.6g} of nominal"
        )
    if load[-1] < 1.0 - _MAX_EXTRAPOLATION:
        raise InputError(
            f"inverter table: ends at an AC power of {load[-1]:.3g} of nominal, must reach at least "
            f"{1.0 - _MAX_EXTRAPOLATION:g}; give a smaller nominal_kw or the missing rows"
        )
    if load[0] > 0.0:
        at_zero = loss[0] - load[0] * (loss[1] - loss[0]) / (load[1] - load[0])
        load, loss = np.append(0.0, load), np.append(max(0.0, at_zero), loss)
    if load[-1] < 1.0:
        slope = (loss[-1] - loss[-2]) / (load[-1] - load[-2])
        load, loss = np.append(load, 1.0), np.append(loss, loss[-1] + slope * (1.0 - load[-1]))
    at_full = np.interp(1.0, load, loss)
    below = load < 1.0 - 1e-9
    return np.append(load[below], 1.0), np.append(loss[below], at_full)
