"""The record of a run on disk: parts and checkpoints, provenance, log, and dataset."""

from bess.simulation.record.result import Result, open_result, scenario_directories

__all__ = ["Result", "open_result", "scenario_directories"]
