"""Validate the plant's thermal model on measured discharges of a Nissan Leaf cell.

One cell in still air is described as a system of one string and run through the plant with the measured
electrical power and the measured air temperature. Heat capacity and heat transfer are fitted to the
temperatures of the training tests; the temperatures of the other tests are then predicted without a look at
them. OCV and resistance come from current and voltage: of the test itself ("plant"), or of the training tests
only ("strict", where nothing but power and air temperature of the test is used). A plain lumped model with a
constant resistance is fitted for comparison.

    python examples/thermal_validation.py DATA                       # all hold-out combinations
    python examples/thermal_validation.py DATA --fit 1 2 --predict CURRENT.csv TEMPERATURE.lvm

DATA is a folder with the files of zenodo 2580327 (leaf_cell-discharge-bitrode-1c.csv and so on).
"""

from __future__ import annotations

import argparse
import gzip
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

import bess

STEP_S = 3.0  # rate of the thermocouples
CAPACITY_AH = 31.0  # a little above the 30.35 Ah between the voltage limits, so that no SOC limit binds
FULL_SOC = 0.99
FULL_V = 4.19  # at rest after a full charge
MASS_KG = 0.799
SURFACE_M2 = 0.0676
SOC = np.linspace(0.0, 1.0, 41)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measurement:
    """One test, every 3 s, as long as the thermocouples were read; ``whole_log`` goes on to the tester's end.

    Current is positive in discharge; the temperature is the mean of three thermocouples on the cell.
    """

    name: str
    current_a: Array
    voltage_v: Array
    soc: Array
    sensors_c: Array  # (3, n)
    air_c: Array
    whole_log: tuple[Array, Array, Array]  # current, voltage, soc

    @property
    def temperature_c(self) -> Array:
        return np.asarray(self.sensors_c.mean(axis=0))

    @property
    def c_rate(self) -> float:
        return float(np.median(self.current_a[self.current_a > 1.0]) / CAPACITY_AH)


def read(current: Path, temperature: Path) -> Measurement:
    """Read a battery tester's log and the thermocouples beside it: four columns, the last one in the air."""
    log = pd.read_csv(current)
    opened = gzip.open if temperature.suffix == ".gz" else open
    with opened(temperature, "rt") as file:
        couples = np.genfromtxt(file, delimiter="\t")[:, -4:].T
    logged_s = log["Time(s)"].to_numpy()
    time_s = np.arange(logged_s[0], logged_s[-1], STEP_S)
    amps = -np.interp(time_s, logged_s, log["Current(A)"].to_numpy())
    volts = np.interp(time_s, logged_s, log["Voltage(V)"].to_numpy())
    used_ah = np.cumsum(amps) * STEP_S / 3600.0
    soc = FULL_SOC - (used_ah - used_ah.min()) / CAPACITY_AH
    read_s = STEP_S * np.arange(couples.shape[1])
    n = int(np.searchsorted(time_s, read_s[-1], side="right"))
    couples = np.array([np.interp(time_s[:n], read_s, row) for row in couples])
    return Measurement(
        name=current.stem.rsplit("-", 1)[-1],
        current_a=amps[:n],
        voltage_v=volts[:n],
        soc=soc[:n],
        sensors_c=couples[:3],
        air_c=couples[3],
        whole_log=(amps, volts, soc),
    )


def electrical(tests: Sequence[Measurement]) -> tuple[Array, Array]:
    """OCV [V] (one curve) and resistance [mOhm] (one row per test) over SOC.

    At equal SOC the terminal voltage in charge and in discharge differ by ``R (I_charge + I_discharge)``.
    """
    ocvs, resistances = [], []
    for test in tests:
        amps, _, _ = test.whole_log
        charge_a, discharge_a = np.median(amps[amps < -1.0]), np.median(amps[amps > 1.0])
        charge_v = _over_soc(test, np.abs(amps - charge_a) < -0.02 * charge_a)
        discharge_v = _over_soc(test, np.abs(amps - discharge_a) < 0.02 * discharge_a)
        ohm = (charge_v - discharge_v) / (discharge_a - charge_a)
        known = np.isfinite(ohm)
        resistances.append(1000.0 * np.interp(SOC, SOC[known], ohm[known]))
        ocv = (discharge_v + ohm * discharge_a)[known]
        ocvs.append(np.interp(SOC, np.append(SOC[known], 1.0), np.append(ocv, FULL_V)))
    return np.maximum.accumulate(np.mean(ocvs, axis=0)), np.array(resistances)


def has_charge(test: Measurement) -> bool:
    """Whether the tester's log has a charge as well, without which resistance cannot be found."""
    return bool((test.whole_log[0] < -1.0).any())


def _over_soc(test: Measurement, chosen: NDArray[np.bool_]) -> Array:
    _, volts, soc = test.whole_log
    order = np.argsort(soc[chosen])
    return np.interp(SOC, soc[chosen][order], volts[chosen][order], left=np.nan, right=np.nan)


