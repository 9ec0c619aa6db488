"""Standard output is for results: what HiGHS prints there by itself goes to standard error."""

import ctypes
import os

import numpy as np
import scipy.optimize

from bess.dispatch import Arbitrage, PerfectForecast


def test_what_the_solver_prints_does_not_reach_standard_output(capfd, monkeypatch):
    solve = scipy.optimize.linprog

    def talkative(*arguments, **options):
        ctypes.CDLL(None).printf(b"buffered by the C library\n")
        os.write(1, b"written at once\n")
        return solve(*arguments, **options)

    monkeypatch.setattr(scipy.optimize, "linprog", talkative)
    plan = Arbitrage(
        PerfectForecast(np.tile([10.0, 90.0], 48)), np.zeros(96, dtype=int), power_kw=100.0, energy_kwh=200.0
    ).plan(0, 100.0)
    print("result")
    said = capfd.readouterr()
    assert plan.max() > 0.0
    assert said.out == "result\n"
    assert "buffered by the C library" in said.err and "written at once" in said.err
