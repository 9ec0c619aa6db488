"""The power split against exhaustive search on inverters whose loss is not convex, and on measured cells.

Two equal strings, four steps, the weightings of the paper's case 2. The referee knows neither the package's
optimiser nor its core; for measured cells it reads the resistance table here, in plain NumPy.
"""

import copy
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.convexity import convex_below
from bess.system.components.registry import CELLS, INVERTERS

sys.path.insert(0, str(Path(__file__).parent))
from referee import Referee, StringModel

pytestmark = pytest.mark.exhaustive

STEPS = 4
SEEDS = 10
WEIGHTS = {"ones": (1.0, 1.0, 1.0), "S1": (1.0, 1.0, 0.0), "S2": (1.0, 0.5, 0.5), "S3": (1.0, 0.0, 1.0)}

STEPPED = {
    "nominal_kw": 100.0,
    "load": [0.0, 0.24, 0.26, 0.49, 0.51, 0.74, 0.76, 1.0],
    "loss_charge": [0.004, 0.010, 0.007, 0.0135, 0.0105, 0.018, 0.0145, 0.023],
    "loss_discharge": [0.005, 0.012, 0.0085, 0.016, 0.0125, 0.021, 0.017, 0.027],
}
"""Neither convex nor monotone: the loss falls wherever one more of four power stages takes over."""

CELL_COUNTS = {"sony-lfp-3ah": (220, 125), "samsung-94ah": (192, 4)}


@dataclass(frozen=True)
class MeasuredString(StringModel):
    """A string whose resistance was measured over SOC, temperature and C-rate, for each direction."""

    def coefficients(self, sign, soc, tau):
        """``R`` is read at the controller's C-rate, linear between the knots, constant outside."""
        battery, derating = self.parameters.battery, self.parameters.derating
        table = battery.resistance_table
        blocks = np.array(table.discharge_mohm if sign > 0 else table.charge_mohm)
        at_rate = np.array(
            [
                [
                    np.interp(table.control_c_rate, table.c_rate, blocks[:, i, j])
                    for j in range(blocks.shape[2])
                ]
                for i in range(blocks.shape[1])
            ]
        )
        rows = np.stack([np.interp(soc, table.soc, row) for row in at_rate])
        position = np.interp(tau, table.temperature_c, np.arange(len(rows)))
        low = np.minimum(np.floor(position).astype(int), len(rows) - 2)
        part = position - low
        pick = np.indices(position.shape)
        mohm = (1.0 - part) * rows[(low, *pick)] + part * rows[(low + 1, *pick)]
        ocv = battery.ocv_v.discharge[0] if sign > 0 else battery.ocv_v.charge[0]
        k = np.interp(tau, derating.temperature_c, derating.factor)
        v = np.interp(soc, battery.ocv_v.soc, ocv) * battery.cells_series
        return k, v, mohm * 1e-3 * battery.r_scale * battery.cells_series / battery.cells_parallel


@dataclass(frozen=True)
class MeasuredReferee(Referee):
    """The same search over strings of measured cells."""

    @property
    def strings(self):
        return [MeasuredString(s) for s in self.system.strings]


def system_with(section, table):
    document = copy.deepcopy(bess.System.reference().document)
    document[section] = table
    return bess.System(document)


def system_with_cell(cell):
    series, parallel = CELL_COUNTS[cell]
    return system_with("battery", {"cell": cell, "cells_series": series, "cells_parallel": parallel})


def regular_case(system, seed):
    """Strings within 30 and 70 % SOC that can deliver all of the demand over the four steps."""
    rng = np.random.default_rng(seed)
    power_kw = min(float(system.nominal_kw[0]), 0.4 * float(system.nominal_energy_kwh[0]))
    state = bess.State(rng.uniform(0.3, 0.7, 2), rng.uniform(25.0, 40.0, 2))
    return state, rng.uniform(0.04, 1.96, STEPS) * power_kw * rng.choice([-1.0, 1.0])


def excesses(system, referee_type=Referee):
    """Check ``SEEDS`` states; return by how much each objective exceeds that of exhaustive search,
    relative."""
    found = []
    for name, weights in WEIGHTS.items():
        objectives = bess.Objectives(derating=weights[0], inverter=weights[1], battery=weights[2])
        splitter = bess.PowerSplit(system, STEPS, objectives, node_limit=10)
        for seed in range(SEEDS):
            where = f"{name}, seed {seed}"
            state, demand_kw = regular_case(system, seed)
            splitter.warm_start = None
            split = splitter(state, demand_kw)
            referee = referee_type(system, state, demand_kw)
            min_kw, best = referee.best(weights)
            losses = referee.follow(np.abs(split.request_kw)[None])

            np.testing.assert_allclose(split.request_kw.sum(axis=0), demand_kw, atol=1e-6, err_msg=where)
            assert losses[0, 0] == pytest.approx(split.availability_loss_kw, abs=1e-6), where
            assert referee.objective(losses, weights)[0] == pytest.approx(split.objective, rel=1e-9), where
            assert split.availability_loss_kw <= min_kw + 0.05, where
            assert split.bound <= min(best, split.objective) * (1.0 + 1e-9), where
            found.append(split.objective / best - 1.0)
    return np.array(found)


def envelope_distance(inverter):
    """Largest distance between a loss table and its convex envelope, as a fraction of nominal power."""
    return max(
        (np.array(loss) - convex_below(np.array(inverter.load), np.array(loss))).max()
        for loss in (inverter.loss_charge, inverter.loss_discharge)
    )


@pytest.mark.parametrize("model", [name for name in INVERTERS if name not in ("kaco-92", "m5bat-630")])
def test_split_is_that_of_exhaustive_search_on_every_bundled_inverter(model):
    assert excesses(system_with("inverter", {"model": model})).max() <= 1e-3


def test_split_is_that_of_exhaustive_search_on_a_loss_that_falls_in_steps():
    found = excesses(system_with("inverter", STEPPED))
    assert np.quantile(found, 0.95) <= 1e-3
    assert found.max() <= 2e-3


@pytest.mark.parametrize("cell", [name for name in CELLS if name != "nmc-reference"])
def test_split_is_that_of_exhaustive_search_on_every_measured_cell(cell):
    assert excesses(system_with_cell(cell), MeasuredReferee).max() <= 1e-3


def test_tables_that_are_not_convex_are_the_sinamics_and_the_stepped_one():
    sinamics = system_with("inverter", {"model": "sinamics-s120"}).strings[0].inverter
    stepped = system_with("inverter", STEPPED).strings[0].inverter
    princeton = system_with("inverter", {"model": "princeton-gtib-100"}).strings[0].inverter
    assert envelope_distance(sinamics) == pytest.approx(0.0052, abs=1e-4)
    assert envelope_distance(stepped) == pytest.approx(0.0044, abs=1e-4)
    assert envelope_distance(princeton) <= 1e-9, "Sandia curves with C0 < 0 are convex in AC power"
