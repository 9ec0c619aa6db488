r"""Relaxed model of one string: every coefficient has its most favourable value within a level of charge.

The energy above the lower SOC limit is divided into levels. Within a level, the tables of the plant are
replaced by the values of minimum loss, so the relaxed cost never exceeds the cost of the plant
(``docs/hindsight.md`` has the proofs).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from bess.arrays import Array
from bess.convexity import Lines, chord_above, convex_below, line_above, lines_above, lines_below
from bess.simulation.hindsight.cells import CHARGE, DISCHARGE, Cells, between
from bess.system.battery import Battery
from bess.system.parse import StringParameters

Law = Literal["table", "pi"]

MAX_TEMPERATURE_K = 500.0
"""Upper limit of the cell temperature above its surroundings [K]."""
_LEVELS = {True: ((0.15, 0.3, 0.5, 0.75, 1.0), 9), False: ((0.2, 1.0), 3)}
"""Level edges below the low-SOC switch, as shares of it, and number of edges above; fine or coarse."""


@dataclass(frozen=True)
class Band:
    """A range of the excess temperature ``theta`` [K] of strings that are on, without derating or with it."""

    theta_k: tuple[float, float]
    conductance: Array
    """``(2, 2)``: ``G <= first + second * theta`` for a string at the mean excess temperature ``theta``."""
    derating: Lines
    """Upper bounds of the derating factor: lines over ``theta``."""


@dataclass(frozen=True)
class RelaxedString:
    """A string, or several identical strings; coefficients have a row for charge and one for discharge.

    ``theta`` is the mean over the nodes of a string of their temperature excess over ``coldest_c``.
    """

    cells: Cells
    nominal_kw: float
    standby_kw: float
    """Nominal power, and loss of an inverter that is off."""
    edges: Array
    """``(n_levels + 1,)``: SOC at the edges of the levels."""
    ratio: Array
    """``(2, n_levels)``: change of stored energy per chemical energy ``V I dt`` [kWh/kWh]: minimum in
    discharge, maximum in charge."""
    ratio_against: Array
    """``(2, n_levels)``: the opposite limits of this ratio: maximum in discharge, minimum in charge."""
    root: Array
    """``(2, n_levels)``: heat [kW] is at least ``(sum_l root_l x_l)^2 / G`` for chemical powers ``x_l`` [kW]
    and the conductance ``G`` of a band."""
    bands: list[Band]
    """Ranges of ``theta`` from 0 to its maximum at which a string delivers power."""
    loss: list[Lines]
    """Lower bounds of the loss of an inverter that is on [kW]: lines over delivered power [kW]."""
    max_loss: Array
    """``(2, 2)``: intercept and slope of the upper bound of this loss."""
    max_heat: Array
    """``(2, n_levels)``: upper bound of the heat, as a share of the chemical power."""
    burnt_kw: tuple[float, float]
    """Maximum charging power without stored energy, because the inverter loss exceeds it, and the maximum
    heat of this power in the cells [kW]."""

    @property
    def energy_kwh(self) -> Array:
        """Energy of every level, shape ``(n_levels,)``."""
        return self.stored_kwh(self.edges[-1])

    def stored_kwh(self, soc: float) -> Array:
        """Energy in every level of a string at ``soc``, shape ``(n_levels,)``.

        The maximum discharge voltage and the capacity at the start define it.
        """
        at, cells = np.minimum(self.edges, max(soc, self.edges[0])), self.cells
        fine = np.unique([*at, *between(cells.soc, at[0], at.max())])
        voltage_v = np.interp(fine, cells.soc, cells.highest_v[DISCHARGE])
        steps = np.diff(fine) * (voltage_v[1:] + voltage_v[:-1]) / 2.0
        energy_kwh = np.concatenate([[0.0], np.cumsum(steps)]) * cells.capacity_ah / 1e3
        return np.diff(np.interp(at, fine, energy_kwh))


def relaxed_string(
    string: StringParameters,
    *,
    coldest_c: float,
    plant_step_s: float,
    law: Law,
    fine: bool,
    soh_capacity: float,
    soh_resistance: float,
) -> RelaxedString:
    """Return the coefficients of minimum loss from the tables of a string.

    Parameters
    ----------
    string
        Parameters of the string.
    coldest_c
        Lower limit of all temperatures of the string [degC]: the minimum of start and ambient.
    plant_step_s
        Step of the plant [s], over which voltage and resistance are constant.
    law
        Derating law of the run.
    fine
        Divide the charge into thirteen levels instead of four.
    soh_capacity, soh_resistance
        State of health at the start; a string does not recover.
    """
    battery, inverter = string.battery, string.inverter
    cells = Cells.of(string, plant_step_s, soh_capacity, soh_resistance)
    edges = _edges(battery, fine)
    derating_c, factor = _derating(string, law)
    stop_c = _stop_c(derating_c, factor)
    hottest_k = MAX_TEMPERATURE_K if stop_c is None else max(stop_c - coldest_c, 1e-6)
    start_k = derating_c[factor == factor.max()][-1] - coldest_c
    limits_k = np.unique([0.0, np.clip(start_k, 0.0, hottest_k), hottest_k])
    bands_k = list(pairwise(limits_k.tolist()))
    resistance_c = np.array(battery.resistance_axes[1])
    ends_c = [*(coldest_c + limits_k), coldest_c + 2.0 * MAX_TEMPERATURE_K]
    warm_c = np.unique([*ends_c, *resistance_c[resistance_c > coldest_c]])

    levels, root, conductance = [], [], []
    for direction in (CHARGE, DISCHARGE):
        limits = [cells.level(direction, low, high, warm_c) for low, high in pairwise(edges.tolist())]
        resistance = np.array([level.min_ohm for level in limits])
        base = convex_below(warm_c, resistance.min(axis=0))
        top_v = np.array([level.top_v for level in limits])
        levels.append(limits)
        root.append(np.sqrt(1e3 * (resistance / base).min(axis=1)) / top_v)
        in_band_c = (between(warm_c, coldest_c + low_k, coldest_c + high_k) for low_k, high_k in bands_k)
        conductance.append(
            [chord_above(each - coldest_c, 1.0 / np.interp(each, warm_c, base)) for each in in_band_c]
        )

    def band(theta_k: tuple[float, float], conductance: Array) -> Band:
        derated_k = between(derating_c - coldest_c, *theta_k)
        factors = np.interp(coldest_c + derated_k, derating_c, factor)
        return Band(theta_k, conductance, lines_above(derated_k, factors))

    load, nominal_kw = np.array(inverter.load), inverter.nominal_kw
    losses = [np.array(inverter.loss_charge), np.array(inverter.loss_discharge)]
    least, most = [lines_below(load, loss) for loss in losses], [line_above(load, loss) for loss in losses]
    burnt_kw = nominal_kw * max(inverter.loss_charge)
    return RelaxedString(
        cells=cells,
        nominal_kw=nominal_kw,
        standby_kw=inverter.off_loss * nominal_kw,
        edges=edges,
        ratio=np.array([[level.ratio for level in limits] for limits in levels]),
        ratio_against=np.array([[level.ratio_against for level in limits] for limits in levels]),
        root=np.array(root),
        bands=list(map(band, bands_k, np.array(conductance).swapaxes(0, 1))),
        loss=[(nominal_kw * intercept, slope) for intercept, slope in least],
        max_loss=np.array([(nominal_kw * intercept, slope) for intercept, slope in most]),
        max_heat=np.array([[level.max_heat for level in limits] for limits in levels]),
        burnt_kw=(burnt_kw, cells.max_heat_kw(burnt_kw, warm_c)),
    )


def _edges(battery: Battery, fine: bool) -> Array:
    """SOC levels: narrow below the switch, where the resistance rises, and wider above."""
    low, high = battery.soc_min, battery.soc_max
    switch = battery.low_soc_switch
    shares, count = _LEVELS[fine]
    below = switch * np.array(shares)
    above = np.linspace(max(low, switch), high, count)
    inside = np.concatenate([below, above])
    return np.unique([low, *inside[(inside > low) & (inside < high)], high])


def _derating(string: StringParameters, law: Law) -> Lines:
    """Knots of the maximum derating factor over temperature [degC]."""
    derating = string.derating
    if law == "pi" and derating.kp_per_k > 0.0:
        # The integral part only lowers the factor further.
        return np.array([derating.start_c, derating.start_c + 1.0 / derating.kp_per_k]), np.array([1.0, 0.0])
    if law == "pi":
        return np.array([derating.start_c]), np.array([1.0])
    return np.array(derating.temperature_c), np.array(derating.factor)


def _stop_c(temperature_c: Array, factor: Array) -> float | None:
    """Temperature above which no power is delivered, if any."""
    if factor[-1] > 0.0:
        return None
    positive = np.flatnonzero(factor > 0.0)
    return float(temperature_c[positive[-1] + 1] if positive.size else temperature_c[0])
