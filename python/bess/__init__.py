"""Power split control of multi-string battery storage, in closed loop with an electro-thermal plant.

The public names are loaded on first use, so that ``import bess`` and ``bess --help`` stay fast.
"""

from importlib import import_module
from importlib.metadata import version as _version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bess.analysis.kpis import kpis
    from bess.analysis.settlement import ledger
    from bess.components import (
        inverter_from_efficiency,
        inverter_from_loss,
        inverter_from_sandia,
        read_inverter,
    )
    from bess.ems.plan import plan_dispatch
    from bess.ems.store_value import StoreValue, store_value
    from bess.errors import BessError, InputError, StoppedEarly
    from bess.foresight import Plan, plan_power
    from bess.market import read_prices, read_weather
    from bess.parameters import State, System, load_system
    from bess.plant import Fleet, Plant
    from bess.record import Result, open_result
    from bess.report import write_report
    from bess.retrospect import Hindsight, hindsight
    from bess.simulation import run, run_scenarios
    from bess.split.objectives import Objective, Objectives
    from bess.split.power_split import PowerSplit, split_power
    from bess.split.result import GroupResult, Split, SplitStatus
    from bess.split.rollout import Rollout, rollout
    from bess.study import Study, load_study
    from bess.sweep import SweepResult, run_sweep

_HOMES = {
    "inverter_from_efficiency": "bess.components",
    "inverter_from_loss": "bess.components",
    "inverter_from_sandia": "bess.components",
    "read_inverter": "bess.components",
    "BessError": "bess.errors",
    "InputError": "bess.errors",
    "StoppedEarly": "bess.errors",
    "Fleet": "bess.plant",
    "Plant": "bess.plant",
    "State": "bess.parameters",
    "System": "bess.parameters",
    "load_system": "bess.parameters",
    "read_prices": "bess.market",
    "read_weather": "bess.market",
    "Result": "bess.record",
    "Study": "bess.study",
    "load_study": "bess.study",
    "plan_dispatch": "bess.ems.plan",
    "Plan": "bess.foresight",
    "plan_power": "bess.foresight",
    "StoreValue": "bess.ems.store_value",
    "store_value": "bess.ems.store_value",
    "open_result": "bess.record",
    "run": "bess.simulation",
    "run_scenarios": "bess.simulation",
    "kpis": "bess.analysis.kpis",
    "ledger": "bess.analysis.settlement",
    "Objective": "bess.split.objectives",
    "Objectives": "bess.split.objectives",
    "GroupResult": "bess.split.result",
    "Split": "bess.split.result",
    "SplitStatus": "bess.split.result",
    "PowerSplit": "bess.split.power_split",
    "split_power": "bess.split.power_split",
    "Hindsight": "bess.retrospect",
    "hindsight": "bess.retrospect",
    "Rollout": "bess.split.rollout",
    "rollout": "bess.split.rollout",
    "SweepResult": "bess.sweep",
    "run_sweep": "bess.sweep",
    "write_report": "bess.report",
}

__all__ = [
    "BessError",
    "Fleet",
    "GroupResult",
    "Hindsight",
    "InputError",
    "Objective",
    "Objectives",
    "Plan",
    "Plant",
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
