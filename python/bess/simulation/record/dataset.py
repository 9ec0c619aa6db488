"""The dataset of a run: variables (as in the table of ``ARCHITECTURE.md``), attributes and NetCDF file."""

from __future__ import annotations

import itertools
import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import __version__
from bess.arrays import Array
from bess.control.wear import WearPrices
from bess.errors import InputError
from bess.plant import Flows, Limit
from bess.simulation.record.files import sha256_of
from bess.simulation.record.store import Record, joined
from bess.study.grid import TimeGrid
from bess.study.study import Study
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Variable:
    """One variable of the result."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    dtype: str = "f8"


_T = ("time",)
_TS = ("time", "string")

VARIABLES: dict[str, Variable] = {
    "demand_kw": Variable(_T, "kW", "power demand on the plant, positive = discharge"),
    "reactive_demand_kvar": Variable(_T, "kvar", "reactive power demand on the plant, positive = supplied"),
    "unmet_kw": Variable(_T, "kW", "demand above the inverter power in service"),
    "price_eur_mwh": Variable(_T, "EUR/MWh", "market price"),
    "position_kw": Variable(
        ("time", "market"), "kW", "position in each auction before the last market, sold"
    ),
    "auction_price_eur_mwh": Variable(("time", "market"), "EUR/MWh", "price of each auction"),
    "expected_kw": Variable(_T, "kW", "delivered power expected by the dispatch"),
    "budget_price_eur_mwh": Variable(_T, "EUR/MWh", "shadow price of the cycle budget, per MWh discharged"),
    "budget_cycles": Variable(_T, "1", "full cycles of the year so far, at the start of the step"),
    "frequency_mhz": Variable(_T, "mHz", "deviation from the nominal grid frequency, mean over the step"),
    "response_kw": Variable(_T, "kW", "frequency response, a part of the demand"),
    "schedule_kw": Variable(_T, "kW", "scheduled part of the demand: recharge and trade"),
    "capacity_kw": Variable(_T, "kW", "sold reserve"),
    "capacity_able_kw": Variable(
        _T, "kW", "reserve that can be sustained for the required duration, at the start of the step"
    ),
    "capacity_price_eur_mw_h": Variable(_T, "EUR/MW/h", "price of reserve"),
    "soc_low": Variable(_T, "1", "SOC below which the reserve is not sustained"),
    "soc_high": Variable(_T, "1", "SOC above which the reserve is not sustained"),
    "load_kw": Variable(_T, "kW", "load behind the meter"),
    "generation_kw": Variable(_T, "kW", "generation behind the meter"),
    "grid_limit_kw": Variable(_T, "kW", "limit of the grid import"),
    "export_price_eur_mwh": Variable(_T, "EUR/MWh", "price of the grid export"),
    "demand_charge_eur_kw_h": Variable(_T, "EUR/kW/h", "price of the peak grid import"),
    "export_limit_kw": Variable(_T, "kW", "limit of the grid export; generation above it is curtailed"),
    "peak_price_eur_kw": Variable(_T, "EUR/kW", "price of the highest quarter-hour mean import of a month"),
    "billing_month": Variable(_T, "1", "month that is billed: year and month, as 202401"),
    "ambient_c": Variable(_T, "degC", "ambient (air inlet) temperature"),
    "request_kw": Variable(_TS, "kW", "set-point of each string (AC), positive = discharge"),
    "delivered_kw": Variable(_TS, "kW", "delivered AC power, mean over the step, positive = discharge"),
    "reactive_kvar": Variable(_TS, "kvar", "reactive power, mean over the step, positive = supplied"),
    "availability_loss_kw": Variable(_TS, "kW", "undelivered request: every limit but derating"),
    "derating_loss_kw": Variable(_TS, "kW", "undelivered request: temperature derating"),
    "inverter_loss_kw": Variable(_TS, "kW", "inverter loss"),
    "standby_kw": Variable(
        _TS,
        "kW",
        "inverter loss drawn from the grid in addition to the delivered power: standby, or reactive power",
    ),
    "battery_loss_kw": Variable(_TS, "kW", "battery loss (heat)"),
    "hysteresis_loss_kw": Variable(_TS, "kW", "loss due to hysteresis of the open-circuit voltage"),
    "chemical_kw": Variable(_TS, "kW", "power drawn from the stored chemical energy, a function of SOC"),
    "auxiliary_kw": Variable(_T, "kW", "power of cooling (fans, pumps, chiller), taken from the grid"),
    "cooling_kw": Variable(_TS, "kW", "heat removed by the coolant"),
    "coolant_c": Variable(_T, "degC", "temperature of the coolant at the inlet, at the end of the step"),
    "reversible_heat_kw": Variable(_TS, "kW", "heat of reaction -I T dU/dT, negative = cooling"),
    "current_a": Variable(_TS, "A", "mean string current, positive = discharge"),
    "soc": Variable(_TS, "1", "state of charge at the end of the step"),
    "temperature_c": Variable(_TS, "degC", "mean temperature over the nodes at the end of the step"),
    "node_max_c": Variable(_TS, "degC", "temperature of the hottest node within the step"),
    "node_temperature_c": Variable(
        ("time", "string", "node"), "degC", "node temperature at the end of the step", "f4"
    ),
    "derating_factor": Variable(_TS, "1", "derating factor, mean over the step"),
    "limits": Variable(_TS, "1", "limits that were active within the step", "i4"),
    "inverter_starts": Variable(_TS, "1", "off-to-on transitions within the step", "i4"),
    "soh_capacity": Variable(_TS, "1", "capacity relative to the system file, at the end of the step"),
    "soh_resistance": Variable(_TS, "1", "resistance relative to the system file, at the end of the step"),
    "calendar_loss": Variable(_TS, "1", "capacity loss by calendar ageing, at the end of the step"),
    "cyclic_loss": Variable(_TS, "1", "capacity loss by cycle ageing, at the end of the step"),
    "aged_charge_ah": Variable(_TS, "Ah", "charge lost with capacity: SOC times the capacity loss"),
    "wear_eur": Variable(_TS, "EUR", "wear cost within the step"),
    "end_of_life": Variable(_TS, "1", "1 where the capacity first reaches the end of life", "i4"),
    "investment_eur": Variable(_TS, "EUR", "cost of a new battery, installed at the start of the step"),
    "ledger_residual_kwh": Variable(
        _T, "kWh", "AC energy - (chemical change + heat + hysteresis + inverter loss) of all strings"
    ),
    "solver_status": Variable(_T, "1", "solution status of the policy", "i4"),
    "solver_gap": Variable(_T, "1", "relative gap to the rigorous bound"),
    "solver_search_gap": Variable(_T, "1", "relative gap of the convexified program"),
    "solver_nodes": Variable(_T, "1", "branch-and-bound nodes", "i4"),
    "fallback": Variable(_T, "1", "1 if a fallback replaced the result of the optimiser", "i4"),
}

OPTIONAL_FLOWS = {
    "ageing": ("calendar_loss", "cyclic_loss", "aged_charge_ah"),
    "entropy": ("reversible_heat_kw",),
    "reactive": ("reactive_kvar",),
    "cooling": ("auxiliary_kw", "cooling_kw", "coolant_c"),
    "nodes": ("node_temperature_c",),
}
"""Plant variables of some runs only: with an ageing model of the cells, a table of entropy, reactive power, a
section ``[cooling]``, and with ``output.node_temperatures``."""

FLOWS = tuple(
    name
    for name in VARIABLES
    if name in {field.name for field in fields(Flows)}.difference(*OPTIONAL_FLOWS.values())
)
"""Variables taken directly from the plant, of every run."""


_TIME = "start of the step (UTC)"


def dataset_of(frame: Mapping[str, Any], records: Iterator[tuple[int, Record]]) -> xr.Dataset:
    """Return ``records`` in memory, equal to the file of :func:`write_netcdf`."""
    import xarray as xr

    n_steps, attrs = frame["n_steps"], _attrs(frame)
    arrays: Record = {}
    for first, record in records:
        for name, values in record.items():
            if name not in arrays:
                arrays[name] = np.empty((n_steps, *values.shape[1:]), VARIABLES[name].dtype)
            arrays[name][first : first + len(values)] = values
    dataset = xr.Dataset(
        {name: (VARIABLES[name].dims, values, attrs[name]) for name, values in arrays.items()},
        {"time": ("time", _grid(frame).times.astype("M8[ns]"), {"long_name": _TIME})},
        _attrs_of_run(frame),
    )
    indices = {name: np.arange(size) for name, size in dataset.sizes.items() if name != "time"}
    return dataset.assign_coords(
        {name: (name, index, {"long_name": _index_of(str(name))}) for name, index in indices.items()}
    )


_CHUNK_STEPS = 960
_BATCH_BYTES = 8_000_000
_BOOK_KEEPING_BYTES = 1 << 18
_ZEROS = bytes(1 << 20)


def write_netcdf(path: Path, frame: Mapping[str, Any], records: Iterator[tuple[int, Record]]) -> None:
    """Write ``records`` (first step and arrays of consecutive steps) in a frame of :func:`describe_frame`.

    Raises
    ------
    OSError
        Writing failed; ``path`` is then invalid.
    """
    import h5netcdf

    batches = _batches(records)
    first_batch = next(batches)
    n_steps, attrs = frame["n_steps"], _attrs(frame)
    # HDF5 crashes the process if a write fails, so the disk space is checked first.
    _try_size(path, _largest_size(first_batch[1], n_steps))
    with h5netcdf.File(path, "w") as file:
        file.attrs.update(_attrs_of_run(frame))
        file.dimensions = {"time": n_steps}
        time = file.create_variable("time", ("time",), np.int64)
        time.attrs.update({"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"})
        time.attrs["long_name"] = _TIME
        time[:] = _grid(frame).times.astype(np.int64)
        # Looked up once, because every look-up in the file reopens the variable.
        variables = {
            name: _create(file, name, values, n_steps, attrs[name]) for name, values in first_batch[1].items()
        }
        for first, record in itertools.chain([first_batch], batches):
            for name, values in record.items():
                variables[name][first : first + len(values)] = values


def _batches(records: Iterator[tuple[int, Record]]) -> Iterator[tuple[int, Record]]:
    """Join records to batches of many chunks, because HDF5 calls are expensive."""
    waiting: list[Record] = []
    first = steps = size = 0
    for _, record in records:
        waiting.append(record)
        steps += len(record["demand_kw"])
        size += sum(values.nbytes for values in record.values())
        if steps >= _CHUNK_STEPS and size >= _BATCH_BYTES:
            yield first, joined(waiting)
            first, steps, size, waiting = first + steps, 0, 0, []
    if waiting:
        yield first, joined(waiting)


def _largest_size(record: Record, n_steps: int) -> int:
    """Size of all whole chunks [bytes], with a margin for the metadata of HDF5."""
    chunk = min(n_steps, _CHUNK_STEPS)
    steps = -(-n_steps // chunk) * chunk
    values = sum(steps * values[0].size * values.dtype.itemsize for values in record.values())
    return int(1.02 * values) + 8 * n_steps + _BOOK_KEEPING_BYTES


def _try_size(path: Path, size: int) -> None:
    """Raise OSError unless a file of this size can be written."""
    with path.open("wb") as file:
        for start in range(0, size, len(_ZEROS)):
            file.write(_ZEROS[: size - start])


def _create(file: Any, name: str, values: NDArray[Any], n_steps: int, attrs: Mapping[str, Any]) -> Any:
    variable = VARIABLES[name]
    for dimension, size in zip(variable.dims[1:], values.shape[1:], strict=True):
        if dimension not in file.dimensions:
            file.dimensions[dimension] = size
            index = file.create_variable(dimension, (dimension,), np.int64)
            index.attrs["long_name"] = _index_of(dimension)
            index[:] = np.arange(size)
    chunks = (min(n_steps, _CHUNK_STEPS), *values.shape[1:])
    created = file.create_variable(
        name, variable.dims, np.dtype(variable.dtype), chunks=chunks, fletcher32=True
    )
    created.attrs.update(attrs)
    return created


def _grid(frame: Mapping[str, Any]) -> TimeGrid:
    return TimeGrid(frame["start_s"], frame["step_s"], frame["n_steps"])


def _index_of(dimension: str) -> str:
    return f"index of the {dimension}, from 0"


def _attrs_of_run(frame: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _given(each) if isinstance(each, list) else each for key, each in frame["attrs"].items()}


def _given(values: ArrayLike) -> Any:
    """An attribute as a file gives it: a list of one number as that number."""
    return np.squeeze(values)[()]


def _attrs(frame: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Attributes of every variable."""
    attrs = {name: {"units": each.units, "long_name": each.long_name} for name, each in VARIABLES.items()}
    attrs["limits"] |= _flags("flag_masks", frame["limit_flags"])
    attrs["solver_status"] |= _flags("flag_values", frame["statuses"])
    return attrs


