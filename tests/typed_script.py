"""What a user writes: `make lint` holds it to the signatures, as strictly as the package; nothing runs it."""

import numpy as np
import numpy.typing as npt

import bess
from bess.control.policies import PolicyInput

Floats = npt.NDArray[np.float64]


def share(inputs: PolicyInput) -> Floats:
    return np.full(inputs.limit_kw.size, inputs.demand_kw[0] / inputs.limit_kw.size)


system: bess.System = bess.System.reference(n_strings=2)
state = bess.State(soc=[0.5, 0.5], temperature_c=[25.0, 25.0])
roll = bess.rollout(system, state, np.full((2, 8), 39.0), dt_h=0.25)
soc: Floats = roll.soc
goals = bess.Objectives(inverter=0.5, battery=bess.Objective(weight=0.5, priority=2))
split = bess.split_power(system, state, [78.0] * 8, objectives=goals, gap=1e-3, time_limit_s=None)
request_kw: Floats = split.request_kw
status: bess.SplitStatus = split.status
splitter = bess.PowerSplit(system, horizon_steps=8, objectives=bess.Objectives.energy(shortfall=3.0))
again: bess.Split = splitter(state, [78.0] * 8)
plant = bess.Plant(system, state)
delivered_kw: Floats = plant.step([40.0, 38.0], step_s=900.0).delivered_kw
flows = plant.run(np.full((96, 2), 10.0), step_s=900.0)
result = bess.run("case1", policy=share, system=system, progress=True)
efficiency: float = bess.kpis(result)["system_efficiency_pct"]
bound_kwh: float = bess.hindsight(result, effort="quick").bound_kwh
hottest_c = float(result.dataset["temperature_c"].max())
plan = bess.plan_dispatch(system, bess.read_prices("prices.csv", zone="DE-LU"), state, hours=36)
net_eur: float = plan.expected_net_eur
