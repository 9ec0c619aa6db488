"""Random plants, states and demands for plans."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import bess
from bess.control.planning import Plan, Planner, PlanPrices

Array = NDArray[np.float64]

DT_H = 0.25
ENERGY = bess.Objectives.energy(start_kwh=0.0)
ROUNDING = 1e-7
"""Relative rounding of costs: at the largest power of a cell a double root halves the digits of a current."""


def differing(n_strings: int, rng: np.random.Generator) -> bess.System:
    """Strings that differ in size, inverter, resistance and SOC window."""
    document = copy.deepcopy(bess.System.reference(n_strings).document)
    document["string"] = [
        {
            "battery": {
                "cells_parallel": int(rng.integers(3, 6)),
                "r_scale": float(rng.uniform(0.3, 1.6)),
                "soc_min": [0.0, 0.05][m % 2],
                "soc_max": [1.0, 0.95][m % 2],
            },
            "inverter": {"nominal_kw": float(rng.uniform(60.0, 110.0))},
        }
        for m in range(n_strings)
    ]
    return bess.System(document, name="differing")


@dataclass(frozen=True)
class Case:
    """What a plan is made for; limits in each step, ``(n_strings, n_steps)``."""

    system: bess.System
    state: bess.State
    demand_kw: Array
    limit_kw: Array
    prices: PlanPrices

    @property
    def later_limit_kw(self) -> Array:
        """The limits as they are expected a step later."""
        return np.append(self.limit_kw[:, 1:], self.limit_kw[:, -1:], axis=1)

    def plan(self, planner: Planner) -> Plan:
        return planner(self.state, self.demand_kw, self.prices, limit_kw=self.limit_kw)

    def check(self, plan: Plan) -> None:
        """What holds for every plan: it shares out the demand, within the limits, in its direction."""
        asked = self.demand_kw - np.copysign(plan.unmet_kw, self.demand_kw)
        np.testing.assert_allclose(
            plan.request_kw.sum(axis=0), asked, atol=1e-9 * self.system.nominal_kw.sum()
        )
        assert np.all(np.abs(plan.request_kw) <= self.limit_kw * (1.0 + 1e-9))
        assert np.all(plan.request_kw * np.sign(self.demand_kw) >= 0.0)
        assert not np.any(plan.request_kw[:, self.demand_kw == 0.0])


def case(seed: int, n_strings: int, n_steps: int) -> Case:
    """Differing strings, far apart; a demand that turns and pauses; limits and outages, one for a while."""
    rng = np.random.default_rng(seed)
    system = differing(n_strings, rng)
    low = np.array([string.battery.soc_min for string in system.strings])
    high = np.array([string.battery.soc_max for string in system.strings])
    state = bess.State(rng.uniform(low, high), rng.uniform(10.0, 55.0, n_strings))
    sign = rng.choice([-1.0, 0.0, 1.0], n_steps, p=[0.4, 0.2, 0.4])
    demand = sign * rng.uniform(0.02, 1.1, n_steps) * system.nominal_kw.sum()
    limit = system.nominal_kw * rng.choice([0.0, 0.5, 1.0], n_strings, p=[0.15, 0.15, 0.7])
    limit = limit[:, None].repeat(n_steps, axis=1)
    first, last = np.sort(rng.integers(0, n_steps + 1, 2))
    limit[rng.integers(n_strings), first:last] *= rng.choice([0.0, 0.5])
    return Case(system, state, demand, limit, PlanPrices.energy(ENERGY, n_strings, n_steps))


def by_hand(
    case: Case, request_kw: Array, end_eur_ah: float = 0.0, *, first_step_weight: float = 1.0
) -> float:
    """Cost of a schedule without a price of balance, from a roll-out of the control model."""
    prices = case.prices.losses.copy()
    prices[0, :2] *= first_step_weight
    roll = bess.rollout(case.system, case.state, request_kw, DT_H, model="midpoint")
    losses = [
        roll.availability_loss_kw,
        roll.derating_loss_kw,
        roll.inverter_loss_kw,
        roll.battery_loss_kw,
    ]
    cost = sum(float((price * loss).sum()) * DT_H for price, loss in zip(prices.T, losses, strict=True))
    battery = [string.battery for string in case.system.strings]
    full_or_empty = np.array([b.soc_max if end_eur_ah < 0.0 else b.soc_min for b in battery])
    return cost + end_eur_ah * float((case.system.capacity_ah * (roll.soc[:, -1] - full_or_empty)).sum())
