"""What a driven or watched plant did, reading after reading, and what was recommended.

A folder with ``journal.json`` (which plant, in which layout) and the records of each day (UTC), see
:mod:`bess.edge.plant_io.journal_files`. A record has a fixed number of bytes, so that what a killed process
or a full disk left of the last one is seen by its length, and cut off.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bess import __version__
from bess.edge.plant_io.journal_files import DayFiles, contents
from bess.edge.plant_io.link import Measurements
from bess.errors import InputError
from bess.files import parse_json
from bess.simulation.record.aside import Aside
from bess.simulation.record.atomic import put_bytes
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr

HEADER: Final = "journal.json"
RECORDS: Final = "journal"
FORMAT: Final = 1
PATIENCE_S: Final = 1.0
"""Time that one record may hold the control loop up."""
MOST_MB: Final = 2000.0
"""What the days of a journal that are over may take: a year of ten strings, read every second."""

_OF_STRINGS: Final = {
    "power_kw": ("kW", "AC power that the string delivered, positive = discharge"),
    "recommended_kw": ("kW", "set-point that the controller recommended, positive = discharge"),
    "written_kw": ("kW", "set-point that reached the plant; NaN where none was written"),
    "soc": ("1", "state of charge as read"),
    "temperature_c": ("degC", "temperature as read"),
    "charge_limit_kw": ("kW", "charge power that the plant allowed"),
    "discharge_limit_kw": ("kW", "discharge power that the plant allowed"),
}


class Journal:
    """Appends to the journal of a plant, for as long as a service runs and whenever it runs again.

    Nothing that goes wrong with the disk stops the caller, or holds it up for more than a moment:
    :attr:`error` says what it is, and the next :meth:`append` tries anew.

    Parameters
    ----------
    directory
        Made if need be; may hold other files.
    system
        The plant.
    title
        What the report calls it.
    most_mb
        What days that are over may take on the disk; the oldest are removed.

    Raises
    ------
    InputError
        If the folder holds the journal of another number of strings.
    """

    def __init__(self, directory: Path, system: System, title: str, most_mb: float = MOST_MB) -> None:
        self._directory, self._records = directory, directory / RECORDS
        self._layout = _layout(system.n_strings)
        self._aside = Aside("journal")
        self._header = json.dumps(
            {
                "format": FORMAT,
                "n_strings": system.n_strings,
                "title": title,
                "system": system.to_toml(),
                "bess_version": __version__,
            },
            indent=1,
        ).encode()
        self._days = DayFiles(self._records, self._layout.itemsize, 1e6 * most_mb)
        self._has_header = False
        self._gap = self._damage = ""
        try:
            n_strings = _header(directory)["n_strings"] if is_journal(directory) else system.n_strings
        except InputError as error:
            self._gap = self._damage = str(error)
            return
        if n_strings != system.n_strings:
            raise InputError(
                f"{directory}: holds the journal of a plant of {n_strings} strings, "
                f"this one has {system.n_strings}; use another folder"
            )
        self._do(lambda: None)

    @property
    def error(self) -> str:
        """What is wrong with the disk now, in a sentence; empty if nothing is."""
        return self._gap or self._days.error

    def append(
        self,
        measurements: Measurements,
        demand_kw: float,
        recommended_kw: ArrayLike,
        written_kw: ArrayLike | None = None,
    ) -> None:
        """Append one reading, and what was made of it.

        Parameters
        ----------
        measurements
            What the plant said.
        demand_kw
            Power asked of the plant [kW], positive = discharge.
        recommended_kw
            Set-points of the controller [kW], shape ``(n_strings,)``.
        written_kw
            Those that were written; None if none were, as with ``--shadow`` or a link that was lost.
        """
        record = np.zeros((), dtype=self._layout)
        record["time_ms"] = round(1000.0 * measurements.time.timestamp())
        record["demand_kw"] = demand_kw
        record["available"] = measurements.available
        record["recommended_kw"] = recommended_kw
        record["written_kw"] = np.nan if written_kw is None else written_kw
        for name in ("power_kw", "soc", "temperature_c", "charge_limit_kw", "discharge_limit_kw"):
            record[name] = getattr(measurements, name)
        day = measurements.time.astimezone(UTC).strftime("%Y-%m-%d")
        self._do(lambda: self._days.append(day, record.tobytes()))

    def close(self) -> None:
        """Close the files."""
        with suppress(OSError):
            self._aside(self._days.close, PATIENCE_S)
        self._aside.close()

    def _do(self, call: Callable[[], None]) -> None:
        """Let the disk do something, and take down what comes of it."""
        if self._damage:
            return
        try:
            self._aside(lambda: self._on_disk(call), PATIENCE_S)
            self._gap = ""
        except OSError as error:
            why = "the disk does not answer" if isinstance(error, TimeoutError) else error.strerror
            self._gap = f"{self._records}: cannot be written ({why}); the journal of the plant has a gap"

    def _on_disk(self, call: Callable[[], None]) -> None:
        try:
            if not self._has_header:
                self._records.mkdir(parents=True, exist_ok=True)
                put_bytes(self._directory / HEADER, self._header)
                self._has_header = True
            call()
        except OSError:
            self._days.close_day()
            self._has_header = False
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def is_journal(directory: Path) -> bool:
    """Whether a folder holds the journal of a plant."""
    return (directory / HEADER).is_file()


def open_journal(directory: str | Path) -> xr.Dataset:
    """Return a journal as a dataset with the dimensions ``time`` (UTC, rising) and ``string``.

    Of readings with the same time, which a clock that was set back may leave, the last is kept.

    Raises
    ------
    InputError
        If there is no journal, none that this version reads, or nothing in it yet.
    """
    import xarray as xr

    directory = Path(directory)
    header = _header(directory)
    layout = _layout(header["n_strings"])
    records = np.concatenate([np.zeros(0, dtype=layout), *_days(directory, layout)])
    if not records.size:
        raise InputError(f"{directory}: the journal is empty; let bess serve drive or watch the plant first")
    records = records[np.argsort(records["time_ms"], kind="stable")]
    last = np.append(np.diff(records["time_ms"]) > 0, True)
    records = records[last]
    variables: dict[str, Any] = {
        "demand_kw": (
            "time",
            records["demand_kw"],
            {"units": "kW", "long_name": "power asked of the plant, positive = discharge"},
        ),
        "available": (
            ("time", "string"),
            records["available"].astype(np.int8),
            {"units": "1", "long_name": "1 where the string took set-points"},
        ),
    }
    for name, (units, meaning) in _OF_STRINGS.items():
        variables[name] = (("time", "string"), records[name], {"units": units, "long_name": meaning})
    return xr.Dataset(
        variables,
        coords={
            "time": records["time_ms"].astype("datetime64[ms]"),
            "string": np.arange(header["n_strings"]),
        },
        attrs={key: header[key] for key in ("title", "system", "bess_version")} | {"time_zone": "UTC"},
    )


def _layout(n_strings: int) -> np.dtype[np.void]:
    strings = [(name, "<f4", (n_strings,)) for name in _OF_STRINGS]
    return np.dtype([("time_ms", "<i8"), ("demand_kw", "<f8"), *strings, ("available", "?", (n_strings,))])


def _header(directory: Path) -> dict[str, Any]:
    path = directory / HEADER
    try:
        header: dict[str, Any] = parse_json(path.read_text(encoding="utf-8"))
        known = header["format"] == FORMAT and 0 < int(header["n_strings"]) < 10_000
        if not known or not all(isinstance(header[key], str) for key in ("title", "system", "bess_version")):
            raise ValueError("of another layout")
    except FileNotFoundError:
        raise InputError(f"{directory}: holds no journal of a plant") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); without it the journal cannot be read") from error
    return header


def _days(directory: Path, layout: np.dtype[np.void]) -> Iterator[NDArray[np.void]]:
    for content in contents(directory / RECORDS):
        yield np.frombuffer(content[: len(content) // layout.itemsize * layout.itemsize], dtype=layout)
