"""Registry of policies. A new policy is one file and one line here, or an entry point of another package."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Final, cast

from bess.control.policies import distilled, mpc
from bess.control.policies.policy import Policy
from bess.control.policies.rule import RulePolicy
from bess.control.policies.settings import Settings
from bess.errors import InputError
from bess.system import System

Factory = Callable[[System, Settings], Policy]

PLUG_INS: Final = "bess.policies"
"""Group of entry points; each names a function from a system and settings to a policy."""


def _rule(name: str) -> Factory:
    return lambda system, settings: RulePolicy(system, settings.dt_h, name)


RULES: Final = {
    "equal": "equal power in every string",
    "priority": "fill one string, then the next",
    "soc": "in proportion to stored energy or headroom",
    "temperature": "in proportion to nominal power and the distance from derating",
}
"""Rules of the core by name, with their descriptions."""

POLICIES: dict[str, tuple[Factory, str]] = {
    **{name: (_rule(name), text) for name, text in RULES.items()},
    "mpc": (mpc.build, "a plan of a day, or a certified mixed-integer split of the next steps"),
    "distilled": (distilled.build, "controller from bess distil (policy.file), without a solver"),
}


def plug_ins() -> dict[str, EntryPoint]:
    """Policies of other installed packages, by name; bundled policies have precedence."""
    return {point.name: point for point in entry_points(group=PLUG_INS) if point.name not in POLICIES}


def build_policy(name: str, system: System, settings: Settings) -> Policy:
    """Return the policy of this name for a system, bundled or from a plug-in.

    Raises
    ------
    InputError
        No policy has this name, or the plug-in cannot be loaded.
    """
    if name in POLICIES:
        factory, _ = POLICIES[name]
        return factory(system, settings)
    others = plug_ins()
    if name not in others:
        raise InputError(
            f"policy.name = {name!r}: no such policy; allowed: {', '.join([*POLICIES, *sorted(others)])}"
        )
    try:
        factory = cast(Factory, others[name].load())
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(
            f"policy.name = {name!r}: the plug-in {others[name].value} fails: {reason}"
        ) from error
    return factory(system, settings)
