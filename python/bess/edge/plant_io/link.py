"""The interface to a plant, independent of its protocol: measurements in, set-points out."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Coroutine, Hashable, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from bess.arrays import Array, Flags
from bess.edge.plant_io import calls
from bess.edge.plant_io.calls import Calls
from bess.errors import BessError, InputError, listed

REFRESH_S: Final = 20.0
"""A third of the time in which set-points expire, so that two consecutive writes may be lost."""

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class LinkError(BessError):
    """A plant is unreachable, or its data are unusable; the message is one sentence."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measurements of all strings at one moment; arrays of shape ``(n_strings,)``, positive = discharge.

    A string without readings is NaN and not available. This is not an error: the other strings continue.

    Parameters
    ----------
    time
        Time of the reading, with a time zone.
    soc
        State of charge, 0 to 1.
    temperature_c
        Temperature [degC]; NaN if the plant reports none.
    power_kw
        AC power that each string delivers now [kW].
    charge_limit_kw, discharge_limit_kw
        Present limits of the plant itself [kW], ``>= 0``; infinite if it reports none.
    available
        Whether the string accepts set-points.
    remarks
        Reasons why strings are not available, one sentence each, if the link has more details than the plant
        reports; otherwise empty. Optional.
    plant_kw
        Power [kW] of all strings at the plant's own meter, positive = discharge; NaN without a meter.
    setpoint_kw
        Present set-point of each string [kW], from any writer; NaN if the plant reports none. None if it
        never reports set-points.
    """

    time: datetime
    soc: Array
    temperature_c: Array
    power_kw: Array
    charge_limit_kw: Array
    discharge_limit_kw: Array
    available: Flags
    remarks: tuple[str, ...] = ()
    setpoint_kw: Array | None = None
    plant_kw: float = float("nan")


@dataclass(frozen=True)
class StringReadings:
    """Present readings of one string, as in :class:`Measurements`; by default it reports nothing."""

    soc: float = math.nan
    temperature_c: float = math.nan
    power_kw: float = math.nan
    charge_limit_kw: float = 0.0
    discharge_limit_kw: float = 0.0
    setpoint_kw: float = math.nan
    available: bool = False
    remarks: str = ""


def measurements(strings: Sequence[StringReadings], plant_kw: float = math.nan) -> Measurements:
    """Return the readings of all strings, in their order, as measurements of now."""
    columns: dict[str, Any] = {
        entry.name: np.array([getattr(string, entry.name) for string in strings])
        for entry in fields(StringReadings)
    }
    remarks = tuple(columns.pop("remarks").tolist())
    return Measurements(time=datetime.now(UTC), remarks=remarks, plant_kw=plant_kw, **columns)


def mean_temperature_c(coldest_c: float, hottest_c: float) -> float:
    """Mean of the coldest and the hottest cell, or the one that is known; NaN if none is."""
    known = [temperature_c for temperature_c in (coldest_c, hottest_c) if not math.isnan(temperature_c)]
    return sum(known) / len(known) if known else math.nan


class PlantLink(Protocol):
    """A plant of several strings that can be read and controlled.

    **Refresh.** A set-point expires by the plant's own watchdog unless it is written again. The link does not
    refresh set-points: the caller writes at least every :attr:`refresh_s`, even if they are unchanged. If the
    caller hangs, dies or stops writing, the watchdog therefore takes over, and no thread keeps an old
    set-point alive.

    A link is used from one thread at a time. It stores no failure: after a :class:`LinkError`, the next call
    tries again, with a new connection if needed.
    """

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        ...

    @property
    def refresh_s(self) -> float:
        """Maximum time [s] from one :meth:`write` to the next."""
        ...

    def read(self) -> Measurements:
        """Return the present measurements.

        Raises
        ------
        LinkError
            Nothing can be read, or a value has an unexpected unit.
        """
        ...

    def write(self, power_kw: Array) -> None:
        """Write set-points [kW], shape ``(n_strings,)``.

        NaN clears the set-point of a string; zero is a set-point. A set-point that cannot be cleared expires,
        which is not an error.

        Raises
        ------
        LinkError
            A set-point did not arrive; those of the other strings are written nevertheless.
        """
        ...

    def release(self) -> None:
        """Clear all set-points, so that the plant's own watchdog takes over; the link can be used again.

        Raises
        ------
        LinkError
            The plant could not be reached; its watchdog still takes over, but later.
        """
        ...

    def close(self) -> None:
        """Close connections without writing. Never raises."""
        ...


class StringLink(ABC, Generic[K]):
    """Base of links that write each string separately, in whole watts.

    ``strings`` are the strings in their order; as text, they are names for messages. ``place`` names the
    plant in messages if its strings do not.
    """

    def __init__(self, strings: Sequence[K], n_strings: int, place: str = "") -> None:
        self.n_strings, self._strings, self._place = n_strings, strings, place
        self._calls = Calls()

    def write(self, power_kw: Array) -> None:
        """As :meth:`PlantLink.write`; set-points of another shape or infinite ones are an InputError."""
        setpoints = np.asarray(power_kw, dtype=np.float64)
        if setpoints.shape != (self.n_strings,) or np.isinf(setpoints).any():
            raise InputError(
                f"set-points {setpoints} kW: expected {self.n_strings} finite powers, or NaN for none"
            )
        self._may_write()
        power_w = dict(zip(self._strings, whole_watts(setpoints), strict=True))
        failures = self._set({s: w for s, w in power_w.items() if w is not None or self._may_hold(s)})
        # A set-point that cannot be cleared expires.
        self._raise({string: error for string, error in failures.items() if power_w[string] is not None})

    def release(self) -> None:
        """Clear all set-points; those that cannot be cleared expire."""
        self._raise(self._set(dict.fromkeys(self._strings)))

    def close(self) -> None:
        """Close the connections."""
        self._calls.close(self._disconnect())

    def _within(self, call: Coroutine[Any, Any, T], within_s: float) -> T:
        """Return the result of a call with a deadline."""
        try:
            return self._calls(call, within_s)
        except TimeoutError:
            raise self._late() from None

    def _late(self) -> LinkError:
        return LinkError(f"{self._place}{self._place and ': '}no answer within {calls.DEADLINE_S:g} s")

    def _may_write(self) -> None:
        """Raise LinkError while nothing may be written."""

    @abstractmethod
    def _may_hold(self, string: K) -> bool:
        """Whether the plant may hold a set-point of this string."""

    @abstractmethod
    def _set(self, power_w: Mapping[K, int | None]) -> Mapping[K, Exception]:
        """Write set-points [W], cleared ones (None) first; return failures."""

    @abstractmethod
    async def _disconnect(self) -> None:
        """Close the connections."""

    @staticmethod
    def _raise(failures: Mapping[K, Exception]) -> None:
        if failures:
            reason = next(iter(failures.values()))
            raise LinkError(f"set-points of {listed(map(str, failures))} not written: {reason}")


_ROUNDING_W = 1e-6
"""Tolerance for the rounding errors of whole W given in kW [W]."""


def whole_watts(power_kw: Array) -> list[int | None]:
    """Return set-points in whole W, each within 1 W; None for none.

    Each is truncated towards zero. The truncated total is distributed 1 W at a time, largest truncation
    first, so that the sum is the total of ``power_kw``, truncated once. Less than 1 W is zero.
    """
    exact = 1000.0 * np.nan_to_num(power_kw)
    exact += np.copysign(_ROUNDING_W, exact)
    whole = np.trunc(exact)
    lost = np.where(whole == 0.0, 0.0, exact - whole)
    missing = math.trunc(exact.sum()) - int(whole.sum())
    sign = math.copysign(1.0, missing)
    order = np.argsort(-sign * lost, kind="stable")[: abs(missing)]
    whole[order] += sign * (sign * lost[order] > 2.0 * _ROUNDING_W)
    return [None if math.isnan(kw) else int(w) for kw, w in zip(power_kw, whole, strict=True)]


def number(value: object) -> float:
    """Return a finite number from JSON; NaN for anything else, booleans included."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value) if math.isfinite(value) else math.nan
    except OverflowError:  # an integer beyond the range of floats
        return math.nan
