"""Bases of the sections of a system file."""

from typing import Any, ClassVar, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from bess.errors import InputError
from bess.system.documents import describe


class Section(BaseModel):
    """Immutable section; rejects unknown keys, NaN and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse every change."""
        raise InputError(
            f"{type(self).__name__}: {name} cannot be set; build a new one, as study.with_values does"
        )


class PublicSection(Section):
    """Section that is also a class of the Python interface; invalid arguments raise InputError."""

    def __init__(self, **values: Any) -> None:
        # Integers of NumPy, which pydantic does not take as such.
        values = {
            name: int(value) if isinstance(value, np.integer) else value for name, value in values.items()
        }
        try:
            super().__init__(**values)
        except ValidationError as error:
            message = describe(error.errors(), type(self))
            raise InputError(f"{type(self).__name__}: {message}") from error

    # Inside a file, pydantic fills the fields without this method: the error names the place in the file.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


class Table(Section):
    """Section with values over axes; ``axes`` gives the axes of each table, the outermost first."""

    axes: ClassVar[dict[str, tuple[str, ...]]]

    @model_validator(mode="after")
    def _check_shapes(self) -> Self:
        for name, axes in self.axes.items():
            self._check_shape(name, getattr(self, name), axes)
        return self

    def _check_shape(self, name: str, values: tuple[Any, ...], axes: tuple[str, ...]) -> None:
        knots = len(getattr(self, axes[0]))
        if len(values) != knots:
            raise ValueError(f"{name} has {len(values)} values, {axes[0]} has {knots}; give one per knot")
        for row in values if axes[1:] else ():
            self._check_shape(name, row, axes[1:])