def cell_system(
    tests: Sequence[Measurement], *, specific_heat_j_kgk: float, film_w_m2k: float, nodes: int = 8
) -> bess.System:
    """One cell behind an inverter without losses, air on both faces, conduction along the cell."""
    ocv, milliohm = electrical(tests)
    order = np.argsort([test.c_rate for test in tests])
    table = milliohm[order][:, None, :]
    length_m, volume_m3 = 0.261, 0.261 * 0.216 * 0.0079
    document = {
        "system": {"n_strings": 1},
        "battery": {
            "cells_series": 1,
            "cells_parallel": 1,
            "cell_capacity_ah": CAPACITY_AH,
            "cell_mass_kg": MASS_KG,
            "ocv_v": {"soc": SOC, "charge": ocv, "discharge": ocv},
            "resistance_table": {
                "soc": SOC,
                "temperature_c": [25.0],
                "c_rate": [tests[i].c_rate for i in order],
                "control_c_rate": 1.0,
                "charge_mohm": table,
                "discharge_mohm": table,
            },
        },
        "inverter": {
            "nominal_kw": 1.0,
            "load": [0.0, 1.0],
            "loss_charge": [0.0, 0.0],
            "loss_discharge": [0.0, 0.0],
        },
        "derating": {
            "start_c": 100.0,
            "stop_c": 120.0,
            "kp_per_k": 0.0,
            "ki_per_k_step": 0.0,
            "temperature_c": [100.0],
            "factor": [1.0],
        },
        "thermal": {
            "spatial": {
                "packs_per_string": 1,
                "length_m": length_m,
                "nodes": nodes,
                "section_m2": volume_m3 / length_m,
                "width_m": SURFACE_M2 / length_m,
                "density_kg_m3": MASS_KG / volume_m3,
                "specific_heat_j_kgk": specific_heat_j_kgk,
                "conductivity_w_mk": 20.0,
                "lateral_u_w_m2k": film_w_m2k,
                "end_u_w_m2k": 0.0,
                "air_flow_kg_s": 1.0,  # still air: the cell does not heat what it stands in
                "air_cp_j_kgk": 1006.0,
            },
            "lumped": {"k1_k_per_j": 1.0 / (MASS_KG * specific_heat_j_kgk), "k2_per_s": 1e-3},
        },
        "control": {"plant_step_s": STEP_S},
    }
    return bess.System(document, name="Leaf cell")


def predict(system: bess.System, test: Measurement) -> Array:
    """Mean temperature of the cell in the plant [degC], driven by the measured power and air temperature."""
    power_kw = test.current_a * test.voltage_v / 1000.0
    start = bess.State(soc=test.soc[:1], temperature_c=test.temperature_c[:1])
    plant = bess.Plant(system, start, plant_step_s=STEP_S)
    temperature = [test.temperature_c[:1]]
    # Power integrates to a slightly other charge than current; each half cycle starts at the counted SOC.
    turns = np.flatnonzero(np.diff(np.sign(np.where(np.abs(test.current_a) > 0.5, test.current_a, 0.0)))) + 1
    for first, last in zip(np.append(0, turns), np.append(turns, power_kw.size), strict=True):
        plant.restore(replace(plant.snapshot(), soc=np.clip(test.soc[first : first + 1], 0.0, 1.0)))
        flows = plant.run(power_kw[first:last, None], STEP_S, ambient_c=test.air_c[first:last])
        temperature.append(flows.temperature_c[:, 0])
    return np.concatenate(temperature)[:-1]


def fit_plant(tests: Sequence[Measurement]) -> bess.System:
    """Specific heat and film coefficient that meet the temperatures of ``tests`` best."""

    def residual(logs: Array) -> Array:
        system = cell_system(tests, specific_heat_j_kgk=np.exp(logs[0]), film_w_m2k=np.exp(logs[1]))
        errors = [predict(system, test) - test.temperature_c for test in tests]
        return np.concatenate([error / np.sqrt(error.size) for error in errors])

    best = np.exp(least_squares(residual, np.log([1600.0, 15.0]), diff_step=1e-3).x)
    return cell_system(tests, specific_heat_j_kgk=float(best[0]), film_w_m2k=float(best[1]))


def lumped(parameters: Array, test: Measurement) -> Array:
    """``C dT/dt = I^2 R - hA (T - T_air)`` with constant R; parameters are R/C [K/(s A^2)] and hA/C [1/s]."""
    heating, cooling = parameters
    drive = STEP_S * (heating * test.current_a**2 + cooling * test.air_c)
    drive = np.append(test.temperature_c[0], drive[:-1])
    return np.asarray(lfilter([1.0], [1.0, STEP_S * cooling - 1.0], drive))


def fit_lumped(tests: Sequence[Measurement]) -> Array:
    """Both parameters of the plain lumped model."""

    def residual(logs: Array) -> Array:
        errors = [lumped(np.exp(logs), test) - test.temperature_c for test in tests]
        return np.concatenate([error / np.sqrt(error.size) for error in errors])

    return np.asarray(np.exp(least_squares(residual, np.log([3e-6, 1e-3])).x))


def rmse(predicted: Array, test: Measurement) -> float:
    """Root mean square error [K] in the discharges and half an hour after each."""
    near = np.convolve(test.current_a > 1.0, np.ones(round(1800 / STEP_S)))[: predicted.size] > 0.5
    return float(np.sqrt(np.mean((predicted - test.temperature_c)[near] ** 2)))


