"""Studies, the closed loop, and its results on disk."""

from bess.simulation.result import Result, open_result, scenario_directories
from bess.simulation.runner import run
from bess.simulation.scenario_run import prepare_folder, run_scenarios, write_summary
from bess.simulation.scenarios import expand
from bess.simulation.study import Study, bundled_studies, load_study

__all__ = [
    "Result",
    "Study",
    "bundled_studies",
    "expand",
    "load_study",
    "open_result",
    "prepare_folder",
    "run",
    "run_scenarios",
    "scenario_directories",
    "write_summary",
]