def describe_frame(
    study: Study, system: System, grid: TimeGrid, statuses: Mapping[int, str]
) -> dict[str, Any]:
    """Plain values, saved with the parts so that a record can be opened without the files of its study."""
    has_residual = [string.wear.at_end_of_life != "retire" for string in system.strings]
    initial, prices = system.initial_state(), WearPrices.of(system)
    of_cycles = np.array([1.0 - string.wear.calendar_share for string in system.strings])
    return {
        "start_s": grid.start_s,
        "step_s": grid.step_s,
        "n_steps": grid.n_steps,
        "attrs": {
            "title": study.title or study.name,
            "scenario": study.name,
            "study": study.to_toml(),
            "bess_version": __version__,
            "system_sha256": fingerprint(system),
            "time_zone": "UTC",
            "start_s": grid.start_s,
            "step_h": grid.dt_h,
            "nominal_energy_kwh": system.nominal_energy_kwh.tolist(),
            "initial_soc": initial.soc.tolist(),
            "initial_temperature_c": initial.temperature_c.tolist(),
            "initial_soh_capacity": initial.soh_capacity.tolist(),
            "initial_soh_resistance": initial.soh_resistance.tolist(),
            "initial_cyclic_loss": (of_cycles * (1.0 - initial.soh_capacity)).tolist(),
            "wear_eur_per_loss": prices.eur_per_loss.tolist(),
            "residual_eur_per_soh": np.where(has_residual, prices.eur_per_loss, 0.0).tolist(),
            "end_of_life_soh": prices.end_of_life.tolist(),
        },
        "statuses": {str(code): text for code, text in statuses.items()},
        "limit_flags": {str(int(limit)): str(limit.name).lower() for limit in Limit},
    }


