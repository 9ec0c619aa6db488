"""Scenario sets and Pareto sweeps on Dask."""

from bess.simulation.sweep.run import SweepResult, run_sweep

__all__ = ["SweepResult", "run_sweep"]
