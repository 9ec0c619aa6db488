"""Predict temperatures of a cell that no fit here had seen: ``python docs/make_second_cell.py``, a minute.

Discharges of an Enertech pouch cell at 0.5C, 1C and 2C, whose temperatures and entropy are published. The
figures are stored in ``_cases/second-cell.json``; the table of ``validation-thermal.md`` is made of them.
"""

import json
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from tables import markdown_table

import bess

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent / "examples"))

from thermal_validation import ENTROPY_SOC, Cell, one_cell  # noqa: E402

MEASURED = DOCS / "_cases" / "second-cell.json"
TABLE = DOCS / "_cases" / "second-cell.md"
RATES = ("0.5C", "1C", "2C")
KINDS = ("none", "published", "fitted")
AIR_C = 25.0
STEP_S = 10.0
REST_S = 1800.0
SLOW = 0.1
"""C-rate whose voltage stands for the open-circuit voltage, less what its current drops."""
GRAPHITE_FULL, COBALT_FULL, COBALT_EMPTY = 0.84, 0.435, 0.99
"""Lithium per site of either electrode, of the published parameter set; it ends where the cathode is full."""

Array = NDArray[np.float64]
Entropy = tuple[Array, Array] | None
"""SOC and entropy coefficient [mV/K]."""


@cache
def measured() -> dict[str, Any]:
    """Published figures: voltage over SOC by C-rate, and temperature rise every minute."""
    figures: dict[str, Any] = json.loads(MEASURED.read_text(encoding="utf-8"))
    return figures


def cell() -> Cell:
    """Size and mass as in the published parameter set."""
    size = measured()["cell"]
    return Cell("Enertech cell", measured()["capacity_ah"], **size)


def current_a(rate: str) -> float:
    """Current of a test; C-rates are those of the nominal 2.28 Ah."""
    return float(rate.removesuffix("C")) * 2.28


def voltage_v(rate: str) -> tuple[Array, Array]:
    """SOC and voltage of a discharge, as far down as it went."""
    soc, volts = np.array(measured()["soc"]), np.array(measured()["voltage_v"][rate], dtype=float)
    known = np.isfinite(volts)
    return soc[known], volts[known]


def electrical(rates: Sequence[str]) -> tuple[tuple[Array, Array], dict[float, Array]]:
    """OCV, and resistance [mOhm] by C-rate: both from the difference to the discharge at 0.1C."""
    soc, slow = np.array(measured()["soc"]), voltage_v("0.1C")
    slow_a = SLOW * 2.28
    ohms = {}
    for rate in rates:
        known, volts = voltage_v(rate)
        ohm = (np.interp(known, *slow) - volts) / (current_a(rate) - slow_a)
        ohms[current_a(rate) / measured()["capacity_ah"]] = 1000.0 * np.interp(soc, known, ohm)
    least = min(ohms)
    ocv = np.interp(soc, *slow) + slow_a * ohms[least] / 1000.0
    return (soc, np.maximum.accumulate(ocv)), ohms


def published_entropy_mv_k(soc: Array) -> Array:
    """Entropy coefficient of the cell [mV/K]: cathode less anode, as Ai et al. (2020) give them."""
    x = soc * GRAPHITE_FULL
    y = COBALT_EMPTY + soc * (COBALT_FULL - COBALT_EMPTY)
    cathode = np.polyval(
        [-3.20392657, 14.5719049, -27.9047599, 29.1744564, -17.992018, 6.54799331, -1.30382445, 0.109667298],
        y,
    )
    above = [-16515.05308, 38379.18127, -37147.8947, 19329.7549, -5812.278127, 1004.911008, -91.79325798]
    below = [165705.8597, -385821.1607, 374577.3152, -195881.6488, 59431.3, -10481.80419, 1017.234804]
    anode = np.polyval([*above, 3.299265709, 0.005269056], x) / np.polyval([*below, -48.09287227, 1.0], x)
    return np.asarray(1000.0 * cathode - anode)


