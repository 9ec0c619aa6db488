"""The dispatch that both sides plan: 12 hours of a battery of 180 kWh on quarter-hourly prices."""

from __future__ import annotations

import numpy as np

import bess

SYSTEM = "cornejo-180"
STEPS = 48
DT_H = 0.25
CYCLES = 0.75
ENERGY_KWH = 180.0


def prices(seed: int) -> np.ndarray:
    """Two waves a day with the noise of an intraday market [EUR/MWh], shape (48,)."""
    rng = np.random.default_rng(seed)
    hour = np.arange(STEPS) * DT_H
    return (
        90.0 + 45.0 * np.sin(2.0 * np.pi * hour / 12.0 + rng.uniform(0.0, 6.3)) + rng.normal(0.0, 20.0, STEPS)
    )


def state(seed: int) -> bess.State:
    """A state of charge for each plan."""
    return bess.State([float(np.random.default_rng(seed + 1000).uniform(0.1, 0.9))], [25.0])


def earned_eur(demand_kw: np.ndarray, dt_h: float, seed: int) -> float:
    """What the plant, stepped every minute, makes of a plan of steps of ``dt_h``: the market alone."""
    system = bess.load_system(SYSTEM)
    plant = bess.Plant(system, state(seed), plant_step_s=60.0)
    flows = plant.run(np.asarray(demand_kw)[:, None], step_s=dt_h * 3600.0)
    price = np.repeat(prices(seed), demand_kw.size // STEPS)
    return float(flows.delivered_kw[:, 0] @ price) * dt_h / 1000.0
