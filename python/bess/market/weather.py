"""Ambient temperature from weather files."""

from os import PathLike
from typing import Literal

import pandas as pd


def read_weather(
    path: str | PathLike[str],
    *,
    column: str | None = None,
    time_zone: str | None = None,
    fill: Literal["previous", "interpolate", "previous_day"] | None = None,
) -> pd.Series:
    """Read the ambient temperature [degC] of a weather file as a gap-free series in UTC."""
    raise NotImplementedError
