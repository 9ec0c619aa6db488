"""Power plans over a day or more, re-optimised in every control step."""

from bess.control.planning.planner import Plan, Planner
from bess.control.planning.power_plan import plan_power
from bess.control.planning.prices import PlanPrices

__all__ = ["Plan", "PlanPrices", "Planner", "plan_power"]
