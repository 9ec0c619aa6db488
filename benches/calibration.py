"""Cost of an SOC calibration at the time that the service plans, and at every fourth hour of the day.

`python benches/calibration.py [DAYS]` runs random days of two reference strings; the demand is drawn for each
hour and repeated daily. The controller of the service (policy `soc`) runs four days in the plant: without a
calibration, with one at the planned time, and with one begun at each of six fixed times. Costs are kWh:
losses and three times the undelivered energy, less those of the run without.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime

import numpy as np

import bess
from bess.arrays import Array
from bess.control.policies import Settings, build_policy
from bess.edge.plant_io import Measurements
from bess.edge.serve.controller import Controller
from bess.study.sections import ServiceSection

STEP_S, DAY = 900.0, 96


def demand(seed: int) -> Array:
    """Demand of five days [kW], slightly more charge than discharge."""
    hourly = 2.0 * np.random.default_rng(seed).uniform(-50.0, 50.0, 24)
    return np.tile(np.repeat(hourly - hourly.mean() - 2.0, 4), 5)


def run(demand_kw: Array, start: int | None = None, *, planned: bool = False) -> tuple[float, float]:
    """Cost of four days [kWh], and the cost by the plan."""
    system = bess.System.reference(n_strings=2)
    service = ServiceSection(control_step_s=STEP_S, calibration_days=10.0 if planned else None)
    policy = build_policy("soc", system, Settings(0.25, DAY))
    live = Controller(system, policy, service, DAY, background=False)
    plant = bess.Plant(system, system.initial_state())
    live.calibration.full_s = np.array([-9.0 * 86_400.0, 1e9])  # the first string is due after a day
    cost_kwh, expected_kwh, power_kw = 0.0, np.nan, np.full(2, np.nan)
    for k in range(4 * DAY):
        if k == start:
            live.calibration.begin(0)
        free, state = np.full(2, np.inf), plant.state
        time = datetime.fromtimestamp(STEP_S * k, tz=UTC)
        reading = Measurements(
            time, state.soc, state.temperature_c, power_kw, free, free, np.ones(2, dtype=bool)
        )
        answer = live.step(reading, float(demand_kw[k]), STEP_S * k, forecast_kw=demand_kw[k : k + DAY])
        if live.calibration.planned is not None and np.isnan(expected_kwh):
            expected_kwh = live.calibration.planned.cost_kwh
        flows = plant.step(answer.request_kw, step_s=STEP_S)
        power_kw = flows.delivered_kw
        undelivered_kw = abs(demand_kw[k] - power_kw.sum())
        cost_kwh += 0.25 * float(
            flows.inverter_loss_kw.sum() + flows.battery_loss_kw.sum() + 3.0 * undelivered_kw
        )
    return cost_kwh, expected_kwh


def main(days: int) -> None:
    """Print a row for each day."""
    print("day  planned  (by the plan)  fixed: best  mean  worst")
    rows = []
    for seed in range(days):
        demand_kw = demand(seed)
        without, _ = run(demand_kw)
        planned, expected_kwh = run(demand_kw, planned=True)
        fixed = [run(demand_kw, start)[0] - without for start in range(0, DAY, DAY // 6)]
        rows.append([planned - without, expected_kwh, min(fixed), float(np.mean(fixed)), max(fixed)])
        print(seed, *(f"{kwh:9.1f}" for kwh in rows[-1]))
    print("mean", *(f"{kwh:9.1f}" for kwh in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
