"""Claim: what a run has lost is what the published laws make of its record, recounted with other tools."""

from __future__ import annotations

import numpy as np
import pytest
import rainflow
from numpy.typing import NDArray
from published import PUBLISHED

import bess

pytestmark = pytest.mark.independent

STEP_H = 0.25
START_C, START_SOC = [25.0, 40.0], [0.5, 0.3]


def recount(model: str, soc: NDArray[np.float64], temperature_c: NDArray[np.float64]) -> tuple[float, float]:
    """Losses by standing and by cycling of states at the ends of steps, the first one at the start."""
    mean_c = 0.5 * (temperature_c[1:] + temperature_c[:-1])
    standing = 0.0
    for at_soc, at_c in zip(0.5 * (soc[1:] + soc[:-1]), mean_c, strict=True):
        law, _ = PUBLISHED[model](at_c, at_soc, 0.8, 0.5)
        standing += law.rate ** (1.0 / law.exponent) * STEP_H / 24.0
    travel = np.abs(np.diff(soc))
    moved = np.concatenate([[0.0], np.cumsum(travel)])
    warmth = np.concatenate([[0.0], np.cumsum(travel * mean_c)])
    hours = np.concatenate([[0.0], np.cumsum((travel > 0.0) * STEP_H)])
    cycling, exponent = 0.0, PUBLISHED[model](25.0, 0.5, 0.8, 0.5)[1].exponent
    for depth, _, count, first, last in rainflow.extract_cycles(soc):
        if depth == 0.0:
            continue
        way = moved[last] - moved[first]
        c_rate = way / (hours[last] - hours[first])
        # The fit of nmc-a-75ah changes its sign at small depths.
        fitted = max(depth, 0.2) if model == "nmc-a-75ah" else depth
        _, law = PUBLISHED[model]((warmth[last] - warmth[first]) / way, 0.5, fitted, c_rate)
        cycling += law.rate ** (1.0 / exponent) * count * depth
    law, _ = PUBLISHED[model](25.0, 0.5, 0.8, 0.5)
    return standing**law.exponent, cycling**exponent


@pytest.mark.parametrize("model", PUBLISHED)
def test_losses_are_recounted_from_the_record(model: str) -> None:
    rng = np.random.default_rng(7)
    system = bess.System(bess.System.reference(2).document | {"wear": {"model": model}})
    plant = bess.Plant(system, bess.State(START_SOC, START_C))
    # Long and short ranges, rests, and power that leaves the strings full and empty.
    request = np.repeat(rng.uniform(-92.0, 92.0, size=(120, 2)), rng.integers(1, 9, size=120), axis=0)
    request[rng.random(len(request)) < 0.15] = 0.0
    flows = plant.run(request)
    for string in range(2):
        soc = np.concatenate([[START_SOC[string]], flows.soc[:, string]])
        temperature_c = np.concatenate([[START_C[string]], flows.temperature_c[:, string]])
        standing, cycling = recount(model, soc, temperature_c)
        assert flows.calendar_loss[-1, string] == pytest.approx(standing, rel=1e-9)
        assert flows.cyclic_loss[-1, string] == pytest.approx(cycling, rel=1e-9)
