"""Explicit control: a control law with a bounded number of operations, from tables and fitted weights."""

from bess.control.explicit.controller import N_WEIGHTS, ExplicitController, Tables

__all__ = ["N_WEIGHTS", "ExplicitController", "Tables"]
