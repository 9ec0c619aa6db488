"""A simulated plant with faults, and the base class of its simulated devices.

The clock is an argument, so that a test steps through minutes without waiting for them. ``speed`` lets a day
pass in minutes; set-points expire by the clock, as with the watchdog of a real plant.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import nan
from typing import Final, Self

import numpy as np

from bess.arrays import Array
from bess.errors import InputError
from bess.plant import Plant
from bess.system import System

PLANT_STEP_S: Final = 1.0
"""Inner step [s]: a set-point acts within a second, as with a real inverter."""
_MAX_STEP_S: Final = 86_400.0

Clock = Callable[[], float]


@dataclass
class Faults:
    """Faults of a simulated plant or of its measurements; strings by index.

    Parameters
    ----------
    dead
        Strings in reported fault; they deliver nothing and ignore set-points.
    deaf
        Strings that deliver nothing and report no fault.
    silent
        Strings without any response.
    undefined
        Strings whose values are reported as unknown (null, NaN).
    frozen
        Strings whose reported state of charge and temperature are frozen.
    hung
        Strings whose reported values are frozen, except for the heartbeat.
    severed
        Strings disconnected from their gateway: all values are frozen, including the heartbeat, and
        set-points have no effect.
    kilowatts
        Powers are reported in kW instead of W, with the unit kW.
    delay_s
        Time [s] before each answer.
    """

    dead: set[int] = field(default_factory=set)
    deaf: set[int] = field(default_factory=set)
    silent: set[int] = field(default_factory=set)
    undefined: set[int] = field(default_factory=set)
    frozen: set[int] = field(default_factory=set)
    hung: set[int] = field(default_factory=set)
    severed: set[int] = field(default_factory=set)
    kilowatts: bool = False
    delay_s: float = 0.0


@dataclass(frozen=True)
class Reading:
    """Measurements of one string; powers positive = discharge, limits ``>= 0``."""

    soc: float
    coldest_c: float
    hottest_c: float
    power_kw: float
    charge_limit_kw: float
    discharge_limit_kw: float
    fault: bool
    beat: int
    """Seconds counted by the string."""


class SimulatedPlant:
    """Simulated plant that advances with each access; thread-safe.

    Parameters
    ----------
    system
        Parameters of the plant.
    speed
        Seconds of the plant for each second of the clock, above 0.
    clock
        Returns seconds since any origin.

    Raises
    ------
    InputError
        The speed is not a positive number.
    """

    def __init__(self, system: System, *, speed: float = 1.0, clock: Clock = time.monotonic) -> None:
        if not 0.0 < speed < np.inf:
            raise InputError(f"speed {speed}: expected a positive number of plant seconds per second")
        self.system = system
        self.faults = Faults()
        self.clock = clock
        self._speed = speed
        self._lock = threading.RLock()
        self._plant = Plant(system, system.initial_state(), plant_step_s=PLANT_STEP_S)
        self._trial = Plant(system, system.initial_state(), plant_step_s=PLANT_STEP_S)
        # Set-point [kW] and expiry time of each string that has one.
        self._held: dict[int, tuple[float, float]] = {}
        self._cells_c = np.tile(system.initial_state().temperature_c, (2, 1))
        self._clock_s = clock()
        self._said: dict[int, Reading] = {}
        self._truth: tuple[object, list[Reading]] = None, []
        """Readings, and what they depend on."""

    @property
    def n_strings(self) -> int:
        """Number of strings."""
        return self.system.n_strings

    def ask(self, string: int, power_kw: float, lapses_at: float) -> None:
        """Give a string a set-point [kW] that expires at the clock time ``lapses_at``."""
        with self._lock:
            self._advance()
            if string not in self.faults.severed:
                nominal = self.system.nominal_kw[string]
                self._held[string] = float(np.clip(power_kw, -nominal, nominal)), lapses_at

    def take_back(self, string: int) -> None:
        """Clear the set-point of a string, which then delivers no power."""
        with self._lock:
            self._advance()
            if string not in self.faults.severed:
                self._held.pop(string, None)

    def prolong(self, lapses_at: float) -> None:
        """Extend all set-points that have not expired until ``lapses_at``."""
        with self._lock:
            self._advance()
            for string in self._held.keys() - self.faults.severed:
                self._held[string] = self._held[string][0], lapses_at

    def holds(self, string: int) -> tuple[float, float] | None:
        """Return the set-point [kW] and its expiry time; None if the string has none."""
        with self._lock:
            self._advance()
            return self._held.get(string)

    def readings(self) -> dict[int, Reading]:
        """Return the reported readings of each string, except silent ones."""
        with self._lock:
            self._advance()
            for string, said in enumerate(self.truth()):
                if string in self.faults.undefined:
                    said = Reading(nan, nan, nan, nan, nan, nan, fault=False, beat=said.beat)
                before = self._said.setdefault(string, said)
                if string in self.faults.frozen:
                    said = replace(
                        said, soc=before.soc, coldest_c=before.coldest_c, hottest_c=before.hottest_c
                    )
                if string in self.faults.hung:
                    said = replace(before, beat=said.beat)
                self._said[string] = before if string in self.faults.severed else said
            return {s: reading for s, reading in self._said.items() if s not in self.faults.silent}

    def truth(self) -> list[Reading]:
        """Return true readings, ignoring faults of the measurements."""
        with self._lock:
            self._advance()
            request_kw, beat = self._request_kw(), int(self.clock())
            # Each request for a model of a string asks for the readings of all strings.
            cause = self._clock_s, beat, frozenset(self.faults.dead), request_kw.tobytes()
            if cause != self._truth[0]:
                self._truth = cause, self._true_readings(request_kw, beat)
            return self._truth[1]

    def _true_readings(self, request_kw: Array, beat: int) -> list[Reading]:
        nominal_kw, dead = self.system.nominal_kw, self.faults.dead
        most_kw = -self._would_deliver(-nominal_kw), self._would_deliver(nominal_kw)
        limits_kw = np.maximum(most_kw, 0.0)
        limits_kw[:, list(dead)] = 0.0
        power_kw = self._would_deliver(request_kw)
        rows = np.vstack([self._plant.state.soc, self._cells_c, power_kw, limits_kw]).T.tolist()
        return [
            Reading(soc, coldest_c, hottest_c, kw, charge_kw, discharge_kw, i in dead, beat)
            for i, (soc, coldest_c, hottest_c, kw, charge_kw, discharge_kw) in enumerate(rows)
        ]

    def _request_kw(self) -> Array:
        request, stopped = np.zeros(self.n_strings), self.faults.dead | self.faults.deaf
        for string in self._held.keys() - stopped:
            request[string] = self._held[string][0]
        return request

    def _would_deliver(self, request_kw: Array) -> Array:
        """Return the power that the plant would deliver now, without a step of the plant."""
        self._trial.restore(self._plant.snapshot())
        return self._trial.step(request_kw, PLANT_STEP_S).delivered_kw

    def _advance(self) -> None:
        """Advance to the present time, in parts between which set-points expire."""
        now = self.clock()
        while True:
            lapse = min((lapses_at for _, lapses_at in self._held.values()), default=np.inf)
            self._run_until(min(now, lapse))
            if lapse > now:
                return
            self._held = {string: held for string, held in self._held.items() if held[1] > lapse}

    def _run_until(self, clock_s: float) -> None:
        whole_s = PLANT_STEP_S * np.floor(self._speed * (clock_s - self._clock_s) / PLANT_STEP_S)
        while whole_s > 0.0:
            step_s = min(whole_s, _MAX_STEP_S)
            nodes_c = np.asarray(self._plant.step(self._request_kw(), step_s).node_temperature_c)
            self._cells_c = np.stack([np.nanmin(nodes_c, axis=1), np.nanmax(nodes_c, axis=1)])
            self._clock_s += step_s / self._speed
            whole_s -= step_s


class SimulatedPartner(ABC):
    """Serves a plant at a port of the loopback interface (0 = any free one); a context manager."""

    def __init__(self, plant: SimulatedPlant, port: int) -> None:
        self.plant = plant
        self._port = port

    @property
    @abstractmethod
    def address(self) -> str:
        """Address for ``--plant``."""

    def start(self) -> None:
        """Listen; after a stop, at the same port."""
        try:
            self._port = self._listen(self._port)
        except (RuntimeError, OSError) as error:
            self.stop()
            raise InputError(f"port {self._port}: cannot be listened at ({error}); use another") from error

    @abstractmethod
    def stop(self) -> None:
        """Break all connections, as when it is switched off; plant and watchdog continue."""

    @abstractmethod
    def _listen(self, port: int) -> int:
        """Begin to listen; return the port."""

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop()
