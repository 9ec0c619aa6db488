"""Base of all sections of a system file."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """Immutable section; rejects unknown keys, NaN and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
