"""Measured cell tables in the layout of SimSES: OCV over SOC and temperature, hysteresis, resistance.

SOC may be in per cent or a fraction, temperature is in kelvin and stands in the column titles, resistance in
mOhm or Ohm. The result is tables of ``[battery]`` in a system file.
"""

import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np

from bess.arrays import Array
from bess.errors import InputError, listed
from bess.system.components.columns import Columns, columns_of, numbers
from bess.system.components.knots import reduced_knots
from bess.units import ZERO_CELSIUS_K

_KELVIN = re.compile(r"(?<!\d)([23]\d\d(?:\.\s*\d+)?)\s*K?")
_C_RATE = re.compile(r"(\d+(?:\.\d+)?)\s*C\b")
_DIRECTIONS = {"R_Ch": "charge_mohm", "R_DCh": "discharge_mohm"}
"""Tables by the beginning of the titles of their columns."""
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
    half_gap = None if hysteresis is None else _half_gap(hysteresis)
    with columns_of(path) as columns:
        socs = [name for name in columns if name.upper().startswith("SOC")]
        curves: dict[float, tuple[Array, Array]] = {}
        for name in (name for name in columns if name.upper().startswith("OCV")):
            kelvin = _kelvin(name)
            soc_name = next((s for s in socs if _kelvin(s) == kelvin), None)
            if soc_name is None:
                raise InputError(f"column {name!r} has no SOC column of the same temperature")
            curve = _soc(columns, soc_name), numbers(columns, name)
            curves[25.0 if kelvin is None else round(kelvin - ZERO_CELSIUS_K, 3)] = curve
        if not curves:
            raise InputError(f"no column OCV; columns are {listed(columns)}")
        temperatures = sorted(curves)
        soc, _ = curves[temperatures[0]]
        ocv = np.array([np.interp(soc, *curves[temperature]) for temperature in temperatures])
        if not ((ocv > 0.0) & (ocv <= 10.0)).all():
            raise InputError(f"OCV reaches from {ocv.min():g} to {ocv.max():g} V, must stay in (0, 10] V")
        half = np.zeros_like(soc) if half_gap is None else np.interp(soc, *half_gap)
        rows = np.concatenate([ocv + half, ocv - half])
        level = np.maximum.accumulate(rows, axis=1)
        # Two of the knots chosen below may include a whole fall, so its size is part of the allowed error.
        if (level - rows).max() > 2.0 * max_error_v + 2.0 * np.abs(np.diff(half)).max(initial=0.0):
            raise InputError(f"OCV falls with SOC by {(level - rows).max() * 1000:.1f} mV; must rise")
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
    with columns_of(path) as columns:
        soc = _soc(columns, "SOC")
        values: dict[tuple[str, float, float], Array] = {}
        for name in columns:
            direction = next((each for start, each in _DIRECTIONS.items() if name.startswith(start)), None)
            if direction is None:
                continue
            kelvin, rate = _kelvin(name), _C_RATE.search(name)
            if kelvin is None:
                raise InputError(f"the title of column {name!r} has no temperature in kelvin")
            key = (direction, float(rate.group(1)) if rate else 1.0, round(kelvin - ZERO_CELSIUS_K, 3))
            values[key] = numbers(columns, name)
        rates = sorted({rate for _, rate, _ in values})
        temperatures = sorted({temperature for _, _, temperature in values})
        wanted = itertools.product(_DIRECTIONS.values(), rates, temperatures)
        if not values or (absent := [key for key in wanted if key not in values]):
            raise InputError(f"no resistance column for {absent[0] if values else 'R_Ch and R_DCh'}")
        every = np.array(list(values.values()))
        if not (every.min() > 0.0 and every.max() < 1e3):
            raise InputError(
                f"resistances reach from {every.min():g} to {every.max():g}, must be in (0, 1000)"
            )
    milli = 1000.0 if every.max() < _OHM_BELOW else 1.0
    tables = {
        direction: [[(milli * values[direction, r, t]).tolist() for t in temperatures] for r in rates]
        for direction in _DIRECTIONS.values()
    }
    axes = {"soc": soc.tolist(), "temperature_c": temperatures, "c_rate": rates}
    return {**axes, "control_c_rate": control_c_rate, **tables}


def _half_gap(path: str | Path) -> tuple[Array, Array]:
    """Return half the gap between charge and discharge [V] over SOC."""
    with columns_of(path) as columns:
        soc, half = _soc(columns, "SOC"), numbers(columns, "HystV")
        if not (half >= 0.0).all():
            raise InputError(f"HystV reaches {half.min():g} V, must be at least 0 V")
    return soc, half


def _kelvin(title: str) -> float | None:
    found = _KELVIN.search(title)
    return float(found.group(1).replace(" ", "")) if found else None


def _soc(columns: Columns, name: str) -> Array:
    """Return a column of SOC, in per cent or a fraction, as a fraction."""
    soc = numbers(columns, name)
    soc = soc / 100.0 if soc.max(initial=0.0) > 1.5 else soc
    if soc.size < 2:
        raise InputError(f"has {soc.size} rows; a table over SOC needs at least 2")
    if not ((soc >= 0.0) & (soc <= 1.0)).all() or not (np.diff(soc) > 0.0).all():
        raise InputError("SOC must ascend within 0 to 1 (or 0 to 100 %)")
    return soc
