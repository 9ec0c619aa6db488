"""Distilled controllers in the scenarios of the arena, beside what `make arena` stored of the others.

    python benches/distilled.py                            every scenario; about a CPU minute each
    python benches/distilled.py --only seven-days two-hot  some of them; others stay as stored
    python benches/distilled.py --table                    none: the table beside a new arena (make arena)

Writes docs/_cases/distil.json and the table of docs/howto/distil.md.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from typing import Any

import bess
from arena import PAGE, RULES, STORED, read, scenarios
from bess.control.policies.distilled import DistilledPolicy
from bess.edge.distil import GENERATIONS, distil

KEPT, TABLE = PAGE / "distil.json", PAGE / "distil.md"


def measure(study: bess.Study, generations: int) -> dict[str, float]:
    """Distil a scenario and run it [kWh, CPU s]."""
    started = time.process_time()
    controller = distil(study, generations=generations, progress=False)
    cpu_s = time.process_time() - started
    kpis = bess.run(study, policy=DistilledPolicy(controller), progress=False).kpis
    missing = kpis["availability_loss_kwh"] + kpis["derating_loss_kwh"]
    losses = kpis["inverter_loss_kwh"] + kpis["battery_loss_kwh"]
    return {
        "lost_kwh": round(missing + losses, 1),
        "cost_kwh": round(3.0 * missing + losses, 1),
        "cpu_s": round(cpu_s),
        "generations": generations,
    }


def table(kept: Mapping[str, Mapping[str, float]]) -> str:
    """Text of the file that the page includes."""
    stored: Mapping[str, Any] = json.loads(STORED.read_text(encoding="utf-8"))
    rows = [
        "| scenario | best rule loses | `mpc` | distilled | kept "
        "| cost of the best rule | `mpc` | distilled | kept |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    saved = {"lost_kwh": [0.0, 0.0], "cost_kwh": [0.0, 0.0]}
    worst = -1.0
    for name in (name for name in stored["scenarios"] if name in kept):
        scores = read(stored["scenarios"][name])
        cells = [f"`{name}`"]
        for measured in ("lost_kwh", "cost_kwh"):
            rule = min(getattr(scores[each], measured) for each in RULES)
            planned, own = getattr(scores["mpc"], measured), kept[name][measured]
            share = (
                "–" if rule - planned < 1e-3 * rule else f"{100.0 * (rule - own) / (rule - planned):.0f} %"
            )
            cells += [f"{value:,.0f}" for value in (rule, planned, own)] + [share]
            saved[measured][0] += rule - own
            saved[measured][1] += rule - planned
            if measured == "lost_kwh":
                worst = max(worst, own / rule - 1.0)
        rows.append(f"| {' | '.join(cells)} |")
    lost, cost = (100.0 * own / planned for own, planned in saved.values())
    return (
        "<!-- written by benches/distilled.py -->\n\n" + "\n".join(rows) + "\n\n"
        f"Over these {len(rows) - 2} scenarios, distilled controllers keep {lost:.0f} % of what `mpc` "
        f"saves in lost energy and {cost:.0f} % in cost. The lost energy differs from that of the best rule "
        f"by {100.0 * worst:+.1f} % in the worst scenario.\n"
    )


def main() -> None:
    """Measure and write."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("--only", nargs="*", default=[], help="names of scenarios (default: all)")
    arguments.add_argument("--generations", type=int, default=GENERATIONS)
    arguments.add_argument("--table", action="store_true", help="write the table of what is stored")
    chosen = arguments.parse_args()
    kept = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    for name, study in ({} if chosen.table else scenarios(chosen.only)).items():
        kept[name] = measure(study, chosen.generations)
        print(name, kept[name], flush=True)
        KEPT.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    TABLE.write_text(table(kept), encoding="utf-8")


if __name__ == "__main__":
    main()
