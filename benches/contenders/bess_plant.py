"""The plant of this package alone: strings at 10 s and 40 nodes each, no control."""

import json
import resource
import sys

import numpy as np
from two_cycles import series

import bess


def main(days: float, strings: int) -> None:
    """Run ``days`` days and print CPU seconds, scaled to a string-year."""
    system = bess.System.reference(n_strings=strings)
    plant = bess.Plant(system, system.initial_state())
    request_kw = np.repeat(np.array(series(900.0, days, 39.0))[:, None], strings, axis=1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    record = plant.run(request_kw, step_s=900.0)
    cpu_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime - before
    print(
        json.dumps(
            {
                "version": bess.__version__,
                "string_year_cpu_s": cpu_s * 365.0 / days / strings,
                "simulated_days": days,
                "final_soc": float(record.soc[-1, 0]),
            }
        )
    )


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]))