def fingerprint(system: System) -> str:
    """Hash of every number of a system."""
    return sha256_of(json.dumps(system.document, sort_keys=True, default=str).encode())


def with_initial(dataset: xr.Dataset, variable: str) -> Array:
    """Return the state at the start and at the end of every step, shape ``(n_steps + 1, n_strings)``.

    A later part of a run, or a record without the attribute, does not contain its initial state: the state
    after the first step replaces it.
    """
    states: Array = dataset[variable].values
    key = f"initial_{variable}"
    if key not in dataset.attrs or not begins_with_run(dataset):
        return np.concatenate([states[:1], states])
    initial = np.atleast_1d(np.asarray(dataset.attrs[key], dtype=np.float64))
    return np.concatenate([initial[None, :], states])


def study_of(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the study of a record as nested tables; empty without one."""
    return tomllib.loads(dataset.attrs.get("study", ""))


def begins_with_run(dataset: xr.Dataset) -> bool:
    """Whether a record contains the first step of its run; assumed of a record without start or times."""
    start_s = dataset.attrs.get("start_s")
    return start_s is None or "time" not in dataset.coords or seconds(dataset)[0] == int(start_s)


def seconds(dataset: xr.Dataset) -> NDArray[np.int64]:
    """Return the start of each step of a record [s since 1970]."""
    return np.asarray(dataset["time"].values.astype("datetime64[s]").astype(np.int64))


def check_record(dataset: xr.Dataset, needed: Iterable[str], place: str) -> None:
    """Check a record, which may be a selection of a run or a dataset of the user."""
    missing = [name for name in needed if name not in dataset]
    if missing or "step_h" not in dataset.attrs:
        raise InputError(f"{place}: the record has no {', '.join(missing) or 'attribute step_h [h]'}")
    if dataset.sizes.get("time", 0) == 0:
        raise InputError(f"{place}: the record has no steps")
    strings, every = dataset.sizes.get("string", 0), np.size(dataset.attrs.get("initial_soc", ()))
    if every not in (0, strings):
        raise InputError(
            f"{place}: the record has {strings} of {every} strings; keep all; the demand is for all strings"
        )
    step_s = round(3600.0 * float(dataset.attrs["step_h"]))
    if dataset["time"].dtype.kind == "M" and (np.diff(seconds(dataset)) != step_s).any():
        raise InputError(
            f"{place}: the times of the record are not {step_s} s apart, as its attribute step_h says; "
            "select whole periods, such as dataset.sel(time=slice(start, end))"
        )


def _flags(key: str, meanings: Mapping[str, str]) -> dict[str, Any]:
    """CF convention: blank-separated meanings, so a sentence is joined by underscores."""
    words = [
        text.rstrip(".").replace(",", "").replace(";", "").replace(" ", "_") for text in meanings.values()
    ]
    codes = np.array([int(code) for code in meanings], dtype=np.int32)
    return {key: _given(codes), "flag_meanings": " ".join(words)}
