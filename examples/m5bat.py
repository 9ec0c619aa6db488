"""A real plant: one measured day of M5BAT (RWTH Aachen, 6 MW, ten units) as demand for ten unequal strings.

    python examples/m5bat.py DATA [--policies equal priority mpc] [--figures DIR]

DATA is a folder with m5bat_bess_battery_together_sample.parquet (1 s, plant and units 1 and 10) and
m5bat_2023-04-07_15min.parquet in bess/, and m5bat_inverter_steady_samples.parquet in inverter/. Printed are
the inverter loss line against the measured steady seconds, what the two measured units did, and what each
policy makes of the same 15-min power.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import bess
from bess.control.policies import PolicyInput, PolicySection, Settings, build_policy

DT_H = 0.25
MEASURED_UNITS = {"batt1": 0, "batt10": 9}  # name in the data: index in the system
RUNNING_KW = 1e-3
NOMINAL_KVA = 630.0
STEADY = ((0.0, 2.44), (252.0, 6.60))  # kVA, kW: medians at no load and with reactive power alone
DC_LAG_S = 3
FIT_WINDOW_S = 300
CARRIES_KVAR = 60.0
POWER_BINS_KW = [-1, 50, 200, 400, 600, 800, 1000, 1700]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replay:
    """What a policy made of the day; arrays of shape (96, 10)."""

    request_kw: Array
    delivered_kw: Array
    inverter_loss_kw: Array
    battery_loss_kw: Array
    derating_loss_kw: Array
    soc: Array
    fallbacks: int
    seconds: float

    @property
    def units_on(self) -> Array:
        return (np.abs(self.request_kw) > RUNNING_KW).sum(axis=1)


def replay(policy_name: str, demand_kw: Array, *, horizon_steps: int = 4) -> Replay:
    """Run the bundled system ``m5bat`` through the day; the forecast is perfect."""
    system = bess.load_system("m5bat")
    policy = build_policy(policy_name, system, Settings(DT_H, horizon_steps, PolicySection(node_limit=20)))
    plant = bess.Plant(system, system.initial_state())
    requests, flows, fallbacks = [], [], 0
    begin = time.perf_counter()
    for step in range(demand_kw.size):
        ahead = demand_kw[step : step + horizon_steps]
        ahead = np.pad(ahead, (0, horizon_steps - ahead.size))
        decision = policy(PolicyInput(plant.state, ahead, system.ambient_c, system.nominal_kw))
        requests.append(decision.request_kw)
        fallbacks += decision.solver.fallback
        flows.append(plant.step(decision.request_kw, 3600.0 * DT_H))
    return Replay(
        request_kw=np.array(requests),
        delivered_kw=np.array([f.delivered_kw for f in flows]),
        inverter_loss_kw=np.array([f.inverter_loss_kw for f in flows]),
        battery_loss_kw=np.array([f.battery_loss_kw for f in flows]),
        derating_loss_kw=np.array([f.derating_loss_kw for f in flows]),
        soc=np.array([f.soc for f in flows]),
        fallbacks=fallbacks,
        seconds=time.perf_counter() - begin,
    )


def loss_line_kw(apparent_kva: Array) -> Array:
    """Loss of one unit by the bundled table "m5bat-630", here over apparent power, as it was measured."""
    table = bess.load_system("m5bat").strings[0].inverter
    return np.asarray(
        table.nominal_kw * np.interp(apparent_kva / table.nominal_kw, table.load, table.loss_discharge)
    )


def unit_seconds(second: pd.DataFrame, unit: str) -> pd.DataFrame:
    """Running seconds of a measured unit: apparent power [kVA] and inverter loss [kW]."""
    dc_kw = (second[f"I_DC_Batt_{unit}"] * second[f"U_DC_Batt_{unit}"] / 1e5).to_numpy(dtype=np.float64)
    active_kw = second[f"P_AC_{unit}"].to_numpy(dtype=np.float64)
    frame = pd.DataFrame(
        {
            "apparent_kva": np.hypot(active_kw, second[f"Q_AC_{unit}"].to_numpy(dtype=np.float64)),
            "loss_kw": np.roll(dc_kw, -DC_LAG_S) - active_kw,
        }
    )
    return frame[(second[f"Mode_PQ_{unit}"] == 1).to_numpy()]


def fitted_loss(seconds: pd.DataFrame) -> Array:
    """Loss [kW] at no load, at the bend and at nominal power: two straight lines that meet at the bend.

    The first line is that of the steady seconds, which are many up to the bend. The second one is least
    squares on the energy of every five minutes: over minutes the lag of the DC columns cancels, which
    second by second is larger than the loss.
    """
    no_load_kw, bend_kw = (kw for _, kw in STEADY)
    bend_kva = STEADY[1][0]
    first_kw = np.interp(seconds.apparent_kva, [0.0, bend_kva], [no_load_kw, bend_kw])
    parts = {"above": np.maximum(seconds.apparent_kva - bend_kva, 0.0), "left": seconds.loss_kw - first_kw}
    sums = pd.DataFrame(parts).groupby(seconds.index // FIT_WINDOW_S)
    weight, energy = 1.0 / sums.size(), sums.sum()
    slope = (weight * energy.above * energy.left).sum() / (weight * energy.above**2).sum()
    return np.array([no_load_kw, bend_kw, bend_kw + slope * (NOMINAL_KVA - bend_kva)])


def loss_fit(second: pd.DataFrame, samples: pd.DataFrame) -> dict[str, float]:
    """The fit to unit 10, its error in sum on the day it was fitted to, and on data that it was not [%]."""

    def error_pct(fit: Array, apparent_kva: Array, loss_kw: Array) -> float:
        fitted_kw = np.interp(apparent_kva, [0.0, STEADY[1][0], NOMINAL_KVA], fit)
        return float(100.0 * (fitted_kw.sum() / loss_kw.sum() - 1.0))

    seconds = unit_seconds(second, "batt10")
    other_day = samples[samples.unit == "batt10_2023-04-13"]
    active = other_day[other_day.pac_kW.abs() > 40.0]
    odd = seconds.index // 3600 % 2 == 1
    fit = fitted_loss(seconds)
    halves = (seconds[odd], seconds[~odd])
    return {
        "no load, kW": fit[0],
        "at 252 kVA, kW": fit[1],
        "at 630 kVA, kW": fit[2],
        "the whole day, %": error_pct(fit, *seconds.to_numpy().T),
        "odd hours, fitted to even ones, %": error_pct(fitted_loss(halves[1]), *halves[0].to_numpy().T),
        "even hours, fitted to odd ones, %": error_pct(fitted_loss(halves[0]), *halves[1].to_numpy().T),
        **{
            f"steady seconds of 2023-04-13{kind}, %": error_pct(
                fit, np.hypot(some.pac_kW, some.q_kvar).to_numpy(), some.loss_kW.to_numpy()
            )
            for kind, some in (("", other_day), (" above 40 kW", active))
        },
    }


def steady_table(samples: pd.DataFrame) -> pd.DataFrame:
    """Median measured loss [kW] and the loss line, in bins of power, without and with reactive power."""
    kvar = samples.q_kvar.abs()
    bins = samples.assign(
        reactive=np.select([kvar < CARRIES_KVAR, kvar > 150.0], ["no Q", "Q > 150 kvar"], "")
    )
    bins = bins[bins.reactive != ""]
    edges = [-420, -200, -140, -100, -60, -20, 20, 60, 100, 140, 200, 320]
    bins["bin"] = pd.cut(bins.pac_kW, edges)
    bins["line_kw"] = loss_line_kw(np.hypot(bins.pac_kW, bins.q_kvar).to_numpy())
    table = bins.groupby(["reactive", "bin"], observed=True).agg(
        seconds=("loss_kW", "size"),
        power_kw=("pac_kW", "median"),
        measured_kw=("loss_kW", "median"),
        line_kw=("line_kw", "median"),
    )
    return table[table.seconds >= 30].round(2)


def loss_readings(samples: pd.DataFrame, second: pd.DataFrame) -> pd.DataFrame:
    """A loss line fitted to the steady seconds over active power, and one over apparent power; one row each.

    Columns: the line (least squares), the error of it without and with reactive power, and what it gives for
    the day of each measured unit, in kWh.
    """
    measured_kwh = {f"{unit}, kWh": unit_day(second, unit)["measured_loss_kwh"] for unit in MEASURED_UNITS}
    rows = {"measured": measured_kwh}
    carries = samples.q_kvar.abs() > CARRIES_KVAR
    for reading in ("active", "apparent"):

        def load_kva(p: pd.Series, q: pd.Series, reading: str = reading) -> Array:
            return (p.abs() if reading == "active" else np.hypot(p, q)).to_numpy(dtype=np.float64)

        slope, no_load_kw = np.polyfit(load_kva(samples.pac_kW, samples.q_kvar), samples.loss_kW, 1)
        error_kw = (
            no_load_kw + slope * load_kva(samples.pac_kW, samples.q_kvar) - samples.loss_kW
        ).to_numpy()
        row = {"no load, kW": no_load_kw, "slope, %": 100.0 * slope}
        for name, chosen in (("without Q", ~carries), ("with Q", carries)):
            row[f"mean error {name}, kW"] = error_kw[chosen.to_numpy()].mean()
            row[f"mean absolute error {name}, kW"] = np.abs(error_kw[chosen.to_numpy()]).mean()
        for unit in MEASURED_UNITS:
            running = second[f"Mode_PQ_{unit}"] == 1
            load = load_kva(second[f"P_AC_{unit}"][running], second[f"Q_AC_{unit}"][running])
            row[f"{unit}, kWh"] = float((no_load_kw + slope * load).sum() / 3600.0)
        rows[f"line over {reading} power"] = row
    return pd.DataFrame(rows).T.astype(np.float64)


def unit_day(second: pd.DataFrame, unit: str) -> dict[str, float]:
    """Running share, starts, energies and inverter loss of one measured unit over the day."""
    running = second[f"Mode_PQ_{unit}"].to_numpy() == 1
    active_kw = second[f"P_AC_{unit}"].to_numpy()
    dc_kw = second[f"I_DC_Batt_{unit}"].to_numpy() * second[f"U_DC_Batt_{unit}"].to_numpy() / 1e5
    apparent = np.hypot(active_kw, second[f"Q_AC_{unit}"].to_numpy())
    # Sums over whole running periods: the DC columns lag by three seconds, which cancels in a sum.
    near = np.convolve(running, np.ones(7), "same") > 0.5
    return {
        "running_share": float(running.mean()),
        "starts": int((np.diff(running.astype(int)) == 1).sum()),
        "discharged_kwh": float(active_kw[active_kw > 0].sum() / 3600.0),
        "charged_kwh": float(-active_kw[active_kw < 0].sum() / 3600.0),
        "measured_loss_kwh": float((dc_kw - active_kw)[near].sum() / 3600.0),
        "line_loss_kwh": float(loss_line_kw(apparent[running]).sum() / 3600.0),
    }


def units_by_power(second: pd.DataFrame, demand_kw: Array, replays: dict[str, Replay]) -> pd.DataFrame:
    """Running units over the power of the plant: measured for two of ten, and those of each policy.

    Where unit 10 runs it carries a share of the plant's power; its inverse is the number of units that carry
    power if they carry equal parts of it. That is as near as the data come to a count.
    """
    bins = pd.cut(second.M5BAT_P.abs(), POWER_BINS_KW)
    table = pd.DataFrame({"seconds": bins.groupby(bins, observed=True).size()})
    for unit in MEASURED_UNITS:
        table[f"{unit} running"] = second[f"Mode_PQ_{unit}"].groupby(bins, observed=True).mean()
    share = (second.P_AC_batt10 / second.M5BAT_P.where(second.M5BAT_P.abs() > POWER_BINS_KW[1])).where(
        second.Mode_PQ_batt10 == 1
    )
    table["real units, 1 / share of unit 10"] = 1.0 / share.groupby(bins, observed=True).median()
    quarter_bins = pd.cut(np.abs(demand_kw), POWER_BINS_KW)
    for name, r in replays.items():
        table[f"{name}, units"] = pd.Series(r.units_on).groupby(quarter_bins, observed=True).mean()
    return table.round(2)


def policy_table(demand_kw: Array, replays: dict[str, Replay]) -> pd.DataFrame:
    """One column for each policy."""
    gross_kwh = np.abs(demand_kw).sum() * DT_H
    rows = {}
    for name, r in replays.items():
        on = np.abs(r.request_kw) > RUNNING_KW
        starts = (on & ~np.vstack([np.zeros_like(on[:1]), on[:-1]])).sum()
        losses_kwh = (r.inverter_loss_kw + r.battery_loss_kw).sum() * DT_H
        rows[name] = {
            "units running, mean": r.units_on.mean(),
            "units running, most": r.units_on.max(),
            "unit 1 running, share": on[:, 0].mean(),
            "unit 10 running, share": on[:, 9].mean(),
            "starts of all units": starts,
            "inverter loss, kWh": r.inverter_loss_kw.sum() * DT_H,
            "battery loss, kWh": r.battery_loss_kw.sum() * DT_H,
            "both, % of throughput": 100.0 * losses_kwh / gross_kwh,
            "not delivered, kWh": gross_kwh - np.abs(r.delivered_kw).sum() * DT_H,
            "of that by derating, kWh": r.derating_loss_kw.sum() * DT_H,
            "largest share of one unit, %": 100.0
            * np.abs(r.delivered_kw).sum(axis=0).max()
            * DT_H
            / gross_kwh,
            "steps without optimum": r.fallbacks,
            "seconds": r.seconds,
        }
    return pd.DataFrame(rows).round(2) + 0.0  # no negative zeros


def draw(
    folder: Path, demand_kw: Array, replays: dict[str, Replay], samples: pd.DataFrame, second: pd.DataFrame
) -> None:
    """Both figures of the documentation page."""
    import matplotlib as mpl

    mpl.use("svg")
    import matplotlib.pyplot as plt

    mpl.rcParams |= {"svg.hashsalt": "bess", "svg.fonttype": "none"}
    hours = np.arange(demand_kw.size) * DT_H
    figure, axes = plt.subplots(3, 1, figsize=(8, 7), sharex=True, layout="constrained")
    axes[0].step(hours, demand_kw, where="post", color="black", linewidth=1)
    axes[0].set_ylabel("plant power [kW]\n(+ discharge)")
    for index, (name, r) in enumerate(replays.items()):
        width = 1.0 + len(replays) - index  # counts that coincide stay visible
        axes[1].step(hours, r.units_on, where="post", label=name, linewidth=width)
    axes[1].set_ylabel("units running (model)")
    axes[1].legend(ncols=len(replays))
    quarter = second.index.floor("15min")
    for unit, number in (("batt1", 1), ("batt10", 10)):
        share = second[f"Mode_PQ_{unit}"].groupby(quarter).mean().to_numpy()
        axes[2].step(hours, share, where="post", label=f"unit {number}", linewidth=1)
    axes[2].set(ylabel="running (measured),\nshare of 15 min", xlabel="hour of 2023-04-07, UTC")
    axes[2].legend(ncols=2)
    figure.savefig(folder / "m5bat-day.svg", metadata={"Date": None})

    table = steady_table(samples).reset_index()
    figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
    for label, rows in table.groupby("reactive"):
        axis.plot(rows.power_kw, rows.measured_kw, "o", label=f"measured medians, {label}")
    power = np.linspace(-330.0, 330.0, 221)
    axis.plot(power, loss_line_kw(np.abs(power)), label="m5bat-630, no Q", linewidth=1)
    axis.plot(power, loss_line_kw(np.hypot(power, 215.0)), label="m5bat-630, 215 kvar", linewidth=1)
    axis.set(xlabel="AC power of a unit [kW] (+ discharge)", ylabel="inverter loss [kW]", ylim=(0.0, 15.0))
    axis.legend(loc="upper center", fontsize="small")
    figure.savefig(folder / "m5bat-loss.svg", metadata={"Date": None})


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--policies", nargs="+", default=["equal", "priority", "mpc"])
    parser.add_argument("--figures", type=Path)
    arguments = parser.parse_args()
    samples = pd.read_parquet(arguments.data / "inverter/m5bat_inverter_steady_samples.parquet")
    second = pd.read_parquet(arguments.data / "bess/m5bat_bess_battery_together_sample.parquet")
    day = pd.read_parquet(arguments.data / "bess/m5bat_2023-04-07_15min.parquet")
    demand_kw = day.M5BAT_P.to_numpy(dtype=np.float64)

    print(steady_table(samples).to_string(), end="\n\n")
    print(pd.DataFrame({u: unit_day(second, u) for u in MEASURED_UNITS}).round(2).to_string(), end="\n\n")
    print(loss_readings(samples, second).round(2).to_string(), end="\n\n")
    print(pd.Series(loss_fit(second, samples)).round(4).to_string(), end="\n\n")
    gross = [np.abs(demand_kw).sum() * DT_H, second.M5BAT_P.abs().sum() / 3600.0]
    print(f"energy moved: {gross[0]:.0f} kWh in 15-min means, {gross[1]:.0f} kWh in seconds", end="\n\n")
    replays = {name: replay(name, demand_kw) for name in arguments.policies}
    print(units_by_power(second, demand_kw, replays).to_string(), end="\n\n")
    print(policy_table(demand_kw, replays).to_string())
    if arguments.figures is not None:
        draw(arguments.figures, demand_kw, replays, samples, second)


if __name__ == "__main__":
    main()
