"""Measured cell tables in the layout of SimSES: OCV over SOC and temperature, hysteresis, resistance.

SOC may be in per cent or a fraction, temperature is in kelvin and stands in the column titles, resistance in
mOhm or Ohm. The result is tables of ``[battery]`` in a system file.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bess.errors import InputError
from bess.system.components.columns import numbers, read_columns
from bess.system.components.knots import reduced_knots
from bess.units import ZERO_CELSIUS_K

_KELVIN = re.compile(r"(?<!\d)([23]\d\d(?:\.\s*\d+)?)\s*K?")
_C_RATE = re.compile(r"(\d+(?:\.\d+)?)\s*C\b")
# Largest value of a table: a small cell has some 0.2 Ohm in the cold, a large one 0.5 mOhm or more.
_OHM_BELOW = 0.25


def read_ocv(
    path: str | Path, *, hysteresis: str | Path | None = None, max_error_v: float = 2e-3
) -> dict[str, Any]:
    """Read OCV, put half the hysteresis on either side, and reduce it to few knots.

    Parameters
    ----------
    path
        Columns ``SOC, OCV``, or for each temperature a pair of columns with the temperature [K] in their
        titles.
    hysteresis
        Columns ``SOC, HystV``: half the gap between charge and discharge [V]. None: no gap.
    max_error_v
        Largest error of the reduced table [V]. A measured curve that falls by no more than this is levelled,
        one that falls more is refused.

    Returns
    -------
    dict
        Table ``[battery.ocv_v]``: soc, temperature_c, charge, discharge.

    Raises
    ------
    InputError
        A column is missing, or a voltage is out of its range or falls with SOC.
    """
    columns = read_columns(path)
    pairs: dict[float, tuple[str, str]] = {}
    socs = [name for name in columns if name.upper().startswith("SOC")]
    for name in (name for name in columns if name.upper().startswith("OCV")):
        kelvin = _kelvin(name)
        soc_name = next((s for s in socs if _kelvin(s) == kelvin), None)
        if soc_name is None:
            raise InputError(f"{path}: column {name!r} has no SOC column of the same temperature")
        pairs[25.0 if kelvin is None else round(kelvin - ZERO_CELSIUS_K, 3)] = (soc_name, name)
    if not pairs:
        raise InputError(f"{path}: no column OCV; columns are {', '.join(list(columns)[:6])}")
    temperatures = sorted(pairs)
    curves = [tuple(numbers(path, columns, name) for name in pairs[t]) for t in temperatures]
    soc = _fraction(path, curves[0][0])
    ocv = np.array([np.interp(soc, _fraction(path, axis), values) for axis, values in curves])
    if not ((ocv > 0.0) & (ocv <= 10.0)).all():
        raise InputError(f"{path}: OCV reaches from {ocv.min():g} to {ocv.max():g} V, must stay in (0, 10] V")
    half = np.zeros_like(soc)
    if hysteresis is not None:
        gap = read_columns(hysteresis)
        if not {"SOC", "HystV"} <= set(gap):
            raise InputError(f"{hysteresis}: needs the columns SOC and HystV, has {', '.join(list(gap)[:6])}")
        half = np.interp(
            soc, _fraction(hysteresis, numbers(hysteresis, gap, "SOC")), numbers(hysteresis, gap, "HystV")
        )
        if not (half >= 0.0).all():
            raise InputError(f"{hysteresis}: HystV reaches {half.min():g} V, must be at least 0 V")
    rows = np.concatenate([ocv + half, ocv - half])
    level = np.maximum.accumulate(rows, axis=1)
    # Two of the knots chosen below may include a whole fall, so its size is part of the allowed error.
    if (level - rows).max() > 2.0 * max_error_v + 2.0 * np.abs(np.diff(half)).max(initial=0.0):
        raise InputError(f"{path}: OCV falls with SOC by {(level - rows).max() * 1000:.1f} mV; must rise")
    kept, _ = reduced_knots(soc, level, max_error_v)
    charge, discharge = np.split(level[:, kept], 2)
    return {
        "soc": soc[kept].tolist(),
        "temperature_c": temperatures,
        "charge": charge.tolist(),
        "discharge": discharge.tolist(),
    }


def read_resistance(path: str | Path, *, control_c_rate: float) -> dict[str, Any]:
    """Read resistance over SOC, temperature and, if the columns name it, C-rate, for both directions.

    Parameters
    ----------
    path
        Column ``SOC`` and columns ``R_Ch(...)`` and ``R_DCh(...)`` with temperature [K] and C-rate in their
        titles. A table that stays below 0.25 is in Ohm, any other in mOhm.
    control_c_rate
        C-rate at which the controller reads the table.

    Returns
    -------
    dict
        Table ``[battery.resistance_table]``.

    Raises
    ------
    InputError
        A column is missing, its title has no temperature, or a resistance is out of its range.
    """
    columns = read_columns(path)
    if "SOC" not in columns:
        raise InputError(f"{path}: no column SOC; columns are {', '.join(list(columns)[:6])}")
    soc = _fraction(path, numbers(path, columns, "SOC"))
    values: dict[tuple[str, float, float], NDArray[np.float64]] = {}
    for name in columns:
        if not name.startswith(("R_Ch", "R_DCh")):
            continue
        kelvin, rate = _kelvin(name), _C_RATE.search(name)
        if kelvin is None:
            raise InputError(f"{path}: the title of column {name!r} has no temperature in kelvin")
        direction = "charge_mohm" if name.startswith("R_Ch") else "discharge_mohm"
        key = (direction, float(rate.group(1)) if rate else 1.0, round(kelvin - ZERO_CELSIUS_K, 3))
        values[key] = numbers(path, columns, name)
    rates = sorted({rate for _, rate, _ in values})
    temperatures = sorted({temperature for _, _, temperature in values})
    wanted = [(d, r, t) for d in ("charge_mohm", "discharge_mohm") for r in rates for t in temperatures]
    if not values or (absent := [key for key in wanted if key not in values]):
        raise InputError(f"{path}: no resistance column for {absent[0] if values else 'R_Ch and R_DCh'}")
    smallest, largest = (float(f(list(values.values()))) for f in (np.min, np.max))
    if not (smallest > 0.0 and largest < 1e3):
        raise InputError(f"{path}: resistances reach from {smallest:g} to {largest:g}, must be in (0, 1000)")
    milli = 1000.0 if largest < _OHM_BELOW else 1.0
    return {
        "soc": soc.tolist(),
        "temperature_c": temperatures,
        "c_rate": rates,
        "control_c_rate": control_c_rate,
        **{
            d: [[(milli * values[d, r, t]).tolist() for t in temperatures] for r in rates]
            for d in ("charge_mohm", "discharge_mohm")
        },
    }


def _kelvin(title: str) -> float | None:
    found = _KELVIN.search(title)
    return float(found.group(1).replace(" ", "")) if found else None


def _fraction(path: str | Path, soc: NDArray[np.float64]) -> NDArray[np.float64]:
    soc = soc / 100.0 if soc.max(initial=0.0) > 1.5 else soc
    if soc.size < 2:
        raise InputError(f"{path}: has {soc.size} rows; a table over SOC needs at least 2")
    if not ((soc >= 0.0) & (soc <= 1.0)).all() or not (np.diff(soc) > 0.0).all():
        raise InputError(f"{path}: SOC must ascend within 0 to 1 (or 0 to 100 %)")
    return soc