def leaf_tests(folder: Path) -> list[Measurement]:
    """The tests at 1C, 2C and 3C."""
    tests = []
    for rate in ("1c", "2c", "3c"):
        temperature = next(folder.glob(f"leaf_cell-discharge-temperature-{rate}.lvm*"))
        tests.append(read(folder / f"leaf_cell-discharge-bitrode-{rate}.csv", temperature))
    return tests


def with_electrics_of(fitted: bess.System, test: Measurement) -> bess.System:
    """The thermal parameters of a fitted cell with OCV and resistance of ``test``."""
    spatial = fitted.strings[0].thermal.spatial
    return cell_system(
        [test], specific_heat_j_kgk=spatial.specific_heat_j_kgk, film_w_m2k=spatial.lateral_u_w_m2k
    )


def hold_out_table(tests: Sequence[Measurement]) -> pd.DataFrame:
    """RMSE [K] of every test for every choice of training tests; ``*`` marks those that were trained on."""
    rows = {}
    for size in range(1, len(tests) + 1):
        for chosen in combinations(tests, size):
            system, plain = fit_plant(chosen), fit_lumped(chosen)
            spatial = system.strings[0].thermal.spatial
            row = {"c_p": f"{spatial.specific_heat_j_kgk:.0f}", "film": f"{spatial.lateral_u_w_m2k:.1f}"}
            for test in tests:
                mark = "*" if test in chosen else ""
                predictions = {
                    "plant": predict(with_electrics_of(system, test), test),
                    "strict": predict(system, test),
                    "lumped": lumped(plain, test),
                }
                row |= {f"{k} {test.name}": f"{rmse(v, test):.2f}{mark}" for k, v in predictions.items()}
            rows["+".join(test.name for test in chosen)] = row
    return pd.DataFrame(rows).T


def reversible_heat(system: bess.System, tests: Sequence[Measurement]) -> tuple[Array, list[float]]:
    """Fit ``T dU/dT`` [V], which the plant has not, at six SOC knots to its errors; and the RMSE left."""
    spatial = system.strings[0].thermal.spatial
    capacity_j_k = MASS_KG * spatial.specific_heat_j_kgk
    cooling = spatial.lateral_u_w_m2k * SURFACE_M2 / capacity_j_k
    knots = np.linspace(0.0, 1.0, 6)
    columns, errors = [], []
    for test in tests:
        hats = np.array([np.interp(test.soc, knots, row) for row in np.eye(knots.size)])
        heating = -STEP_S / capacity_j_k * test.current_a * hats
        columns.append(lfilter([0.0, 1.0], [1.0, STEP_S * cooling - 1.0], heating).T)
        errors.append(test.temperature_c - predict(with_electrics_of(system, test), test))
    weights = [1.0 / np.sqrt(error.size) for error in errors]
    volts = np.linalg.lstsq(
        np.concatenate([w * c for w, c in zip(weights, columns, strict=True)]),
        np.concatenate([w * e for w, e in zip(weights, errors, strict=True)]),
    )[0]
    left = [
        rmse(test.temperature_c - error + column @ volts, test)
        for test, column, error in zip(tests, columns, errors, strict=True)
    ]
    return volts, left


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--fit", nargs="+", type=int, default=[1, 2, 3], metavar="RATE")
    parser.add_argument("--predict", nargs=2, type=Path, metavar=("CURRENT", "TEMPERATURE"))
    arguments = parser.parse_args()
    tests = leaf_tests(arguments.data)
    if arguments.predict is None:
        print(hold_out_table(tests).to_string())
        system = fit_plant(tests)
        for test in tests:
            predicted = predict(with_electrics_of(system, test), test)
            sensors = [rmse(predicted - row + test.temperature_c, test) for row in test.sensors_c]
            spread = np.ptp(test.sensors_c, axis=0).max()
            print(f"{test.name}: peak {predicted.max():.1f} of {test.temperature_c.max():.1f} degC")
            print(f"    thermocouples one by one {', '.join(f'{e:.2f}' for e in sensors)} K")
            print(f"    they differ by up to {spread:.1f} K")
        volts, left = reversible_heat(system, tests)
        print("with reversible heat, T dU/dT in mV at SOC 0, 0.2 to 1:", (1000.0 * volts).round(0).tolist())
        print("RMSE then left [K]:", [round(error, 2) for error in left])
        return
    unseen = read(*arguments.predict)
    system = fit_plant([tests[rate - 1] for rate in arguments.fit])
    strict = rmse(predict(system, unseen), unseen)
    if has_charge(unseen):
        own = rmse(predict(with_electrics_of(system, unseen), unseen), unseen)
        print(f"{arguments.predict[0].name}: RMSE {own:.2f} K, strict {strict:.2f} K")
    else:
        print(f"{arguments.predict[0].name}: RMSE strict {strict:.2f} K; without a charge in the log its own")
        print("    OCV and resistance cannot be told apart")


if __name__ == "__main__":
    main()
