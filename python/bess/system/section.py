"""Bases of the sections of a system file."""

from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, model_validator


class Section(BaseModel):
    """Immutable section; rejects unknown keys, NaN and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


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
