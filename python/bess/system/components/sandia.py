"""Sandia inverter model, as the coefficients of the CEC inverter list give it.

King, Gonzalez, Galbraith, Boyson: Performance Model for Grid-Connected Photovoltaic Inverters, SAND2007-5036
(2007).
"""

from __future__ import annotations

import numpy as np

from bess.arrays import one_number
from bess.errors import InputError
from bess.system.components.loss_table import LossTable, table_from_curves

_POINTS = 201


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
    load = np.linspace(0.0, 1.0, _POINTS)
    ac_w = paco_w * load
    k = paco_w / (a - b) - c * (a - b)
    discriminant = k * k + 4.0 * c * ac_w
    if k <= 0.0 or discriminant.min() < 0.0:
        raise InputError(f"Sandia coefficients: no DC power belongs to every AC power up to {paco_w:g} W")
    dc_w = b + 2.0 * ac_w / (k + np.sqrt(discriminant))
    curve = (load, (dc_w - ac_w) / paco_w)
    return table_from_curves(
        curve, curve, nominal_kw=paco_w / 1000.0, off_loss=pnt_w / paco_w, max_error=max_error
    )
