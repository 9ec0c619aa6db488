"""Scenario sets and Pareto sweeps on Dask."""

from bess.sweep.run import SweepResult, run_sweep

__all__ = ["SweepResult", "run_sweep"]
