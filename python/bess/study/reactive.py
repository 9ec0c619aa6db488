"""Section ``[reactive]`` of a study file."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import model_validator

from bess.files import Fill
from bess.system.quantities import Positive, within
from bess.system.section import Section


class ReactiveSection(Section):
    """Section ``[reactive]``: reactive power demand in addition to active power.

    Either ``kvar`` (constant), ``power_factor`` (in proportion to active power) or ``file``, read with
    :func:`bess.dispatch.read_profile`. Positive = supplied to the grid (over-excited).
    """

    kvar: Annotated[float, within(-1e6, 1e6, "kvar")] | None = None
    power_factor: Annotated[float, within(0.0, 1.0, above=True)] | None = None
    file: str | None = None
    column: str | None = None
    unit: Literal["kvar", "var", "Mvar"] = "kvar"
    scale: Positive = 1.0
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    forecast: Literal["perfect", "persistence"] = "perfect"

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = [name for name in ("kvar", "power_factor", "file") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of kvar, power_factor and file, not {' and '.join(given) or 'none'}")
        return self
