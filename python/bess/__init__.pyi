"""The public names of the package and their modules; ``__init__.py`` reads them from here."""

from bess.control.objectives import Objective as Objective
from bess.control.objectives import Objectives as Objectives
from bess.control.planning import Plan as Plan
from bess.control.planning import plan_power as plan_power
from bess.control.rollout import Rollout as Rollout
from bess.control.rollout import rollout as rollout
from bess.control.split.power_split import PowerSplit as PowerSplit
from bess.control.split.power_split import split_power as split_power
from bess.control.split.result import GroupResult as GroupResult
from bess.control.split.result import Split as Split
from bess.control.split.result import SplitStatus as SplitStatus
from bess.dispatch.plan import plan_dispatch as plan_dispatch
from bess.dispatch.store_value import StoreValue as StoreValue
from bess.dispatch.store_value import store_value as store_value
from bess.errors import BessError as BessError
from bess.errors import InputError as InputError
from bess.errors import StoppedEarly as StoppedEarly
from bess.market import read_prices as read_prices
from bess.market import read_weather as read_weather
from bess.plant import Plant as Plant
from bess.plant import PlantEnsemble as PlantEnsemble
from bess.report import write_report as write_report
from bess.simulation.analysis.kpis import kpis as kpis
from bess.simulation.analysis.settlement import ledger as ledger
from bess.simulation.hindsight import Hindsight as Hindsight
from bess.simulation.hindsight import hindsight as hindsight
from bess.simulation.record import Result as Result
from bess.simulation.record import open_result as open_result
from bess.simulation.runner import run as run
from bess.simulation.sweep import SweepResult as SweepResult
from bess.simulation.sweep import run_scenarios as run_scenarios
from bess.simulation.sweep import run_sweep as run_sweep
from bess.study import Study as Study
from bess.study import load_study as load_study
from bess.system import State as State
from bess.system import System as System
from bess.system import load_system as load_system
from bess.system.components import inverter_from_efficiency as inverter_from_efficiency
from bess.system.components import inverter_from_loss as inverter_from_loss
from bess.system.components import inverter_from_sandia as inverter_from_sandia
from bess.system.components import read_inverter as read_inverter

__version__: str
