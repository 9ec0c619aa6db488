"""The record of a run on disk: parts and checkpoints, identity, log, and the dataset they become."""

from bess.record.result import Result, open_result, scenario_directories

__all__ = ["Result", "open_result", "scenario_directories"]
