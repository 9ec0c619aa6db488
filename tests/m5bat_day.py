"""The measured day of M5BAT under the policies of the example."""

import sys
from pathlib import Path

import numpy as np

from once import Once

sys.path.append(str(Path(__file__).parents[1] / "examples"))

import m5bat


def replayed(once: Once, policy: str, demand_kw: np.ndarray) -> m5bat.Replay:
    """Run the day under a policy, unless another test has; only this day has a place."""
    return m5bat.Replay(**once.made(f"m5bat-{policy}", lambda: vars(m5bat.replay(policy, demand_kw))))
