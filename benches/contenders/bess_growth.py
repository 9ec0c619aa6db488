"""How the time of one power split grows with strings and with steps: CPU seconds, weights 1, cold start.

The direction of the demand changes every hour, so that no string fills up or runs empty over a long horizon.
"""

import json
import sys
import time

import numpy as np
from splits import regular

import bess


def main(strings: int, steps: int, states: int) -> None:
    """Print medians over seeded states."""
    splitter = bess.PowerSplit(bess.System.reference(n_strings=strings), steps)
    seconds, splits = [], []
    for seed in range(-1, states):  # the first call compiles
        splitter.warm_start = None
        state, demand_kw = regular(abs(seed), strings, steps)
        demand_kw = np.where(np.arange(steps) // 4 % 2 == 0, demand_kw, -demand_kw)
        started = time.process_time()
        splits.append(splitter(state, demand_kw))
        seconds.append(time.process_time() - started)
    del seconds[0], splits[0]
    print(
        json.dumps(
            {
                "strings": strings,
                "steps": steps,
                "median_s": float(np.median(seconds)),
                "worst_s": max(seconds),
                "median_nodes": float(np.median([split.nodes for split in splits])),
                "median_search_gap": float(np.median([split.search_gap for split in splits])),
                "median_gap": float(np.median([split.gap for split in splits])),
            }
        )
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
