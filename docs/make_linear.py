"""Answer ``linear-nonlinear.md``: ``python docs/make_linear.py FOLDER``, six minutes of CPU.

Runs the bundled study ``linear-nonlinear`` one run after the other, so that CPU seconds compare, and beside
it the certified split, which searches in a convexified program. FOLDER keeps the runs; what is finished there
is not run again.
"""

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tables import markdown_table

import bess
from bess.study.scenarios import expand

DOCS = Path(__file__).parent
STORED = DOCS / "_cases" / "linear.json"
TABLE = DOCS / "_cases" / "linear.md"
ANSWER = DOCS / "_cases" / "linear-answer.md"
STUDY = "linear-nonlinear"
SERVICES = ("two-cycle", "fcr", "peak-shaving", "self-consumption", "arbitrage")
STEPS_MIN = (15, 5, 1)
MODELS = ("linear", "convex", "certified", "nonlinear")
KEPT = ("demand_kwh", "undelivered_kwh", "inverter_loss_kwh", "battery_loss_kwh", "lost_kwh")
SAME_DEMAND = tuple(service for service in SERVICES if service != "fcr")
"""Services whose demand is given by quarters of an hour; frequency asks for more at shorter steps."""
CERTIFIED_STEPS = 8

Numbers = Mapping[str, Mapping[str, float]]


def studies() -> dict[str, bess.Study]:
    """Every run by name: ``SERVICE MIN MODEL``."""
    runs = expand(bess.load_study(STUDY))
    named = {}
    for service in SERVICES:
        for minutes in STEPS_MIN:
            for model in MODELS:
                swept = "nonlinear" if model == "certified" else model
                study = runs[f"{service}-{minutes}min_model={swept}"]
                named[f"{service} {minutes} {model}"] = certified(study) if model == "certified" else study
    return named


def certified(study: bess.Study) -> bess.Study:
    """The same with a certified split of eight steps in place of a plan."""
    document = study.document()
    document["name"] = study.name.replace("nonlinear", "certified")
    for key in ("foresight_h", "rollouts"):
        del document["policy"][key]
    document["policy"] |= {"mode": "certified", "horizon_steps": CERTIFIED_STEPS}
    return bess.Study.from_document(document, document["name"])


def measure(folder: Path) -> dict[str, dict[str, float]]:
    """Key figures and CPU seconds of every run, in the order of the table."""
    numbers: dict[str, dict[str, float]] = {}
    for name, study in studies().items():
        kept = folder / f"{study.name}.json"
        if not kept.exists():
            started = time.process_time()
            kpis = bess.run(study, progress=False).kpis
            figures = {key: float(f"{kpis[key]:.6g}") for key in KEPT}
            kept.write_text(json.dumps(figures | {"cpu_s": round(time.process_time() - started, 1)}))
            print(name, figures["lost_kwh"], flush=True)
        numbers[name] = json.loads(kept.read_text())
    return numbers


def table(numbers: Numbers) -> str:
    """Undelivered energy and losses in per cent of the demand, and CPU seconds of the week."""
    rows = [["service", "step [min]", *(f"{model}" for model in MODELS), *(f"{m}, CPU s" for m in MODELS)]]
    for service in SERVICES:
        for minutes in STEPS_MIN:
            entries = [numbers.get(f"{service} {minutes} {model}") for model in MODELS]
            lost = ["–" if entry is None else f"{lost_pct(entry):.2f}" for entry in entries]
            cpu = ["–" if entry is None else f"{entry['cpu_s']:.0f}" for entry in entries]
            rows.append([service, str(minutes), *lost, *cpu])
    return markdown_table(rows)


def answer(numbers: Numbers) -> str:
    """Whether faster feedback makes up for a simpler model, from the numbers."""
    slow, fast = STEPS_MIN[0], STEPS_MIN[-1]

    def lost(service: str, minutes: int, model: str) -> float:
        return lost_pct(numbers[f"{service} {minutes} {model}"])

    ahead = [s for s in SAME_DEMAND if lost(s, slow, "linear") < lost(s, slow, "nonlinear")]
    turned = [
        s for s in SAME_DEMAND if s not in ahead and lost(s, fast, "linear") < lost(s, slow, "nonlinear")
    ]
    speed = _listed({s: lost(s, slow, "linear") - lost(s, fast, "linear") for s in SAME_DEMAND})
    model = _listed({s: lost(s, slow, "linear") - lost(s, slow, "nonlinear") for s in SERVICES})
    cpu = sum(numbers[f"{s} {fast} linear"]["cpu_s"] for s in SERVICES)
    cpu /= sum(numbers[f"{s} {slow} nonlinear"]["cpu_s"] for s in SERVICES)
    verdict = f"Yes, for {', '.join(turned)}" if turned else "No"
    text = (
        f"**{verdict}.** Savings in percentage points of the demand, of the linear model with steps of "
        f"{fast} min instead of {slow} min: {speed}. Savings of the nonlinear model over the linear one "
        f"at {slow} min: {model}. The linear controller at {fast} min took {cpu:.1f} times the CPU time of "
        f"the nonlinear one at {slow} min.\n"
    )
    shorter = _listed({s: lost(s, fast, "nonlinear") - lost(s, slow, "nonlinear") for s in SAME_DEMAND})
    text += (
        f"\nWith steps of {fast} min, and a prediction horizon of 1.6 h instead of a day, the nonlinear "
        f"controller is worse as well: {shorter}.\n"
    )
    if ahead:
        text += (
            f"\nIn {' and '.join(ahead)} the linear model is better than the nonlinear one already at {slow} "
            "min, so its advantage is not due to shorter steps: see below.\n"
        )
    return text


def _listed(points: Mapping[str, float]) -> str:
    return ", ".join(f"{service} {value:+.2f}" for service, value in points.items())


def lost_pct(entry: Mapping[str, float]) -> float:
    """Undelivered energy and losses in per cent of the demand."""
    return 100.0 * entry["lost_kwh"] / entry["demand_kwh"]


def stored() -> Any:
    """Numbers as the page shows them."""
    return json.loads(STORED.read_text(encoding="utf-8"))


def main(folder: Path) -> None:
    """Measure and write."""
    folder.mkdir(parents=True, exist_ok=True)
    STORED.write_text(json.dumps(measure(folder), indent=1) + "\n", encoding="utf-8")
    for path, text in ((TABLE, table(stored())), (ANSWER, answer(stored()))):
        path.write_text(f"<!-- written by docs/make_linear.py -->\n\n{text}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
