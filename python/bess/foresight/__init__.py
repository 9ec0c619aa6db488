"""Foresight: plans of a day or more, carried from step to step."""

from bess.foresight.planner import Plan, Planner
from bess.foresight.power_plan import plan_power
from bess.foresight.prices import PlanPrices

__all__ = ["Plan", "PlanPrices", "Planner", "plan_power"]
