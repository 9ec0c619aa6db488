"""Options with a fixed set of values."""

from enum import StrEnum


class Format(StrEnum):
    """Kinds of table that ``bess export`` writes."""

    CSV = "csv"
    PARQUET = "parquet"


class PlantKind(StrEnum):
    """Kinds of plant that ``bess demo-plant`` simulates."""

    OPENEMS = "openems"
    SUNSPEC = "sunspec"


class Kind(StrEnum):
    """Kinds of file that ``bess schema`` describes."""

    STUDY = "study"
    SYSTEM = "system"
