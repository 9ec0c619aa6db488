"""Looking back at a finished run: what was possible, and what was not."""

from bess.retrospect.bound import Worth, lower_bound
from bess.retrospect.possible import Hindsight, hindsight

__all__ = ["Hindsight", "Worth", "hindsight", "lower_bound"]
