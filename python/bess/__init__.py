"""Power split control of multi-string battery storage, in closed loop with an electro-thermal plant.

The public names are loaded on first use, so that ``import bess`` and ``bess --help`` stay fast.
"""

from importlib import import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bess.control.planning import Plan, plan_power
    from bess.control.split.objectives import Objective, Objectives
    from bess.control.split.power_split import PowerSplit, split_power
    from bess.control.split.result import GroupResult, Split, SplitStatus
    from bess.control.split.rollout import Rollout, rollout
    from bess.dispatch.plan import plan_dispatch
    from bess.dispatch.store_value import StoreValue, store_value
    from bess.errors import BessError, InputError, StoppedEarly
    from bess.market import read_prices, read_weather
    from bess.plant import Plant, PlantEnsemble
    from bess.report import write_report
    from bess.simulation.analysis.kpis import kpis
    from bess.simulation.analysis.settlement import ledger
    from bess.simulation.hindsight import Hindsight, hindsight
    from bess.simulation.record import Result, open_result
    from bess.simulation.runner import run
    from bess.simulation.sweep import SweepResult, run_sweep
    from bess.simulation.sweep.sequential import run_scenarios
    from bess.study import Study, load_study
    from bess.system import State, System, load_system
    from bess.system.components import (
        inverter_from_efficiency,
        inverter_from_loss,
        inverter_from_sandia,
        read_inverter,
    )

_HOMES = {
    "inverter_from_efficiency": "bess.system.components",
    "inverter_from_loss": "bess.system.components",
    "inverter_from_sandia": "bess.system.components",
    "read_inverter": "bess.system.components",
    "BessError": "bess.errors",
    "InputError": "bess.errors",
    "StoppedEarly": "bess.errors",
    "PlantEnsemble": "bess.plant",
    "Plant": "bess.plant",
    "State": "bess.system",
    "System": "bess.system",
    "load_system": "bess.system",
    "read_prices": "bess.market",
    "read_weather": "bess.market",
    "Result": "bess.simulation.record",
    "Study": "bess.study",
    "load_study": "bess.study",
    "plan_dispatch": "bess.dispatch.plan",
    "Plan": "bess.control.planning",
    "plan_power": "bess.control.planning",
    "StoreValue": "bess.dispatch.store_value",
    "store_value": "bess.dispatch.store_value",
    "open_result": "bess.simulation.record",
    "run": "bess.simulation.runner",
    "run_scenarios": "bess.simulation.sweep.sequential",
    "kpis": "bess.simulation.analysis.kpis",
    "ledger": "bess.simulation.analysis.settlement",
    "Objective": "bess.control.split.objectives",
    "Objectives": "bess.control.split.objectives",
    "GroupResult": "bess.control.split.result",
    "Split": "bess.control.split.result",
    "SplitStatus": "bess.control.split.result",
    "PowerSplit": "bess.control.split.power_split",
    "split_power": "bess.control.split.power_split",
    "Hindsight": "bess.simulation.hindsight",
    "hindsight": "bess.simulation.hindsight",
    "Rollout": "bess.control.split.rollout",
    "rollout": "bess.control.split.rollout",
    "SweepResult": "bess.simulation.sweep",
    "run_sweep": "bess.simulation.sweep",
    "write_report": "bess.report",
}

__all__ = [
    "BessError",
    "GroupResult",
    "Hindsight",
    "InputError",
    "Objective",
    "Objectives",
    "Plan",
    "Plant",
    "PlantEnsemble",
    "PowerSplit",
    "Result",
    "Rollout",
    "Split",
    "SplitStatus",
    "State",
    "StoppedEarly",
    "StoreValue",
    "Study",
    "SweepResult",
    "System",
    "hindsight",
    "inverter_from_efficiency",
    "inverter_from_loss",
    "inverter_from_sandia",
    "kpis",
    "ledger",
    "load_study",
    "load_system",
    "open_result",
    "plan_dispatch",
    "plan_power",
    "read_inverter",
    "read_prices",
    "read_weather",
    "rollout",
    "run",
    "run_scenarios",
    "run_sweep",
    "split_power",
    "store_value",
    "write_report",
]

__version__ = _version("bess-powersplit")


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'bess' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
