r"""Relaxed model of one string: every coefficient has its most favourable value within a level of charge.

The energy above the lower SOC limit is divided into levels. Within a level, the tables of the plant are
replaced by the values of minimum loss, so the relaxed cost never exceeds the cost of the plant
(``docs/hindsight.md`` has the proofs).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from bess.arrays import Array
from bess.convexity import Lines, chord_above, convex_below, line_above, lines_above, lines_below
from bess.system.battery import Battery
from bess.system.parse import StringParameters

_Pick = Callable[..., Any]
Law = Literal["table", "pi"]

CHARGE, DISCHARGE = 0, 1
"""Rows of the coefficients of both directions of power."""

MAX_TEMPERATURE_K = 500.0
"""Upper limit of the cell temperature above its surroundings [K]."""
_MIN_HEALTH = 0.2
"""Minimum capacity of a string in use, as a share of its initial capacity."""
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
    ages: bool
    """Whether capacity may fall, and with it the energy at a given SOC."""
    burnt_kw: tuple[float, float]
    """Maximum charging power without stored energy, because the inverter loss exceeds it, and the maximum
    heat of this power in the cells [kW]."""
    voltage_v: tuple[Array, Array]
    """SOC, and the maximum discharge voltage at each, which defines the stored energy."""
    capacity_ah: float
    """Capacity at the start."""

    @property
    def energy_kwh(self) -> Array:
        """Energy of every level, shape ``(n_levels,)``."""
        return self.stored_kwh(self.edges[-1])

    def stored_kwh(self, soc: float) -> Array:
        """Energy in every level of a string at ``soc``, shape ``(n_levels,)``."""
        at = np.minimum(self.edges, max(soc, self.edges[0]))
        knots = self.voltage_v[0]
        fine = np.unique([*at, *knots[(knots > at[0]) & (knots < at.max())]])
        voltage_v = np.interp(fine, *self.voltage_v)
        steps = np.diff(fine) * (voltage_v[1:] + voltage_v[:-1]) / 2.0
        energy_kwh = np.concatenate([[0.0], np.cumsum(steps)]) * self.capacity_ah / 1e3
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
    soc = np.array(battery.ocv_v.soc)
    volts = [
        np.array(rows) * battery.cells_series for rows in (battery.ocv_v.charge, battery.ocv_v.discharge)
    ]
    highest_v, lowest_v = [rows.max(axis=0) for rows in volts], [rows.min(axis=0) for rows in volts]
    min_v = np.minimum(*lowest_v)
    capacity_ah = battery.cell_capacity_ah * battery.cells_parallel * soh_capacity
    max_kw = inverter.nominal_kw * (1.0 + max(*inverter.loss_charge, *inverter.loss_discharge))
    # An aged string has less capacity, so its SOC changes more per step.
    min_ah = capacity_ah * (_MIN_HEALTH if string.wear.cell_model else 1.0)
    switch = battery.low_soc_switch
    resistance_soc, resistance_c = map(np.array, battery.resistance_axes)
    tables = np.unique([*soc, *resistance_soc, switch, np.nextafter(switch, 0.0)])

    def current_a(low: float, max_ohm: float) -> float:
        """Maximum current [A] above a SOC and below a resistance."""
        volt = float(np.interp(low, soc, min_v))
        root = math.sqrt(max(volt**2 - 4e3 * max_ohm * max_kw, 0.0))
        return 2e3 * max_kw / (volt + root)

    def travel(low: float, max_ohm: float) -> float:
        """Maximum SOC change of a plant step that starts above ``low``, at a resistance up to ``max_ohm``."""
        return current_a(low, max_ohm) * plant_step_s / 3600.0 / min_ah

    derating_c, factor = _derating(string, law)
    stop_c = _stop_c(derating_c, factor)
    hottest_k = MAX_TEMPERATURE_K if stop_c is None else max(stop_c - coldest_c, 1e-6)
    start_k = derating_c[factor == factor.max()][-1] - coldest_c
    limits_k = np.unique([0.0, np.clip(start_k, 0.0, hottest_k), hottest_k])
    ends_c = [*(coldest_c + limits_k), coldest_c + 2.0 * MAX_TEMPERATURE_K]
    warm_c = np.unique([*ends_c, *resistance_c[resistance_c > coldest_c]])
    in_band_c = [_between(warm_c, *ends) for ends in pairwise(coldest_c + limits_k)]

    edges = _edges(battery, fine)
    wide = battery.soc_min, battery.soc_max
    furthest = travel(wide[0], np.inf)
    rows = []
    for direction, sign, losses, favourable_v, adverse_v, best, worst in (
        (CHARGE, -1, inverter.loss_charge, lowest_v, highest_v, np.max, np.min),
        (DISCHARGE, 1, inverter.loss_discharge, highest_v, lowest_v, np.min, np.max),
    ):
        limits, ohm = [], []
        for low, high in pairwise(edges.tolist()):
            # Within a plant step, voltage and resistance keep their values at its start.
            near = max(low - furthest, wide[0]), min(high + furthest, wide[1])
            max_ohm = _ohm(battery, direction, _between(tables, *near), warm_c, np.max).max() * soh_resistance
            shift = sign * (furthest if string.wear.cell_model else travel(near[0], max_ohm))
            within = _between(np.concatenate([tables, tables - shift]), low, high)
            stored_v = np.interp(within, soc, highest_v[DISCHARGE])
            began = _between(
                tables, max(low + min(shift, 0.0), wide[0]), min(high + max(shift, 0.0), wide[1])
            )
            ohm.append(_ohm(battery, direction, began, warm_c, np.min) * soh_resistance)
            limits.append(
                (
                    best(stored_v / np.interp(within + shift, soc, favourable_v[direction])),
                    worst(stored_v / np.interp(within, soc, adverse_v[direction])),
                    np.interp(began, soc, highest_v[direction]).max(),
                    max_ohm * current_a(near[0], max_ohm) / float(np.interp(near[0], soc, min_v)),
                )
            )
        ratio, ratio_against, top_v, max_heat = np.array(limits).T
        resistance = np.array(ohm)
        base = convex_below(warm_c, resistance.min(axis=0))
        load, loss = np.array(inverter.load), np.array(losses)
        loss_0, loss_slope = lines_below(load, loss)
        max_0, max_slope = line_above(load, loss)
        rows.append(
            (
                ratio,
                ratio_against,
                np.sqrt(1e3 * (resistance / base).min(axis=1)) / top_v,
                [chord_above(each - coldest_c, 1.0 / np.interp(each, warm_c, base)) for each in in_band_c],
                (inverter.nominal_kw * max_0, max_slope),
                max_heat,
                (inverter.nominal_kw * loss_0, loss_slope),
            )
        )
    *coefficients, loss_lines = zip(*rows, strict=True)
    ratio, ratio_against, root, conductance, max_loss, max_heat = map(np.array, coefficients)

    burnt_kw = inverter.nominal_kw * max(inverter.loss_charge)
    worst_ohm = _ohm(battery, CHARGE, _between(tables, *wide), warm_c, np.max).max() * soh_resistance

    def band(theta_k: tuple[float, float], conductance: Array) -> Band:
        derated_k = _between(derating_c - coldest_c, *theta_k)
        factors = np.interp(coldest_c + derated_k, derating_c, factor)
        return Band(theta_k, conductance, lines_above(derated_k, factors))

    return RelaxedString(
        nominal_kw=inverter.nominal_kw,
        standby_kw=inverter.off_loss * inverter.nominal_kw,
        edges=edges,
        ratio=ratio,
        ratio_against=ratio_against,
        root=root,
        bands=list(map(band, pairwise(limits_k.tolist()), conductance.swapaxes(0, 1))),
        loss=list(loss_lines),
        max_loss=max_loss,
        max_heat=max_heat,
        ages=string.wear.cell_model is not None,
        burnt_kw=(burnt_kw, 1e-3 * worst_ohm * (2e3 * burnt_kw / min_v.min()) ** 2),
        voltage_v=(soc, highest_v[DISCHARGE]),
        capacity_ah=capacity_ah,
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


def _between(knots: Array, low: float, high: float) -> Array:
    """Ends and inner knots of an interval; between them a ratio of straight lines is monotone."""
    return np.unique([low, *knots[(knots > low) & (knots < high)], high])


def _ohm(battery: Battery, direction: int, soc: Array, temperature_c: Array, pick: _Pick) -> Array:
    """Minimum (or maximum) resistance of a string [Ohm] over SOC and C-rate at each temperature.

    Between these temperatures the minimum lies above the straight line, because it is linear for each SOC.
    """
    ohm = 1e-3 * battery.r_scale * battery.cells_series / battery.cells_parallel
    table = battery.resistance_table
    if table is not None:
        blocks = np.array(table.discharge_mohm if direction == DISCHARGE else table.charge_mohm)
        rows = [[pick(np.interp(soc, table.soc, row)) for row in rows] for rows in blocks]
        return ohm * np.interp(temperature_c, table.temperature_c, pick(np.array(rows), axis=0))
    over_t, over_soc = battery.resistance_temperature, battery.resistance_soc
    assert over_t is not None and over_soc is not None
    at = np.interp(temperature_c, over_t.temperature_c, over_t.resistance_mohm)
    at_25 = np.interp(25.0, over_t.temperature_c, over_t.resistance_mohm)
    low = soc < battery.low_soc_switch
    factor = np.where(low, np.interp(soc, over_soc.soc, over_soc.resistance_mohm) / at_25, 1.0)
    return np.asarray(ohm * at * pick(factor))


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
