"""Conversion of the parts of a run to one NetCDF file, with constant memory."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bess.simulation.record.schema import VARIABLES
from bess.simulation.record.store import Record

_CHUNK_STEPS = 960
_BOOK_KEEPING_BYTES = 1 << 18
_ZEROS = bytes(1 << 20)
_EPOCH = np.datetime64("1970-01-01T00:00:00", "s")


@dataclass(frozen=True)
class DatasetSpec:
    """Coordinates and attributes that turn a record into a dataset.

    Attributes
    ----------
    time : ndarray of datetime64[s], shape (n_steps,)
        Start of each step, UTC.
    attrs : dict
        Attributes of the dataset.
    variable_attrs : dict
        Attributes of single variables, in addition to units and long name.
    """

    time: NDArray[np.datetime64]
    attrs: Mapping[str, Any]
    variable_attrs: Mapping[str, Mapping[str, Any]]


def write_netcdf(path: Path, frame: DatasetSpec, records: Iterator[tuple[int, Record]]) -> None:
    """Write ``records`` (first step and arrays of consecutive steps) one after the other.

    Raises
    ------
    OSError
        Writing failed; ``path`` is then invalid.
    """
    import h5netcdf

    batches = _batches(records)
    first_batch = next(batches)
    n_steps = frame.time.size
    # HDF5 crashes the process if a write fails, so the disk space is checked first.
    _try_size(path, _largest_size(first_batch[1], n_steps))
    with h5netcdf.File(path, "w") as file:
        file.attrs.update(dict(frame.attrs))
        file.dimensions = {"time": n_steps}
        time = file.create_variable("time", ("time",), np.int64)
        time.attrs.update({"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"})
        time.attrs.update({"long_name": "start of the step (UTC)"})
        time[:] = (frame.time - _EPOCH).astype(np.int64)
        # Looked up once, because every look-up in the file reopens the variable.
        variables = {
            name: _create(file, name, values, n_steps, frame.variable_attrs.get(name, {}))
            for name, values in first_batch[1].items()
        }
        for first, record in itertools.chain([first_batch], batches):
            for name, values in record.items():
                variables[name][first : first + len(values)] = values


def _batches(records: Iterator[tuple[int, Record]]) -> Iterator[tuple[int, Record]]:
    """Join records to batches of about one chunk, because HDF5 calls are expensive."""
    waiting: list[Record] = []
    first = steps = 0
    for _, record in records:
        waiting.append(record)
        steps += len(record["demand_kw"])
        if steps >= _CHUNK_STEPS:
            yield first, _joined(waiting)
            first, steps, waiting = first + steps, 0, []
    if waiting:
        yield first, _joined(waiting)


def _joined(records: list[Record]) -> Record:
    return {name: np.concatenate([record[name] for record in records]) for name in records[0]}


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
            index.attrs["long_name"] = f"index of the {dimension}, from 0"
            index[:] = np.arange(size)
    chunks = (min(n_steps, _CHUNK_STEPS), *values.shape[1:])
    created = file.create_variable(
        name, variable.dims, np.dtype(variable.dtype), chunks=chunks, fletcher32=True
    )
    created.attrs.update({"units": variable.units, "long_name": variable.long_name, **attrs})
    return created
