"""The policies by name. A new one is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable

from bess.errors import InputError
from bess.parameters import System
from bess.policies import equal, mpc, priority, soc, temperature
from bess.policies.policy import Policy
from bess.policies.rule import RulePolicy, Share
from bess.policies.settings import Settings

Factory = Callable[[System, Settings], Policy]


def _rule(share: Share) -> Factory:
    return lambda system, settings: RulePolicy(system, settings.dt_h, share)


POLICIES: dict[str, tuple[Factory, str]] = {
    "equal": (_rule(equal.share), "every string the same power"),
    "priority": (_rule(priority.share), "fill one string, then the next"),
    "soc": (_rule(soc.share), "in proportion to the energy or room left"),
    "temperature": (
        _rule(temperature.share),
        "in proportion to nominal power and the distance from derating",
    ),
    "mpc": (mpc.build, "mixed-integer model predictive control over the horizon"),
}


def build_policy(name: str, system: System, settings: Settings) -> Policy:
    """Return the policy of this name for a system."""
    if name not in POLICIES:
        raise InputError(f"policy.name = {name!r}: no such policy; allowed: {', '.join(POLICIES)}")
    factory, _ = POLICIES[name]
    return factory(system, settings)
