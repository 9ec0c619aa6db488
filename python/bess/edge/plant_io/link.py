"""What a controller sees of a plant, whatever the plant speaks: measurements in, set-points out."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bess.errors import BessError


class LinkError(BessError):
    """A plant is unreachable, or its data are unusable; the message is one sentence."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """What a plant says of its strings at one moment; arrays of shape ``(n_strings,)``, positive = discharge.

    A string of which nothing could be read is NaN and not available; that is no error, the others go on.

    Parameters
    ----------
    time
        When it was read, with a time zone.
    soc
        State of charge, 0 to 1.
    temperature_c
        Temperature [degC]; NaN where the plant names none.
    power_kw
        AC power that each string delivers now [kW].
    charge_limit_kw, discharge_limit_kw
        What the plant itself allows now [kW], ``>= 0``; infinite where it names no limit.
    available
        Whether the string takes set-points.
    remarks
        For each string a sentence on why it is not available, where the link knows more than that the plant
        says so; empty for the others. May be left out altogether.
    plant_kw
        Power [kW] of all strings at the plant's own meter, positive = discharge; NaN without one.
    setpoint_kw
        Set-point that each string holds now [kW], whoever wrote it; NaN where the plant names none. None if
        it never does.
    """

    time: datetime
    soc: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    power_kw: NDArray[np.float64]
    charge_limit_kw: NDArray[np.float64]
    discharge_limit_kw: NDArray[np.float64]
    available: NDArray[np.bool_]
    remarks: tuple[str, ...] = ()
    setpoint_kw: NDArray[np.float64] | None = None
    plant_kw: float = float("nan")


class PlantLink(Protocol):
    """A plant of several strings that can be read and driven.

    **Who refreshes.** A set-point lapses by the plant's own watchdog unless it is written again. The link
    never does so by itself: the caller writes at least every :attr:`refresh_s` for as long as it knows what
    it wants, whether the set-points have changed or not. A caller that hangs, dies or is in doubt thus loses
    the plant to its watchdog, and no thread of ours keeps an old set-point alive.

    A link is used from one thread at a time. It remembers no failure: after a :class:`LinkError` the next
    call tries anew, a new connection included.
    """

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        ...

    @property
    def refresh_s(self) -> float:
        """Longest time [s] from one :meth:`write` to the next."""
        ...

    def read(self) -> Measurements:
        """Return what the plant says now.

        Raises
        ------
        LinkError
            If nothing can be read, or if a value is in another unit than expected.
        """
        ...

    def write(self, power_kw: NDArray[np.float64]) -> None:
        """Write set-points [kW], shape ``(n_strings,)``.

        NaN takes a string's set-point back: the only way to say "nothing", as zero is a set-point. Where
        that does not arrive the set-point lapses, which is no error.

        Raises
        ------
        LinkError
            If a set-point did not arrive; those of the other strings were written all the same.
        """
        ...

    def release(self) -> None:
        """Let go of the plant, so that its own watchdog takes over; the link can be used again.

        Raises
        ------
        LinkError
            If the plant could not be told; its watchdog takes over all the same, only later.
        """
        ...

    def close(self) -> None:
        """Close connections; writes nothing. Never raises."""
        ...
