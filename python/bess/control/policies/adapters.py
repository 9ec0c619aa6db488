"""Policies passed to ``bess.run``: objects of the protocol, or plain functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from numpy.typing import ArrayLike

from bess.checkpoints import Checkpointed
from bess.control.policies.policy import NO_OPTIMISATION, Decision, Policy, PolicyInput
from bess.errors import InputError

Function = Callable[[PolicyInput], "Decision | ArrayLike"]

_PROTOCOL = ("load_state_dict", "state_dict", "statuses")


class FunctionPolicy(Checkpointed):
    """A function from a policy input to set-points, as a policy without solver and state.

    Parameters
    ----------
    function
        Takes a :class:`~bess.control.policies.PolicyInput` and returns set-points [kW], one for each string,
        or a :class:`~bess.control.policies.Decision`.
    """

    statuses: Mapping[int, str] = {NO_OPTIMISATION: "no optimisation"}

    def __init__(self, function: Function) -> None:
        self._function = function

    def __call__(self, inputs: PolicyInput) -> Decision:
        """Allocate the demand with the function."""
        answer = self._function(inputs)
        return answer if isinstance(answer, Decision) else Decision(answer)  # type: ignore[arg-type]


def as_policy(policy: Policy | Function) -> tuple[str, Policy]:
    """Return the name of a policy and the policy itself.

    Raises
    ------
    InputError
        The policy is not callable, or implements the protocol only in part.
    """
    if isinstance(policy, str):
        raise InputError(
            f"policy = {policy!r}: set named policies in the study: "
            f'load_study(..., {{"policy.name": {policy!r}}})'
        )
    if not callable(policy):
        raise InputError(
            f"policy: {type(policy).__name__} is not callable; give a function from a PolicyInput to "
            "set-points, or an object of the protocol bess.control.policies.Policy"
        )
    name = getattr(policy, "__name__", type(policy).__name__)
    present = [part for part in _PROTOCOL if hasattr(policy, part)]
    if not present:
        return name, FunctionPolicy(policy)
    if missing := sorted(set(_PROTOCOL) - set(present)):
        raise InputError(f"policy {name}: has {', '.join(present)}, but no {', '.join(missing)}")
    if not isinstance(getattr(policy, "statuses"), Mapping):  # noqa: B009
        raise InputError(f"policy {name}: statuses must be a table of texts by their code")
    return name, policy  # type: ignore[return-value]
