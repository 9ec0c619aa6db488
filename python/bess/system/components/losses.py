"""Loss tables of inverters from published efficiencies, losses, or coefficients of the Sandia model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from bess.arrays import Array, Flags, number_array, one_number
from bess.errors import InputError
from bess.system.components.loss_table import Curve, LossTable, check_nominal, table_from_curves

Axis = Literal["ac", "dc", "input", "output"]
Direction = Literal["charge", "discharge"]
PowerUnit = Literal["fraction", "percent", "kw", "w"]
LossUnit = Literal["nominal", "nominal-percent", "axis", "axis-percent", "kw", "w"]

_SANDIA_POINTS = 201
_PERCENT_FROM = 2.0  # an efficiency above this can only be meant in per cent


def inverter_from_efficiency(
    power: ArrayLike,
    *,
    nominal_kw: float,
    charge: ArrayLike | None = None,
    discharge: ArrayLike | None = None,
    power_unit: PowerUnit = "fraction",
    axis: Axis = "ac",
    off_loss: float = 0.0,
    max_error: float = 2e-4,
) -> LossTable:
    """Loss table from efficiencies (output power / input power).

    Parameters
    ----------
    power
        Power of each row, in ``power_unit``; any order.
    nominal_kw
        Nominal AC power [kW].
    charge, discharge
        Efficiency of each row, as a fraction or in per cent (detected by magnitude). If only one direction
        is given, the other gets the same loss at the same AC power. At zero power the value is ignored.
    power_unit
        ``fraction`` or ``percent`` of nominal AC power, ``kw`` or ``w``.
    axis
        Which power ``power`` is: ``ac``, ``dc``, ``input`` (DC in discharge, AC in charge) or ``output``.
    off_loss
        Loss of an inverter that is off, as a fraction of nominal power.
    max_error
        Largest error of the reduced table, as a fraction of nominal power.

    Raises
    ------
    InputError
        For an efficiency outside [0, 1] or missing, with its row; for a table that ends more than 10 % of
        nominal power below nominal power.

    Notes
    -----
    The no-load loss is the straight line through the losses at the two smallest powers, continued to 0; it is
    0 if that line ends below. Above the last row, up to 10 %, the line through the last two rows is
    continued.
    """
    x = _per_unit(power, power_unit, nominal_kw, axis)

    def loss_of(eta: Array, direction: Direction) -> Array:
        eta = eta / 100.0 if np.nanmax(eta, initial=0.0) > _PERCENT_FROM else eta
        eta = np.where(x == 0.0, 1.0, eta)  # 0/0
        is_output = _is_output(axis, direction)
        lowest_allowed = "above 0" if is_output else "at least 0"
        allowed = (eta <= 1.0) & ((eta > 0.0) if is_output else (eta >= 0.0))
        _refuse_rows(eta, ~allowed, f"{direction} efficiency", f"{lowest_allowed} and at most 1")
        return x / eta - x if is_output else x - x * eta

    curves = _curves(x, {"charge": charge, "discharge": discharge}, axis, loss_of)
    return table_from_curves(*curves, nominal_kw=nominal_kw, off_loss=off_loss, max_error=max_error)


def inverter_from_loss(
    power: ArrayLike,
    *,
    nominal_kw: float,
    charge: ArrayLike | None = None,
    discharge: ArrayLike | None = None,
    power_unit: PowerUnit = "fraction",
    loss_unit: LossUnit = "nominal",
    axis: Axis = "ac",
    off_loss: float = 0.0,
    max_error: float = 2e-4,
) -> LossTable:
    """Loss table from losses.

    As :func:`inverter_from_efficiency`, but ``charge`` and ``discharge`` are losses in ``loss_unit``:
    fractions of nominal AC power (``nominal``) or of the power of the axis (``axis``), either also in
    ``-percent``, or absolute (``kw``, ``w``). A row at zero power is the no-load loss if its loss is above 0,
    and is ignored otherwise.

    Raises
    ------
    InputError
        The unit is unknown, or the tables are invalid.
    """
    x = _per_unit(power, power_unit, nominal_kw, axis)
    of_nominal = {"nominal": 1.0, "nominal-percent": 0.01, "kw": 1.0 / nominal_kw, "w": 1e-3 / nominal_kw}
    of_axis = {"axis": x, "axis-percent": 0.01 * x}
    if loss_unit not in (*of_nominal, *of_axis):
        raise InputError(f"loss_unit {loss_unit!r}: allowed are {', '.join([*of_nominal, *of_axis])}")
    unit = of_axis[loss_unit] if loss_unit in of_axis else np.full_like(x, of_nominal[loss_unit])

    def loss_of(given: Array, direction: Direction) -> Array:
        loss = given * unit
        _refuse_rows(loss, ~((loss >= 0.0) & (loss < 1.0)), f"{direction} loss / nominal", "in [0, 1)")
        return loss

    curves = _curves(x, {"charge": charge, "discharge": discharge}, axis, loss_of)
    return table_from_curves(*curves, nominal_kw=nominal_kw, off_loss=off_loss, max_error=max_error)


def inverter_from_sandia(
    *,
    paco_w: float,
    pdco_w: float,
    vdco_v: float,
    pso_w: float,
    c0_per_w: float,
    c1_per_v: float,
    c2_per_v: float,
    c3_per_v: float,
    pnt_w: float = 0.0,
    vdc_v: float | None = None,
    max_error: float = 2e-4,
) -> LossTable:
    """Loss table of an inverter of the CEC list.

    The model and the names of its coefficients are those of [1]_.

    The model gives AC power over DC power; with ``y = P_dc - B`` it is the quadratic ``C0' y**2 + k y =
    P_ac``, whose small root is the DC power of a given AC power, and the loss their difference. At no load
    the loss is the self-consumption ``B``. The list describes discharge only; charge gets the same loss at
    the same AC power.

    Parameters
    ----------
    paco_w, pdco_w, vdco_v, pso_w, c0_per_w, c1_per_v, c2_per_v, c3_per_v, pnt_w
        Columns Paco [W], Pdco [W], Vdco [V], Pso [W], C0 [1/W], C1 to C3 [1/V] and Pnt [W] of the list.
    vdc_v
        DC voltage [V]; by default the rated voltage (``vdco_v``).
    max_error
        Largest error of the reduced table, as a fraction of nominal power.

    Raises
    ------
    InputError
        If the coefficients give no efficiency between 0 and 1 somewhere between no load and ``paco_w``.

    References
    ----------
    .. [1] King, D., Gonzalez, S., Galbraith, G., Boyson, W.: Performance model for grid-connected
       photovoltaic inverters. Sandia National Laboratories, SAND2007-5036.
    """
    given = {"Paco": paco_w, "Pdco": pdco_w, "Vdco": vdco_v, "Pso": pso_w, "Pnt": pnt_w}
    given |= {"C0": c0_per_w, "C1": c1_per_v, "C2": c2_per_v, "C3": c3_per_v}
    for name, value in given.items():
        one_number(f"Sandia coefficients: {name}", value)
    if not 0.0 <= pnt_w < 0.1 * paco_w:
        raise InputError(f"Sandia coefficients: Pnt {pnt_w:g} W must be at least 0 and below 10 % of Paco")
    excess_v = 0.0 if vdc_v is None else vdc_v - vdco_v
    a = pdco_w * (1.0 + c1_per_v * excess_v)
    b = pso_w * (1.0 + c2_per_v * excess_v)
    c = c0_per_w * (1.0 + c3_per_v * excess_v)
    if not (np.isfinite([a, b, c, paco_w]).all() and a > paco_w > 0.0 and 0.0 <= b < a):
        raise InputError(
            f"Sandia coefficients: need 0 < Paco < Pdco and 0 <= Pso < Pdco at {vdc_v or vdco_v:g} V, "
            f"not Paco {paco_w:g} W, Pdco {a:g} W, Pso {b:g} W"
        )
    load = np.linspace(0.0, 1.0, _SANDIA_POINTS)
    ac_w = paco_w * load
    k = paco_w / (a - b) - c * (a - b)
    discriminant = k * k + 4.0 * c * ac_w
    if k <= 0.0 or discriminant.min() < 0.0:
        raise InputError(f"Sandia coefficients: some AC power up to {paco_w:g} W has no DC power")
    dc_w = b + 2.0 * ac_w / (k + np.sqrt(discriminant))
    curve = (load, (dc_w - ac_w) / paco_w)
    return table_from_curves(
        curve, curve, nominal_kw=paco_w / 1000.0, off_loss=pnt_w / paco_w, max_error=max_error
    )


def _per_unit(power: ArrayLike, unit: str, nominal_kw: float, axis: str) -> Array:
    check_nominal(nominal_kw)
    scale = {"fraction": 1.0, "percent": 0.01, "kw": 1.0 / nominal_kw, "w": 1e-3 / nominal_kw}
    if unit not in scale:
        raise InputError(f"power_unit {unit!r}: allowed are {', '.join(scale)}")
    if axis not in ("ac", "dc", "input", "output"):
        raise InputError(f"axis {axis!r}: allowed are ac, dc, input, output")
    x = number_array("power", power) * scale[unit]
    if x.ndim != 1:
        raise InputError(f"power must be one list of numbers, not an array of shape {x.shape}")
    _refuse_rows(x, ~(np.isfinite(x) & (x >= 0.0)), "power / nominal", "finite and at least 0")
    return x


def _refuse_rows(values: Array, bad: Flags, name: str, allowed: str) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(f"row {row + 1}: {name} is {values[row]:g}, must be {allowed}")


def _is_output(axis: str, direction: Direction) -> bool:
    return axis in ("output", "ac" if direction == "discharge" else "dc")


def _curves(
    x: Array,
    given: dict[Direction, ArrayLike | None],
    axis: str,
    loss_of: Callable[[Array, Direction], Array],
) -> list[Curve | None]:
    """Return AC power and loss of each direction, None for one without values."""
    curves: list[Curve | None] = []
    for direction, values in given.items():
        if values is None:
            curves.append(None)
            continue
        numbers = number_array(direction, values)
        if numbers.shape != x.shape:
            raise InputError(f"{direction} has {numbers.size} rows, power has {x.size}")
        loss = loss_of(numbers, direction)
        output = x if _is_output(axis, direction) else x - loss
        ac = output if direction == "discharge" else output + loss
        allowed = "at least 0: the loss exceeds the DC power"
        _refuse_rows(ac, ac < 0.0, "discharge AC power / nominal", allowed)
        informative = (x > 0.0) | (loss > 0.0)
        curves.append((ac[informative], loss[informative]))
    return curves
