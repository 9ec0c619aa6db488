"""Policies: allocation of the demand of a step to the strings.

A new policy is one file and one line in ``POLICIES``, an entry point ``bess.policies`` of another package, or
an object passed to :func:`bess.run`.
"""

from bess.control.policies.adapters import as_policy
from bess.control.policies.policy import NO_OPTIMISATION, Decision, Policy, PolicyInput, SolverReport
from bess.control.policies.registry import POLICIES, build_policy, plug_ins
from bess.control.policies.settings import PolicySection, Settings

__all__ = [
    "NO_OPTIMISATION",
    "POLICIES",
    "Decision",
    "Policy",
    "PolicyInput",
    "PolicySection",
    "Settings",
    "SolverReport",
    "as_policy",
    "build_policy",
    "plug_ins",
]
