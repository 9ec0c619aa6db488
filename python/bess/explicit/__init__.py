"""Explicit control: a decision in a bounded number of operations, from tables and a few fitted weights."""

from bess.explicit.controller import N_WEIGHTS, ExplicitController
from bess.explicit.tables import Tables

__all__ = ["N_WEIGHTS", "ExplicitController", "Tables"]
