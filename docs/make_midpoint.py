"""Write the table of ``foresight.md``: ``python docs/make_midpoint.py``, a few seconds."""

from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from tables import markdown_table

import bess
from bess.control.rollout import Model

DOCS = Path(__file__).parent
FILE = "midpoint.md"
SOC = ((0.0, 0.12), (0.12, 0.3), (0.3, 0.9))
STATES = 400
STEP_S = 900.0


def main() -> None:
    """Write the table."""
    (DOCS / "_cases" / FILE).write_text(table(), encoding="utf-8")


def table() -> str:
    """Error of one step of the control model against the plant, root mean square over random states."""
    rows = [["SOC", "coefficients", "SOC [%]", "temperature [K]", "delivered [kW]", "heat [kW]"]]
    for low, high in SOC:
        for model, errors in _errors(low, high).items():
            named = {"start": "start", "midpoint": "middle"}[model]
            rows.append([f"{low:g} to {high:g}", named, *(f"{value:.3f}" for value in errors)])
    return markdown_table(rows)


def _errors(low: float, high: float) -> dict[str, NDArray[np.float64]]:
    rng = np.random.default_rng(1)
    system = bess.System.reference(1)
    states = [
        bess.State([soc], [warm])
        for soc, warm in zip(rng.uniform(low, high, STATES), rng.uniform(20.0, 52.0, STATES), strict=True)
    ]
    request_kw = rng.choice([-1.0, 1.0], STATES) * rng.uniform(0.1, 1.0, STATES) * system.nominal_kw[0]
    plant = bess.PlantEnsemble(system, states).run(request_kw[:, None, None], STEP_S)
    truth = np.stack([100.0 * plant.soc, plant.temperature_c, plant.delivered_kw, plant.battery_loss_kw])
    truth = truth.reshape(4, STATES)
    found = {}
    for model in get_args(Model):
        rolls = [
            bess.rollout(system, state, [[power]], STEP_S / 3600.0, model=model)
            for state, power in zip(states, request_kw, strict=True)
        ]
        parts = [(100.0 * r.soc, r.temperature_c, r.delivered_kw, r.battery_loss_kw) for r in rolls]
        error = np.array(parts).reshape(STATES, 4).T - truth
        found[model] = np.sqrt((error**2).mean(axis=1))
    return found


if __name__ == "__main__":
    main()
