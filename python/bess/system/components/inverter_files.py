"""Inverter files; the layout is detected from the columns."""

from functools import partial
from pathlib import Path

import numpy as np

from bess.errors import InputError, listed
from bess.system.components.columns import Columns, columns_of, number, numbers
from bess.system.components.loss_table import Curve, LossTable, table_from_curves
from bess.system.components.losses import Axis, PowerUnit, inverter_from_efficiency, inverter_from_sandia
from bess.units import WATTS_PER_KW

_MAX_ERROR = 5e-5
_SANDIA = {
    "Paco": "paco_w",
    "Pdco": "pdco_w",
    "Vdco": "vdco_v",
    "Pso": "pso_w",
    "C0": "c0_per_w",
    "C1": "c1_per_v",
    "C2": "c2_per_v",
    "C3": "c3_per_v",
    "Pnt": "pnt_w",
}
"""Columns of the CEC list, and the arguments of :func:`inverter_from_sandia`."""
_BSLIB = (
    "ID",
    "P_AC2BAT_in [W]",
    "P_BAT2AC_out [W]",
    *(f"AC2BAT_{letter}_in" for letter in "abc"),
    *(f"BAT2AC_{letter}_out" for letter in "abc"),
)


def read_inverter(
    path: str | Path,
    *,
    model: str | None = None,
    nominal_kw: float | None = None,
    power_unit: PowerUnit | None = None,
    axis: Axis = "ac",
    max_error: float = _MAX_ERROR,
) -> LossTable:
    """Read an inverter from a file and reduce it to the loss table of a system file.

    The reader recognises the CEC list with Sandia coefficients (as pvlib and SAM ship it), the inverter and
    storage list of bslib, and plain efficiency tables. Plain tables have a column of charge and a column of
    discharge efficiency, or only one efficiency column, which then holds for both directions; a power column,
    or none if the rows divide 0 to 100 % of nominal power evenly.

    Parameters
    ----------
    path
        Text table (``,``, ``;`` or tab) or Parquet.
    model
        Name, or a part of it that occurs once, in a file of several inverters.
    nominal_kw
        Nominal AC power [kW]. Required for plain tables; entries of the lists have their own.
    power_unit, axis
        As in :func:`inverter_from_efficiency`, for plain tables. Power that stays below 1.2 is taken as a
        fraction; for anything else the unit must be given.
    max_error
        Largest error of the reduced table, as a fraction of nominal power.

    Raises
    ------
    InputError
        If the file has none of these shapes, names several models, or holds values that no inverter can have.
    """
    with columns_of(path) as columns:
        if columns.keys() >= _SANDIA.keys():
            row = _row_of(columns, model)
            values = {ours: number(columns, name, row) for name, ours in _SANDIA.items()}
            return inverter_from_sandia(**values, max_error=max_error)
        if columns.keys() >= {*_BSLIB}:
            return _from_bslib_row(columns, _row_of(columns, model), max_error)
        return _from_plain(columns, nominal_kw, power_unit, axis, max_error)


def _row_of(columns: Columns, model: str | None) -> int:
    """Return the row of the inverter with this name, or the only one with this part of a name."""
    named = [columns[key] for key in ("Name", "", "Model (PE)", "ID") if key in columns]
    fitting = (names for names in named if model is None or any(model in name for name in names))
    names = next(fitting, next(iter(columns.values())))
    found = [name for name in names if name == model]
    found = found or [name for name in names if model is None or model in name]
    if len(set(found)) != 1:
        some = listed(sorted(set(found or names)))
        raise InputError(
            f"model {model!r} fits {len(set(found))} of {len(set(names))} inverters; choose one of {some}"
        )
    return names.index(found[0])


def _from_bslib_row(columns: Columns, row: int, max_error: float) -> LossTable:
    """Loss ``a x**2 + b x + c`` [W] over AC power ``x`` / the direction's nominal AC power."""
    value = partial(number, columns, row=row, gaps=True)
    charge_w, discharge_w = value("P_AC2BAT_in [W]"), value("P_BAT2AC_out [W]")
    if not discharge_w > 0.0 or charge_w <= 0.0:
        raise InputError(f"{columns['ID'][row]!r} has no battery inverter (no BAT2AC values)")
    nominal_w = float(np.nanmin([charge_w, discharge_w]))
    load = np.linspace(0.0, 1.0, 201)

    def curve(column: str, direction_w: float) -> Curve | None:
        a, b, c = (value(column.format(letter)) for letter in "abc")
        x = load * nominal_w / direction_w
        return (load, (a * x * x + b * x + c) / nominal_w) if np.isfinite([a, b, c]).all() else None

    return table_from_curves(
        curve("AC2BAT_{}_in", charge_w),
        curve("BAT2AC_{}_out", discharge_w),
        nominal_kw=nominal_w / WATTS_PER_KW,
        off_loss=0.0,
        max_error=max_error,
    )


def _from_plain(
    columns: Columns,
    nominal_kw: float | None,
    power_unit: PowerUnit | None,
    axis: Axis,
    max_error: float,
) -> LossTable:
    if nominal_kw is None:
        raise InputError("a plain efficiency table does not contain the nominal power; give nominal_kw")
    words = {name: name.lower() for name in columns}
    discharging = [name for name, word in words.items() if "discharg" in word or "dch" in word]
    charging = [name for name, word in words.items() if "charg" in word and name not in discharging]
    efficiencies = {*charging[:1], *discharging[:1]}
    others = [name for name in columns if name not in efficiencies and "loss" not in words[name]]
    if not efficiencies:
        if len(columns) != 2:
            raise InputError(f"no inverter file of a known shape; columns are {listed(columns)}")
        others, discharging = list(columns)[:1], list(columns)[1:]
    rows = len(next(iter(columns.values())))
    power = numbers(columns, others[0]) if others else np.linspace(0.0, 1.0, rows)
    if power_unit is None:
        if not power.max() <= 1.2:
            raise InputError(f"power reaches {power.max():g}; give power_unit (fraction, percent, kw or w)")
        power_unit = "fraction"
    return inverter_from_efficiency(
        power,
        charge=numbers(columns, charging[0], gaps=True) if charging else None,
        discharge=numbers(columns, discharging[0], gaps=True) if discharging else None,
        nominal_kw=nominal_kw,
        power_unit=power_unit,
        axis=axis,
        max_error=max_error,
    )
