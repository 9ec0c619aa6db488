"""Policies: how the demand of a step is shared among the strings.

A new policy is one file and one line in ``POLICIES``; an entry point ``bess.policies`` of another package; or
an object handed to :func:`bess.run`.
"""

from bess.policies.own import own_policy
from bess.policies.policy import NO_OPTIMISATION, Decision, Policy, Situation, SolverReport
from bess.policies.registry import POLICIES, build_policy, plug_ins
from bess.policies.settings import Settings

__all__ = [
    "NO_OPTIMISATION",
    "POLICIES",
    "Decision",
    "Policy",
    "Settings",
    "Situation",
    "SolverReport",
    "build_policy",
    "own_policy",
    "plug_ins",
]
