"""An explicit controller: tables of its plant, and weights; ``policy.json`` on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from bess import _core
from bess.arrays import Array
from bess.control.explicit.tables import Tables
from bess.errors import InputError
from bess.files import parse_json, read_file
from bess.system import State

N_WEIGHTS: Final = _core.Explicit.N_WEIGHTS
"""Weights of a controller; :mod:`bess.control.explicit.decision` defines their positions."""


class ExplicitController(BaseModel):
    """An explicit controller, as stored in ``policy.json``.

    Attributes
    ----------
    format : int
        Version of the file's layout.
    study, system : str
        Study and system of the training, for information.
    weights : tuple of float
        The fitted numbers, see :mod:`bess.control.explicit.decision`.
    tables : Tables
        Tables of the plant, and length of the demand forecast.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal[1] = 1
    study: str
    system: str
    weights: Annotated[tuple[FiniteFloat, ...], Field(min_length=N_WEIGHTS, max_length=N_WEIGHTS)]
    tables: Tables

    def model_post_init(self, context: Any) -> None:
        """Build and validate the core controller.

        Raises
        ------
        InputError
            The tables do not fit each other.
        """
        try:
            core = _core.Explicit(self.tables.model_dump())
        except ValueError as error:
            raise InputError(f"tables of an explicit controller: {error}") from error
        object.__setattr__(self, "_core", core)
        object.__setattr__(self, "_weights", np.array(self.weights))

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read ``policy.json``.

        Raises
        ------
        InputError
            The file is missing, or not from ``bess distil``.
        """
        try:
            return cls.model_validate(parse_json(read_file(path)))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except OSError as error:
            reason = error.strerror or error
            raise InputError(f"{path}: {reason}; give a policy.json from bess distil") from error
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"])) or "file"
            raise InputError(f"{path}: {place}: {first['msg']}; use a file of bess distil") from error
        except ValueError as error:
            raise InputError(f"{path}: is not a policy from bess distil ({error})") from error

    def to_json(self) -> str:
        """Text of ``policy.json``."""
        return self.model_dump_json(indent=1) + "\n"

    @property
    def core(self) -> _core.Explicit:
        """Control law in the core, with weights as arguments."""
        core: _core.Explicit = self.__dict__["_core"]
        return core

    def split(self, state: State, ahead_kw: Array, limit_kw: Array) -> Array:
        """Allocate the demand of the current step.

        Parameters
        ----------
        state : State
            Measured state of every string.
        ahead_kw : ndarray, shape (tables.steps,)
            Demand [kW] of this step, at most the sum of the limits, and of the next ones; positive =
            discharge.
        limit_kw : ndarray, shape (n_strings,)
            Maximum power of each inverter [kW]; 0 = out of service.

        Returns
        -------
        ndarray, shape (n_strings,)
            Set-points [kW], signed as the demand; they sum to the demand.
        """
        weights: Array = self.__dict__["_weights"]
        return self.core.split(
            weights,
            state.soc,
            state.temperature_c,
            state.soh_capacity,
            state.soh_resistance,
            limit_kw,
            ahead_kw,
        )
