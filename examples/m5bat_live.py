"""The measured day of M5BAT once more, in steps of ten seconds: what the live controller of bess serve does.

    python examples/m5bat_live.py DATA [--table FILE]

DATA is a folder with bess/m5bat_bess_battery_together_sample.parquet (1 s). Three controllers carry the
plant's power: one that decides every quarter hour and is asked for quarter-hour means; the same one asked for
the power of every ten seconds, with the units of its plan, and as many more as the peak of the quarter hour
needs; and the live controller, which decides every ten seconds over that same plan. All foresee the
quarter-hour means of the day. An inverter that runs at no power loses its no-load power in each of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import bess
from bess.control.objectives import Objectives
from bess.control.policies import Policy, PolicyInput, PolicySection, Settings, build_policy
from bess.control.policies.rule import water_fill
from bess.edge.plant_io import Measurements
from bess.edge.serve.controller import Controller
from bess.study.sections import ServiceSection

STEP_S, PLAN_S, PLAN_STEPS = 10.0, 900.0, 96
PER_PLAN = round(PLAN_S / STEP_S)
Array = NDArray[np.float64]
Decide = Callable[[int, bess.State], tuple[Array, NDArray[np.bool_]]]
"""From the number of a step and the state to set-points and running inverters."""


@dataclass(frozen=True)
class Day:
    """What a controller made of the day."""

    moved_kwh: float
    inverter_kwh: float
    battery_kwh: float
    undelivered_kwh: float
    starts: NDArray[np.int64]
    running: float

    @property
    def lost_kwh(self) -> float:
        return self.inverter_kwh + self.battery_kwh


def ten_seconds(second: pd.DataFrame) -> Array:
    """Power of the plant [kW] in means of ten seconds."""
    return second.M5BAT_P.to_numpy(dtype=np.float64).reshape(-1, round(STEP_S)).mean(axis=1)


def carried(system: bess.System, demand_kw: Array, step_s: float, decide: Decide) -> Day:
    """Run the plant through the day."""
    plant = bess.Plant(system, system.initial_state())
    no_load_kw = np.array([s.inverter.nominal_kw * s.inverter.loss_discharge[0] for s in system.strings])
    inverter = battery = undelivered = running = 0.0
    starts, before = np.zeros(system.n_strings, dtype=np.int64), np.zeros(system.n_strings, dtype=bool)
    for step, asked_kw in enumerate(demand_kw):
        request_kw, on = decide(step, plant.state)
        flows = plant.step(request_kw, step_s)
        idle_kw = no_load_kw[on & (request_kw == 0.0)].sum()
        inverter += float(flows.inverter_loss_kw.sum() + idle_kw)
        battery += float(flows.battery_loss_kw.sum())
        undelivered += abs(asked_kw - float(flows.delivered_kw.sum()))
        running += on.sum() / demand_kw.size
        starts += on & ~before
        before = on
    hours = step_s / 3600.0
    return Day(
        float(np.abs(demand_kw).sum()) * hours,
        inverter * hours,
        battery * hours,
        undelivered * hours,
        starts,
        running,
    )


def planner(system: bess.System) -> Policy:
    """Plans of a day in quarter hours."""
    plan = PolicySection(mode="plan", objectives=Objectives.energy())
    return build_policy("mpc", system, Settings(PLAN_S / 3600.0, PLAN_STEPS, plan))


def quarter_hours(system: bess.System, means_kw: Array) -> Day:
    """The controller of quarter hours, asked for their means."""
    policy = planner(system)

    def decide(step: int, state: bess.State) -> tuple[Array, NDArray[np.bool_]]:
        request_kw = policy(_policy_input(system, means_kw, step, state)).request_kw
        return request_kw, request_kw != 0.0

    return carried(system, means_kw, PLAN_S, decide)


def held_sets(system: bess.System, demand_kw: Array, means_kw: Array) -> Day:
    """The controller of quarter hours, asked for every ten seconds by the units that it has chosen."""
    policy = planner(system)
    nominal = system.nominal_kw
    weights, on = np.zeros(system.n_strings), np.zeros(system.n_strings, dtype=bool)

    def decide(step: int, state: bess.State) -> tuple[Array, NDArray[np.bool_]]:
        nonlocal weights, on
        quarter, within = divmod(step, PER_PLAN)
        if within == 0:
            weights = np.abs(policy(_policy_input(system, means_kw, quarter, state)).request_kw)
            on = weights > 0.0
            peak_kw = np.abs(demand_kw[step : step + PER_PLAN]).max()
            # More units as far as the peak needs them, those of little resistance first.
            for unit in (4, 5, 6, 7, 8, 9, 0, 1, 2, 3):
                if nominal[on].sum() < peak_kw:
                    on = on | (np.arange(on.size) == unit)
        power_kw = water_fill(abs(demand_kw[step]), weights * on, nominal * on)
        return np.copysign(power_kw, demand_kw[step]), on

    return carried(system, demand_kw, STEP_S, decide)


def live(system: bess.System, demand_kw: Array, means_kw: Array, **settings: float) -> Day:
    """The live controller."""
    service = ServiceSection(control_step_s=STEP_S, **settings)
    controller = Controller(system, planner(system), service, PLAN_STEPS, background=False)
    free = np.full(system.n_strings, np.inf)
    begin = datetime(2023, 4, 7, tzinfo=UTC)

    def decide(step: int, state: bess.State) -> tuple[Array, NDArray[np.bool_]]:
        measured = Measurements(
            time=begin + timedelta(seconds=STEP_S * step),
            soc=state.soc,
            temperature_c=state.temperature_c,
            power_kw=controller.last_kw,
            charge_limit_kw=free,
            discharge_limit_kw=free,
            available=np.ones(system.n_strings, dtype=bool),
        )
        ahead = means_kw[step // PER_PLAN :]
        answer = controller.step(measured, float(demand_kw[step]), STEP_S * step, forecast_kw=ahead)
        return answer.request_kw, answer.running

    return carried(system, demand_kw, STEP_S, decide)


def table(days: dict[str, Day]) -> str:
    """One column for each controller."""
    rows: dict[str, Callable[[Day], str]] = {
        "energy moved [kWh]": lambda d: f"{d.moved_kwh:.0f}",
        "inverter loss [kWh]": lambda d: f"{d.inverter_kwh:.0f}",
        "battery loss [kWh]": lambda d: f"{d.battery_kwh:.0f}",
        "both [kWh]": lambda d: f"{d.lost_kwh:.0f}",
        "both, share of the energy moved [%]": lambda d: f"{100.0 * d.lost_kwh / d.moved_kwh:.2f}",
        "not delivered [kWh]": lambda d: f"{d.undelivered_kwh:.1f}",
        "units running, mean": lambda d: f"{d.running:.2f}",
        "starts of all ten units": lambda d: f"{d.starts.sum()}",
        "starts of unit 1 (measured 253)": lambda d: f"{d.starts[0]}",
        "starts of unit 10 (measured 131)": lambda d: f"{d.starts[9]}",
        "most starts of one unit": lambda d: f"{d.starts.max()}",
    }
    lines = ["| | " + " | ".join(days) + " |", "|" + " --- |" * (len(days) + 1)]
    lines += [f"| {name} | " + " | ".join(map(show, days.values())) + " |" for name, show in rows.items()]
    return "\n".join(lines) + "\n"


def _policy_input(system: bess.System, means_kw: Array, quarter: int, state: bess.State) -> PolicyInput:
    ahead = np.pad(means_kw[quarter:], (0, quarter))[:PLAN_STEPS]
    return PolicyInput(state, ahead, np.full(PLAN_STEPS, system.ambient_c), system.nominal_kw)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--table", type=Path)
    arguments = parser.parse_args()
    file = arguments.data / "bess/m5bat_bess_battery_together_sample.parquet"
    if not file.exists():
        print(f"{file}: no measured day of M5BAT there; its table stays as it is")
        return
    demand_kw = ten_seconds(pd.read_parquet(file))
    means_kw = demand_kw.reshape(-1, PER_PLAN).mean(axis=1)
    system = bess.load_system("m5bat")
    days = {
        "quarter hours, of means": quarter_hours(system, means_kw),
        "quarter hours, of ten seconds": held_sets(system, demand_kw, means_kw),
        "live, of ten seconds": live(system, demand_kw, means_kw),
    }
    text = table(days)
    print(text)
    if arguments.table is not None:
        arguments.table.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
