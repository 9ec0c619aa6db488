"""Policies that are handed to ``bess.run``: objects of the protocol, or plain functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from numpy.typing import ArrayLike

from bess.errors import InputError
from bess.policies.policy import NO_OPTIMISATION, Decision, Policy, Situation

Function = Callable[[Situation], "Decision | ArrayLike"]

_PROTOCOL = ("memory", "recall", "statuses")


class FunctionPolicy:
    """A function from a situation to set-points as a policy: it solves nothing and remembers nothing.

    Parameters
    ----------
    function
        Takes a :class:`~bess.policies.Situation` and returns set-points [kW], one for each string, or a
        :class:`~bess.policies.Decision`.
    """

    statuses: Mapping[int, str] = {NO_OPTIMISATION: "no optimisation"}

    def __init__(self, function: Function) -> None:
        self._function = function

    def __call__(self, situation: Situation) -> Decision:
        """Share the demand as the function does."""
        answer = self._function(situation)
        return answer if isinstance(answer, Decision) else Decision(answer)  # type: ignore[arg-type]

    def memory(self) -> dict[str, Any]:
        """Nothing is carried from step to step."""
        return {}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Nothing is continued."""


def own_policy(policy: Policy | Function) -> tuple[str, Policy]:
    """Return the name of a policy and the policy itself.

    Raises
    ------
    InputError
        If it cannot be called, or has a part of the protocol and not the rest.
    """
    if isinstance(policy, str):
        raise InputError(
            f"policy = {policy!r}: a policy that has a name is the study's: "
            f'load_study(..., {{"policy.name": {policy!r}}})'
        )
    if not callable(policy):
        raise InputError(
            f"policy: {type(policy).__name__} cannot be called; give a function from a Situation to "
            "set-points, or an object of the protocol bess.policies.Policy"
        )
    name = getattr(policy, "__name__", type(policy).__name__)
    present = [part for part in _PROTOCOL if hasattr(policy, part)]
    if not present:
        return name, FunctionPolicy(policy)
    if missing := sorted(set(_PROTOCOL) - set(present)):
        raise InputError(f"policy {name}: has {', '.join(present)}, but no {', '.join(missing)}")
    return name, policy  # type: ignore[return-value]
