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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

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
ENTROPY_SOC = np.linspace(0.0, 1.0, 6)
Array = NDArray[np.float64]
Reversible = Literal["none", "published", "fitted"]


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


def nmc111_entropy_mv_k(soc: Array) -> Array:
    """Entropy coefficient of a published 12.5 Ah pouch cell, NMC111 on graphite [mV/K].

    Both electrodes of the parameter set that About:Energy gave to the standard BPX: 0.1 mV/K of the cathode,
    and a bell at the first stage of the graphite, whose stoichiometry runs from 0.0055 to 0.7567.
    """
    x = 0.005504 + soc * (0.75668 - 0.005504)
    anode = -0.1112 * x + 0.02914 + 0.3561 * np.exp(-((x - 0.08309) ** 2) / 0.004616)
    return np.asarray(-0.1 - anode)


def cell_system(
    tests: Sequence[Measurement],
    *,
    specific_heat_j_kgk: float,
    film_w_m2k: float,
    nodes: int = 8,
    entropy: tuple[Array, Array] | None = None,
) -> bess.System:
    """One cell behind an inverter without losses, air on both faces, conduction along the cell.

    ``entropy`` is SOC and ``dU/dT`` [mV/K]; None leaves reversible heat out.
    """
    ocv, milliohm = electrical(tests)
    order = np.argsort([test.c_rate for test in tests])
    return one_cell(
        LEAF,
        (SOC, ocv),
        {tests[index].c_rate: milliohm[index] for index in order},
        specific_heat_j_kgk=specific_heat_j_kgk,
        film_w_m2k=film_w_m2k,
        nodes=nodes,
        entropy=entropy,
    )


@dataclass(frozen=True)
class Cell:
    """What is known of a cell before a fit."""

    name: str
    capacity_ah: float
    mass_kg: float
    surface_m2: float
    length_m: float
    volume_m3: float


LEAF = Cell("Leaf cell", CAPACITY_AH, MASS_KG, SURFACE_M2, length_m=0.261, volume_m3=0.261 * 0.216 * 0.0079)


def one_cell(
    cell: Cell,
    ocv_v: tuple[Array, Array],
    milliohm: Mapping[float, Array],
    *,
    specific_heat_j_kgk: float,
    film_w_m2k: float,
    nodes: int = 8,
    plant_step_s: float = STEP_S,
    entropy: tuple[Array, Array] | None = None,
) -> bess.System:
    """One cell behind an inverter without losses, air of one temperature on its faces.

    ``ocv_v`` is SOC and voltage; ``milliohm`` resistance over the same SOC by C-rate, ascending;
    ``entropy`` as in :func:`cell_system`.
    """
    table = np.array(list(milliohm.values()))[:, None, :]
    document: dict[str, Any] = {
        "system": {"n_strings": 1},
        "battery": {
            "cells_series": 1,
            "cells_parallel": 1,
            "cell_capacity_ah": cell.capacity_ah,
            "cell_mass_kg": cell.mass_kg,
            "ocv_v": {"soc": ocv_v[0], "charge": ocv_v[1], "discharge": ocv_v[1]},
            "resistance_table": {
                "soc": ocv_v[0],
                "temperature_c": [25.0],
                "c_rate": list(milliohm),
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
                "length_m": cell.length_m,
                "nodes": nodes,
                "section_m2": cell.volume_m3 / cell.length_m,
                "width_m": cell.surface_m2 / cell.length_m,
                "density_kg_m3": cell.mass_kg / cell.volume_m3,
                "specific_heat_j_kgk": specific_heat_j_kgk,
                "conductivity_w_mk": 20.0,
                "lateral_u_w_m2k": film_w_m2k,
                "end_u_w_m2k": 0.0,
                "air_flow_kg_s": 1.0,  # still air: the cell does not heat what it stands in
                "air_cp_j_kgk": 1006.0,
            },
            "lumped": {"k1_k_per_j": 1.0 / (cell.mass_kg * specific_heat_j_kgk), "k2_per_s": 1e-3},
        },
        "control": {"plant_step_s": plant_step_s},
    }
    if entropy is not None:
        document["battery"]["entropy"] = {"soc": entropy[0], "du_dt_mv_k": entropy[1]}
    return bess.System(document, name=cell.name)


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


def fit_plant(tests: Sequence[Measurement], reversible: Reversible = "none") -> bess.System:
    """Specific heat and film coefficient that meet the temperatures of ``tests`` best.

    Reversible heat is left out, has the published entropy of another cell, or is fitted at six SOC as well.
    """

    def system_of(values: Array) -> bess.System:
        entropy = {
            "none": None,
            "published": (SOC, nmc111_entropy_mv_k(SOC)),
            "fitted": (ENTROPY_SOC, values[2:]),
        }[reversible]
        heat, film = np.exp(values[:2])
        return cell_system(tests, specific_heat_j_kgk=float(heat), film_w_m2k=float(film), entropy=entropy)

    def residual(values: Array) -> Array:
        errors = [predict(system_of(values), test) - test.temperature_c for test in tests]
        # A test that says little of the entropy leaves it small.
        small = 0.02 * values[2:]
        return np.concatenate([*(error / np.sqrt(error.size) for error in errors), small])

    unknown = ENTROPY_SOC.size if reversible == "fitted" else 0
    start = np.concatenate([np.log([1600.0, 15.0]), np.full(unknown, 0.1)])
    return system_of(least_squares(residual, start, diff_step=1e-3).x)


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
    spatial, table = fitted.strings[0].thermal.spatial, fitted.strings[0].battery.entropy
    return cell_system(
        [test],
        specific_heat_j_kgk=spatial.specific_heat_j_kgk,
        film_w_m2k=spatial.lateral_u_w_m2k,
        entropy=None if table is None else (np.array(table.soc), np.array(table.du_dt_mv_k)),
    )


def reversible_table(tests: Sequence[Measurement], reversible: Reversible) -> pd.DataFrame:
    """RMSE [K] of the plant with reversible heat, as :func:`hold_out_table`, and the entropy coefficients."""
    rows = {}
    for size in range(1, len(tests) + 1):
        for chosen in combinations(tests, size):
            system = fit_plant(chosen, reversible)
            spatial, table = system.strings[0].thermal.spatial, system.strings[0].battery.entropy
            row = {"c_p": f"{spatial.specific_heat_j_kgk:.0f}", "film": f"{spatial.lateral_u_w_m2k:.1f}"}
            for test in tests:
                mark = "*" if test in chosen else ""
                own, strict = with_electrics_of(system, test), system
                row[f"plant {test.name}"] = f"{rmse(predict(own, test), test):.2f}{mark}"
                row[f"strict {test.name}"] = f"{rmse(predict(strict, test), test):.2f}{mark}"
            if reversible == "fitted" and table is not None:
                row["dU/dT, mV/K"] = ", ".join(f"{value:.2f}" for value in table.du_dt_mv_k)
            rows["+".join(test.name for test in chosen)] = row
    return pd.DataFrame(rows).T


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
        kinds: tuple[Reversible, ...] = ("fitted", "published")
        for reversible in kinds:
            print(f"with reversible heat, entropy {reversible}")
            print(reversible_table(tests, reversible).to_string())
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