def predict(system: bess.System, rate: str) -> tuple[Array, Array]:
    """Time [s] and temperature rise [K] in the plant, driven by the measured power, then at rest."""
    amps, capacity_ah = current_a(rate), measured()["capacity_ah"]
    end_s = measured()["discharge_s"][rate]
    start_s = STEP_S * np.arange(int((end_s + REST_S) // STEP_S))
    soc = 1.0 - amps * (start_s + STEP_S / 2.0) / 3600.0 / capacity_ah
    power_kw = np.where(start_s < end_s - STEP_S, amps * np.interp(soc, *voltage_v(rate)) / 1000.0, 0.0)
    plant = bess.Plant(system, bess.State([1.0], [AIR_C + rise_k(rate)[1][0]]), plant_step_s=STEP_S)
    flows = plant.run(power_kw[:, None], STEP_S, ambient_c=np.full(power_kw.size, AIR_C))
    return start_s + STEP_S, flows.temperature_c[:, 0] - AIR_C


def rise_k(rate: str) -> tuple[Array, Array]:
    """Time [s] and measured temperature rise [K]."""
    rise = np.array(measured()["rise_k"][rate])
    return 60.0 * np.arange(rise.size), rise


def errors_k(system: bess.System, rate: str) -> Array:
    """Predicted less measured rise [K], every minute of the discharge and half an hour after."""
    time_s, rise = rise_k(rate)
    return np.interp(time_s[1:], *predict(system, rate)) - rise[1:]


def fit(rates: Sequence[str], kind: str) -> tuple[Array, Entropy]:
    """Specific heat and film coefficient that meet ``rates`` best, and the entropy they were fitted with.

    ``kind``: reversible heat is left out, of the published entropy, or its coefficient is fitted at six SOC.
    """

    soc = np.array(measured()["soc"])
    published = (soc, published_entropy_mv_k(soc))

    def entropy_of(values: Array) -> Entropy:
        return {"none": None, "published": published, "fitted": (ENTROPY_SOC, values[2:])}[kind]

    def residual(values: Array) -> Array:
        system = system_of(rates, values[:2], entropy_of(values))
        errors = [errors_k(system, rate) for rate in rates]
        # A test that says little of the entropy leaves it small.
        return np.concatenate([*(error / np.sqrt(error.size) for error in errors), 0.02 * values[2:]])

    unknown = ENTROPY_SOC.size if kind == "fitted" else 0
    start = np.concatenate([np.log([1000.0, 30.0]), np.full(unknown, -0.1)])
    found = least_squares(residual, start, diff_step=1e-3).x
    return np.exp(found[:2]), entropy_of(found)


def system_of(rates: Sequence[str], heat_film_log: Array, entropy: Entropy) -> bess.System:
    """The cell with OCV and resistance of ``rates``."""
    ocv, milliohm = electrical(rates)
    heat, film = np.exp(heat_film_log)
    return one_cell(
        cell(),
        ocv,
        milliohm,
        specific_heat_j_kgk=float(heat),
        film_w_m2k=float(film),
        nodes=2,  # nothing varies along such a cell
        plant_step_s=STEP_S,
        entropy=entropy,
    )


def rmse_k(thermal: Array, entropy: Entropy) -> dict[str, float]:
    """Root mean square error of each test, with the resistance of that test."""
    return {
        rate: float(np.sqrt(np.mean(errors_k(system_of([rate], np.log(thermal), entropy), rate) ** 2)))
        for rate in RATES
    }


def table() -> str:
    """One row for each test that was trained on and each kind of reversible heat."""
    rows = [["trained on", "reversible heat", "c_p [J/kgK]", "film [W/m²K]", *RATES]]
    for rate in RATES:
        for kind in KINDS:
            thermal, entropy = fit([rate], kind)
            heat, film = thermal
            errors = rmse_k(thermal, entropy)
            shown = [f"{errors[each]:.2f}{'*' if each == rate else ''}" for each in RATES]
            rows.append([rate, kind, f"{heat:.0f}", f"{film:.1f}", *shown])
    return markdown_table(rows)


def main() -> None:
    """Compute and write."""
    TABLE.write_text(f"<!-- written by docs/make_second_cell.py -->\n\n{table()}", encoding="utf-8")


if __name__ == "__main__":
    main()
