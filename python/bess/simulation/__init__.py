"""The closed loop: a study's inputs, the policy and the plant, step by step into a record."""

from bess.simulation.runner import run
from bess.simulation.scenario_run import prepare_folder, run_scenarios, write_summary

__all__ = ["prepare_folder", "run", "run_scenarios", "write_summary"]
