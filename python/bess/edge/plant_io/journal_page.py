"""Report of a journal: actual power of the plant compared with the computed set-points."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from bess.arrays import Array
from bess.control.rollout import rollout
from bess.edge.plant_io.journal import open_journal
from bess.errors import InputError
from bess.files import parse_toml
from bess.report.contents import FigureSpec
from bess.report.data import TimeAxis, curve, step_h, string_curves
from bess.report.drawing.chart import Chart, Panel
from bess.report.drawing.style import AVAILABILITY, DISCHARGE, INK
from bess.report.page import FIGURES, section, write_page
from bess.report.words.headline import Tile
from bess.system import State, System

MAX_BINS: Final = 1500
_BIN_S: Final = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 86_400)
_GAP: Final = 3.0
"""Minimum length of a gap between readings, relative to their usual interval."""
_SAME_POWER: Final = 0.02
"""Share of nominal power within which two splits serve the same demand."""


def write_journal_report(directory: Path) -> Path:
    """Write ``report.html`` and ``figures/`` for the journal of a plant; return the page."""
    journal = open_journal(directory)
    binned = in_bins(journal)
    try:
        system = System(parse_toml(journal.attrs["system"]), name=f"{directory}: system")
    except ValueError as error:
        raise InputError(f"{directory}: the system in the journal is damaged ({error})") from error
    losses = modelled_losses(binned, system)
    values = {
        "title": journal.attrs["title"] or directory.resolve().name,
        "subject": _subject(journal),
        "summary": [*_summary(journal), *([losses.sentence()] if losses is not None else [])],
        "tiles": list(_tiles(journal)),
        "warnings": list(_warnings(journal)),
        "sections": [section("time", "Over time", _figures(binned), directory / FIGURES)],
        "groups": {},
        "names": [""],
        "studies": {"The system": journal.attrs["system"]},
        "made_with": journal.attrs["bess_version"],
    }
    return write_page(directory, values)


def in_bins(journal: xr.Dataset) -> xr.Dataset:
    """Return means over equal bins of time, at most :data:`MAX_BINS`; NaN without readings."""
    times_s, _, usual_s = _intervals(journal)
    needed_s = max((times_s[-1] - times_s[0]) / (MAX_BINS - 1), usual_s or 1.0)
    width_s = next((width for width in _BIN_S if width >= needed_s), _BIN_S[-1])
    bins = journal.astype(np.float64).resample(time=f"{width_s}s", origin="epoch").mean(keep_attrs=True)
    return bins.assign_attrs(step_h=width_s / 3600.0)


def _intervals(journal: xr.Dataset) -> tuple[Array, Array, float]:
    """Times of the readings, intervals between them, and the usual interval (0 for one reading) [s]."""
    times_s = journal["time"].values.astype("datetime64[ms]").astype(np.int64) / 1000.0
    steps_s = np.diff(times_s)
    return times_s, steps_s, float(np.median(steps_s)) if steps_s.size else 0.0


@dataclass(frozen=True)
class Losses:
    """Losses of both splits by the control model, while they serve the same plant power [kWh]."""

    did_kwh: float
    recommended_kwh: float
    hours: float
    of_hours: float

    def sentence(self) -> str:
        """Sentence of the summary."""
        return (
            f"Modelled losses of inverters and batteries, over {_number(self.hours)} of "
            f"{_number(self.of_hours)} h in which both splits gave the same plant power: "
            f"{_number(self.did_kwh)} kWh for the actual power, "
            f"{_number(self.recommended_kwh)} kWh for the computed set-points. Neither was measured."
        )


def modelled_losses(binned: xr.Dataset, system: System) -> Losses | None:
    """Compare both splits by the control model from the measured states; None if never comparable."""
    width_h = step_h(binned)
    powers = np.stack([binned["power_kw"].values, binned["recommended_kw"].values])  # (2, bins, strings)
    soc, temperature = binned["soc"].values, binned["temperature_c"].values
    temperature = np.where(np.isnan(temperature), system.ambient_c, temperature)
    read = np.isfinite(powers).all(axis=0) & np.isfinite(soc)
    did, recommended = np.where(read, powers, 0.0).sum(axis=2)
    one_way = ((powers >= 0.0).all(axis=2) | (powers <= 0.0).all(axis=2)).all(axis=0)
    nominal = system.nominal_kw
    same = np.abs(did - recommended) <= _SAME_POWER * nominal.sum()
    usable = np.flatnonzero(read.all(axis=1) & one_way & same & (np.abs(did) > 0.0))
    if not usable.size:
        return None
    lost = np.zeros(2)
    for k in usable:
        state = State(np.clip(soc[k], 0.0, 1.0), temperature[k])
        requests = np.clip(powers[:, k], -nominal, nominal)[..., None]
        roll = rollout(system, state, requests, width_h)
        lost += (roll.inverter_loss_kw + roll.battery_loss_kw).sum(axis=(1, 2)) * width_h
    return Losses(float(lost[0]), float(lost[1]), len(usable) * width_h, read.any(axis=1).sum() * width_h)


def _figures(binned: xr.Dataset) -> Iterator[FigureSpec]:
    time = TimeAxis(binned)
    time.daily = False  # the bins are few already, and a gap would hide its whole day
    plant = "Demand, actual power of the plant, and the sum of the computed set-points."
    yield FigureSpec("plant", "The plant", plant, partial(_plant, binned, time))
    split = "Actual power of each string, its computed set-point, and the difference."
    yield FigureSpec(
        "split", "The strings: actual power and set-points", split, partial(_split, binned, time)
    )
    state = "Measured state of charge and temperature; gaps without readings."
    yield FigureSpec("state", "State of the strings", state, partial(_state, binned, time))


def _plant(binned: xr.Dataset, time: TimeAxis) -> Chart:
    did, recommended = (_total(binned[name].values) for name in ("power_kw", "recommended_kw"))
    demand = binned["demand_kw"].values
    powers = curve(time, did, DISCHARGE, "actual", kind="step")
    powers += curve(time, recommended, AVAILABILITY, "computed", kind="step", dashed=True)
    powers += curve(time, demand, INK, "demand", kind="step", dashed=True)
    deviation = curve(time, did - demand, DISCHARGE, kind="step")
    return Chart(time.label, [Panel("Power (kW)", powers), Panel("Deviation from demand (kW)", deviation)])


def _split(binned: xr.Dataset, time: TimeAxis) -> Chart:
    did, recommended = binned["power_kw"].values, binned["recommended_kw"].values
    rows = (("Actual (kW)", did), ("Computed (kW)", recommended), ("Difference (kW)", did - recommended))
    return Chart(time.label, [Panel(label, string_curves(time, values)) for label, values in rows])


def _state(binned: xr.Dataset, time: TimeAxis) -> Chart:
    soc = Panel("SOC", string_curves(time, binned["soc"].values), y_limits=(-0.02, 1.02))
    temperature = Panel("Temperature (°C)", string_curves(time, binned["temperature_c"].values))
    return Chart(time.label, [soc, temperature])


def _number(value: float) -> str:
    """Return a number with four digits, and all whole ones of a larger number: 12,345, not 1.234e+04."""
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"


def _total(values: Array) -> Array:
    """Sum over strings; NaN only if all are unknown."""
    return np.where(np.isfinite(values).any(axis=1), np.nansum(values, axis=1), np.nan)


def _subject(journal: xr.Dataset) -> str:
    first, last = (
        np.datetime_as_string(journal["time"].values[i], unit="s").replace("T", " ") for i in (0, -1)
    )
    n_strings = journal.sizes["string"]
    return f"{n_strings} string{'s' if n_strings > 1 else ''}, {first} to {last} UTC, journal of bess serve"


def _summary(journal: xr.Dataset) -> Iterator[str]:
    written = np.isfinite(journal["written_kw"].values).any(axis=1)
    if written.any():
        yield f"Set-points were written at {written.sum():,} of {journal.sizes['time']:,} readings."
    else:
        yield "Shadow mode: no set-point was written."
    did, recommended = journal["power_kw"].values, journal["recommended_kw"].values
    both = np.isfinite(did) & np.isfinite(recommended)
    if both.any():
        rms = float(np.sqrt(np.mean(np.square((did - recommended)[both]))))
        yield f"The power of a string differs from its computed set-point by {_number(rms)} kW (rms)."


def _tiles(journal: xr.Dataset) -> Iterator[Tile]:
    _, steps, usual = _intervals(journal)
    # A reading holds until the next one; before a gap, for the usual interval.
    hours = np.append(np.where(steps > _GAP * usual, usual, steps), usual) / 3600.0
    demand = journal["demand_kw"].values
    for label, power in (("Energy demand", demand), ("Delivered", _total(journal["power_kw"].values))):
        kwh = np.nan_to_num(power) * hours
        given, taken = float(kwh[kwh > 0.0].sum()), float((-kwh[kwh < 0.0]).sum())
        parts = f"{_number(given)} discharged + {_number(taken)} charged"
        yield Tile(label, _number(given + taken), "kWh", parts)
    missed = np.abs(demand - np.nan_to_num(_total(journal["recommended_kw"].values)))
    missed_kwh = float((missed * hours).sum())
    yield Tile("Demand above the set-points", _number(missed_kwh), "kWh", "both directions")


def _warnings(journal: xr.Dataset) -> Iterator[str]:
    _, steps, usual = _intervals(journal)
    gaps = steps[steps > _GAP * usual]
    if gaps.size:
        yield (
            f"{gaps.size} gap{'s' if gaps.size > 1 else ''} of {gaps.sum():,.0f} s in total between "
            f"readings, which usually come every {usual:g} s; energies exclude the gaps."
        )
    out = 1.0 - journal["available"].values.mean(axis=0)
    for string in np.flatnonzero(out > 0.0):
        yield f"String {string} was out of service in {100.0 * out[string]:.3g} % of the readings."
