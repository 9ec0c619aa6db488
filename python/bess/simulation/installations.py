"""Strings that are added, replaced or retired during a run."""

from __future__ import annotations

import numpy as np

from bess.arrays import Array, Flags
from bess.checkpoints import Checkpointed
from bess.errors import InputError
from bess.plant import Plant
from bess.study.events import check_string
from bess.study.grid import TimeGrid, seconds_of
from bess.study.study import Study
from bess.system import System


class Installations(Checkpointed):
    """New batteries of a run: on their dates, and at the end of life of the old ones.

    A new battery has a state of health of 1 and takes over SOC and temperature of the string. It is installed
    at the start of the first control step on or after its date, or after the end of life.

    Parameters
    ----------
    system : System
        The plant; ``wear.at_end_of_life`` of a string says whether it continues, is retired or is replaced.
    study : Study
        Study with the tables ``[[replacement]]`` and ``[[augmentation]]``.
    grid : TimeGrid
        Control steps.

    Attributes
    ----------
    any : bool
        Whether the run can have any such event.
    """

    _carried = ("_ended",)

    def __init__(self, system: System, study: Study, grid: TimeGrid) -> None:
        wears = [string.wear for string in system.strings]
        self._replaces = np.array([wear.at_end_of_life == "replace" for wear in wears])
        self._retires = np.array([wear.at_end_of_life == "retire" for wear in wears])
        ages = np.array([wear.cell_model is not None for wear in wears])
        self._end_of_life = np.where(ages, [wear.end_of_life for wear in wears], -np.inf)
        price_eur_kwh = np.array([wear.replacement_eur_kwh for wear in wears])
        self._cost_eur = price_eur_kwh * system.nominal_energy_kwh
        self._first_step = np.zeros(system.n_strings, dtype=np.int64)
        self._dated: dict[int, dict[int, float]] = {}
        for name, tables in (("replacement", study.replacement), ("augmentation", study.augmentation)):
            for number, table in enumerate(tables):
                check_string(f"{name}[{number}]", table.string, system)
                step = -((grid.start_s - seconds_of(table.date)) // grid.step_s)
                if step <= 0:
                    raise InputError(
                        f"{name}[{number}].date = {table.date:%Y-%m-%d %H:%M} UTC: must be after the start "
                        f"of the run, {grid}"
                    )
                eur_kwh = price_eur_kwh[table.string] if table.eur_kwh is None else table.eur_kwh
                dated = self._dated.setdefault(step, {})
                if table.string in dated:
                    raise InputError(
                        f"{name}[{number}].date = {table.date:%Y-%m-%d %H:%M} UTC: another battery of string "
                        f"{table.string} has a date in the same control step; leave one out"
                    )
                dated[table.string] = float(eur_kwh * system.nominal_energy_kwh[table.string])
                if name == "augmentation":
                    earlier = self._first_step[table.string]
                    self._first_step[table.string] = min(step, earlier or step)
        for step, dated in self._dated.items():
            if early := [string for string in dated if step < self._first_step[string]]:
                raise InputError(f"replacement: string {early[0]} gets a new battery before it is added")
        self.any = bool(self._dated or (ages & (self._replaces | self._retires)).any())
        self._ended = np.zeros(system.n_strings, dtype=np.bool_)

    def install(self, step: int, plant: Plant) -> Array:
        """Install the batteries of a step; return their cost [EUR], shape ``(n_strings,)``."""
        new = self._ended & self._replaces
        cost_eur = np.where(new, self._cost_eur, 0.0)
        for string, eur in self._dated.get(step, {}).items():
            new[string], cost_eur[string] = True, eur
        if new.any():
            plant.renew(new)
            self._ended = self._ended & ~new
        return cost_eur

    def in_service(self, step: int) -> Flags:
        """Whether each string is installed and not retired, after :meth:`install`."""
        return (step >= self._first_step) & ~self._ended

    def count_ended(self, in_service: Flags, soh_capacity: Array) -> None:
        """Record the strings in service that reached their end of life in a step."""
        ends = self._replaces | self._retires
        self._ended = self._ended | (in_service & ends & (soh_capacity <= self._end_of_life))
