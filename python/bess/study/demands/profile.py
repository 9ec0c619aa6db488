"""Demand of kind ``profile``: a given power series."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from bess.arrays import Array
from bess.dispatch import PROFILES, Forecast
from bess.files import Fill
from bess.study.demands.source import (
    DemandSection,
    DemandSource,
    RunDemand,
    Setting,
    StepInputs,
    forecast_of,
    padded,
)
from bess.system.quantities import Positive


class ProfileDemand(DemandSection):
    """Section ``[demand]`` with ``kind = "profile"``: a given power series.

    ``file`` is a bundled profile or a CSV or Parquet file, read with :func:`bess.dispatch.read_profile`;
    ``repeat`` repeats it.
    """

    files: ClassVar = ("file",)

    kind: Literal["profile"] = "profile"
    file: str
    column: str | None = None
    unit: Literal["kW", "W", "MW"] = "kW"
    positive: Literal["discharge", "charge"] = "discharge"
    scale: Positive = 1.0
    time_zone: str | None = None
    fill: Fill | None = None
    repeat: bool = False
    forecast: Literal["perfect", "persistence"] = "perfect"

    def build(self, setting: Setting) -> RunDemand:
        """See :class:`~bess.study.demands.source.DemandSection`."""
        reading = self.model_dump(include={"scale", "column", "unit", "positive", "time_zone", "fill"})
        series = setting.power_of(self.file, "demand.file", PROFILES, **reading)
        grid = setting.grid_of(series)
        values = series.on(grid, repeat=self.repeat)
        setting.note(f"demand: {series.what}, {values.min():g} to {values.max():g} kW", series)
        nominal_kw = setting.system.nominal_kw.sum()
        if above := int((np.abs(values) > nominal_kw * (1.0 + 1e-9)).sum()):
            setting.note(f"demand is above the {nominal_kw:g} kW of the plant in {above} steps (unmet)")
        return RunDemand(grid, ProfileSource(forecast_of(self.forecast, values, grid.dt_h)))


@dataclass(eq=False)
class ProfileSource(DemandSource):
    """A known series; the demand after the end of the run is zero."""

    forecast: Forecast

    def ahead(self, step: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        return padded(self.forecast.ahead(step, horizon), horizon)

    def block(self, step: int, most: int, horizon: int, now: StepInputs) -> Array:
        """See :class:`~bess.study.demands.source.DemandSource`."""
        return np.array([self.ahead(each, horizon, now) for each in range(step, step + most)])
