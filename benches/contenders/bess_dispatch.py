"""CPU of a plan over 12 hours by the dispatch that asks the plant: ``bess_dispatch.py PLANS MINUTES``."""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from market_day import CYCLES, ENERGY_KWH, STEPS, SYSTEM, earned_eur, prices, state

import bess
from bess.dispatch import DispatchInputs, DynamicProgramDispatch
from bess.system.terms import SettlementTerms


def main(plans: int, minutes: int) -> None:
    """Print the CPU of a plan [s] and what all plans earn in the plant [EUR]."""
    dt_h, steps = minutes / 60.0, STEPS * 15 // minutes
    dispatch = DynamicProgramDispatch(
        bess.load_system(SYSTEM), dt_h, SettlementTerms(), max_energy_kwh=ENERGY_KWH, cycles_per_plan=CYCLES
    )
    inputss = [
        DispatchInputs(
            np.repeat(prices(seed), steps // STEPS),
            np.full(steps, 25.0),
            np.zeros(steps, dtype=np.int64),
            is_last=True,
        )
        for seed in range(plans)
    ]
    states = [state(seed) for seed in range(plans)]
    dispatch.plan(inputss[0], states[0])  # what is loaded once does not count
    started = time.process_time()
    made = [dispatch.plan(inputs, at).demand_kw for inputs, at in zip(inputss, states, strict=True)]
    cpu_s = (time.process_time() - started) / plans
    earned = sum(earned_eur(demand_kw, dt_h, seed) for seed, demand_kw in enumerate(made))
    print(json.dumps({"plan_cpu_s": cpu_s, "earned_eur": earned}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
