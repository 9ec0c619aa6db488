"""Controllers beside each other in every scenario of the bundled study ``arena``.

    python benches/arena.py                                   every rule and mpc, every scenario
    python benches/arena.py --policies mpc --only seven-days  one of them (rules always run beside it)
    python benches/arena.py --set policy.foresight_h=48       keys of the study, not for rules
    python benches/arena.py --page                            the tables of docs/arena.md (make arena)

Cost is 3 x undelivered + losses [kWh]; "against rules" is its difference to the best rule, in per cent.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import bess
from bess.study import expand

RULES = ("equal", "priority", "soc", "temperature")
PAGE = Path(__file__).parents[1] / "docs" / "_cases"
STORED = PAGE / "arena.json"
WINS = 3e-3
"""A rule wins where it costs less than this share of its cost, or delivers more by it."""
SHORTFALL = 3.0
"""What an undelivered kilowatt-hour costs, beside one of losses."""


@dataclass(frozen=True)
class Score:
    """Results of a controller in a scenario; energies in kWh, both directions.

    ``undelivered_kwh`` is availability and derating loss. It excludes unmet demand (above the power in
    service), which no controller can deliver.
    """

    asked_kwh: float
    delivered_kwh: float
    undelivered_kwh: float
    inverter_kwh: float
    battery_kwh: float
    availability_pct: float
    starts: float
    peak_c: float
    cpu_s: float
    net_eur: float | None = None

    @property
    def lost_kwh(self) -> float:
        """Undelivered energy and losses."""
        return self.undelivered_kwh + self.inverter_kwh + self.battery_kwh

    @property
    def cost_kwh(self) -> float:
        """Undelivered energy three times, and losses."""
        return SHORTFALL * self.undelivered_kwh + self.inverter_kwh + self.battery_kwh


def score(study: bess.Study) -> Score:
    """Run a study and measure it."""
    return measured(study)[0]


def measured(study: bess.Study) -> tuple[Score, bess.Result]:
    """Run a study and measure it; the result as well."""
    started = time.process_time()
    result = bess.run(study, progress=False)
    cpu_s = time.process_time() - started
    return score_of(result.kpis, float(result.dataset["inverter_starts"].sum()), cpu_s), result


def score_of(kpis: Mapping[str, float], starts: float, cpu_s: float) -> Score:
    """Score of a run with these KPIs."""
    return Score(
        asked_kwh=kpis["demand_kwh"] - kpis["unmet_kwh"],
        delivered_kwh=kpis["delivered_kwh"],
        undelivered_kwh=kpis["availability_loss_kwh"] + kpis["derating_loss_kwh"],
        inverter_kwh=kpis["inverter_loss_kwh"],
        battery_kwh=kpis["battery_loss_kwh"],
        availability_pct=kpis["availability_pct"],
        starts=starts,
        peak_c=kpis["peak_string_temperature_c"],
        cpu_s=cpu_s,
        net_eur=kpis.get("net_eur"),
    )


def scenarios(only: Iterable[str] = ()) -> dict[str, bess.Study]:
    """Scenarios of the arena by name, all or those named."""
    runs = expand(bess.load_study("arena"))
    if unknown := set(only) - set(runs):
        sys.exit(f"no such scenario: {', '.join(sorted(unknown))}; there are {', '.join(runs)}")
    return {name: study for name, study in runs.items() if not only or name in only}


def compete(
    study: bess.Study,
    policies: Iterable[str],
    values: Mapping[str, Any],
    score: Callable[[bess.Study], Score] = score,
) -> dict[str, Score]:
    """Scores of all rules, and of ``policies`` with ``values`` set, in one scenario."""
    scores = {name: score(study.with_values({"policy.name": name})) for name in RULES}
    for name in policies:
        if name not in RULES:
            scores[name] = score(study.with_values({"policy.name": name, **values}))
    return scores


def behind_rules(scores: Mapping[str, Score], policy: str) -> tuple[float, float]:
    """Cost above that of the cheapest rule, and energy delivered less than by the rule that delivers most.

    Both as a share of the rule's; negative where the policy is better.
    """
    cheapest = min(scores[rule].cost_kwh for rule in RULES)
    most = max(scores[rule].delivered_kwh for rule in RULES)
    mine = scores[policy]
    return mine.cost_kwh / cheapest - 1.0, 1.0 - mine.delivered_kwh / most


def line(name: str, policy: str, scores: Mapping[str, Score]) -> str:
    """One row of the table on screen."""
    s = scores[policy]
    text = (
        f"{name:22s} {policy:12s} {s.cost_kwh:9.1f} {s.lost_kwh:9.1f} {s.undelivered_kwh:9.1f} "
        f"{s.inverter_kwh:8.1f} {s.battery_kwh:8.1f} {s.delivered_kwh:10.1f} {s.availability_pct:7.2f} "
        f"{s.starts:6.0f} {s.peak_c:5.1f} {s.cpu_s:7.2f}"
    )
    if policy in RULES:
        return text
    cost, less = behind_rules(scores, policy)
    return f"{text}  {100.0 * cost:+7.2f} {-100.0 * less:+7.2f}"


def trades(folder: Path) -> dict[str, bess.Study]:
    """Scenarios in which a plant trades at synthetic prices, which are written into ``folder``."""
    hours = np.arange(24 * 6)
    random = np.random.default_rng(4)
    daily = 45.0 * np.sin(2.0 * np.pi * (hours - 1.0) / 12.0) - 20.0 * np.sin(2.0 * np.pi * hours / 24.0)
    price = pd.Series(75.0 + daily + random.normal(0.0, 9.0, hours.size)).round(2)
    times = pd.date_range("2024-01-01", periods=hours.size, freq="h", tz="UTC")
    table = pd.DataFrame({"time": times.strftime("%Y-%m-%dT%H:%M:%SZ"), "DE-LU": price})
    table.to_csv(folder / "prices.csv", index=False)
    return {
        f"{name}-trade": bess.Study.from_document(
            {
                "name": f"{name}-trade",
                "system": {"n_strings": count},
                "demand": {"kind": "arbitrage", "prices": str(folder / "prices.csv")},
                "run": {"days": 4},
            },
            "arena",
        )
        for name, count in (("two", 2), ("four", 4))
    }


def page() -> None:
    """Run everything, store it and write the tables of the page."""
    stored: dict[str, Any] = {"scenarios": {}, "trades": {}}
    for name, study in scenarios().items():
        scores = {rule: score(study.with_values({"policy.name": rule})) for rule in RULES}
        scores["mpc"], result = measured(study.with_values({"policy.name": "mpc"}))
        stored["scenarios"][name] = _plain(scores) | looked_back(result)
        print(line(name, "mpc", scores), flush=True)
    with tempfile.TemporaryDirectory(prefix="bess-arena-") as folder:
        for name, study in trades(Path(folder)).items():
            stored["trades"][name] = _plain(compete(study, ["mpc"], {}))
    STORED.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    for name, text in tables(json.loads(STORED.read_text(encoding="utf-8"))).items():
        (PAGE / name).write_text(text, encoding="utf-8")


def looked_back(result: bess.Result) -> dict[str, float]:
    """Best known result and lower bound by hindsight [kWh]."""
    sight = bess.hindsight(result)
    return {"possible_kwh": round(sight.found_kwh, 4), "proven_kwh": round(sight.bound_kwh, 4)}


def read(scenario: Mapping[str, Any]) -> dict[str, Score]:
    """Scores of a stored scenario."""
    return {name: Score(**values) for name, values in scenario.items() if isinstance(values, Mapping)}


def tables(stored: Mapping[str, Any]) -> dict[str, str]:
    """Text of the files that ``docs/arena.md`` includes."""
    everything = {name: read(scenario) for name, scenario in stored["scenarios"].items()}
    proven = {name: scenario["proven_kwh"] for name, scenario in stored["scenarios"].items()}
    short = [["scenario", "best rule", "cost of rule", "cost of `mpc`", "vs rule", "`mpc`", "best known",
              "lower bound", "best known / `mpc`"]]  # fmt: skip
    full = [["scenario", "policy", "undelivered + losses", "undelivered", "starts", "peak [°C]", "CPU [s]",
             "best known / policy"]]  # fmt: skip
    for name, scores in everything.items():
        rule = min(RULES, key=lambda each, scores=scores: scores[each].cost_kwh)
        possible = stored["scenarios"][name]["possible_kwh"]
        mpc = scores["mpc"]
        against = f"{100.0 * behind_rules(scores, 'mpc')[0]:+.1f} %"
        losses = _kwh(mpc.lost_kwh, possible, proven[name])
        short.append([f"`{name}`", f"`{rule}`", *_kwh(scores[rule].cost_kwh, mpc.cost_kwh), against,
                      *losses, _share(possible, mpc.lost_kwh)])  # fmt: skip
        for policy, each in scores.items():
            full.append([f"`{name}`", f"`{policy}`", *_kwh(each.lost_kwh, each.undelivered_kwh),
                         f"{each.starts:.0f}", f"{each.peak_c:.1f}", f"{each.cpu_s:.2g}",
                         _share(possible, each.lost_kwh)])  # fmt: skip
    money = [["scenario", *(f"`{policy}`" for policy in next(iter(stored["trades"].values())))]]
    for name, trade in stored["trades"].items():
        money.append([f"`{name}`", *(f"{each.net_eur or 0.0:.2f}" for each in read(trade).values())])
    made = {
        "arena.md": f"{_table(short)}\n{_sentence(everything)}\n",
        "arena-all.md": _table(full),
        "arena-money.md": _table(money),
    }
    return {name: f"<!-- written by make arena -->\n\n{text}" for name, text in made.items()}


def _sentence(everything: Mapping[str, Mapping[str, Score]]) -> str:
    behind = {name: behind_rules(scores, "mpc") for name, scores in everything.items()}
    costs = [cost for cost, _ in behind.values()]
    won = [f"`{name}`" for name, (cost, less) in behind.items() if cost > WINS or less > WINS]
    days = {name: study.run.days or np.nan for name, study in scenarios(everything).items()}
    starts = {
        policy: np.mean([scores[policy].starts / days[name] for name, scores in everything.items()])
        for policy in ("mpc", "equal", "priority")
    }
    return (
        f"In the mean over {len(behind)} scenarios `mpc` costs {100.0 * abs(np.mean(costs)):.1f} % "
        f"{'less' if np.mean(costs) < 0.0 else 'more'} than the best rule of each, at worst "
        f"{100.0 * max(costs):+.1f} %. A rule wins (by more than {100.0 * WINS:g} %, in cost or in energy "
        f"delivered) in {f'{len(won)}: ' + ', '.join(won) if won else 'none'}. Inverters start "
        f"{starts['mpc']:.0f} times a day under `mpc` ({starts['equal']:.0f} under `equal`, "
        f"{starts['priority']:.0f} under `priority`)."
    )


def _plain(scores: Mapping[str, Score]) -> dict[str, Any]:
    return {
        policy: {
            key: value if value is None else float(f"{value:.7g}") for key, value in asdict(each).items()
        }
        for policy, each in scores.items()
    }


def _kwh(*values: float) -> list[str]:
    return [f"{value:,.0f}" for value in values]


def _share(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.0f} %"


def _table(rows: list[list[str]]) -> str:
    head, *body = ("| " + " | ".join(row) + " |" for row in rows)
    return "\n".join([head, "|" + " --- |" * len(rows[0]), *body]) + "\n"


def main() -> None:
    """Run the arena and print its table."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    arguments.add_argument("--policies", nargs="*", default=["mpc"], help="beside the rules (default: mpc)")
    arguments.add_argument("--only", nargs="*", default=[], help="names of scenarios (default: all)")
    arguments.add_argument("--set", nargs="*", default=[], dest="values", help="key=value, not for rules")
    arguments.add_argument(
        "--rules", action="store_true", help="print the rows of all rules, not of the best"
    )
    arguments.add_argument("--json", type=Path, help="also write every score to this file")
    arguments.add_argument("--page", action="store_true", help="write the tables of the documentation")
    chosen = arguments.parse_args()
    if chosen.page:
        page()
        return
    values = {key: _value(text) for key, text in (item.split("=", 1) for item in chosen.values)}
    print(
        f"{'scenario':22s} {'policy':12s} {'cost':>9s} {'lost kWh':>9s} {'undeliv.':>9s} {'inverter':>8s} "
        f"{'battery':>8s} {'delivered':>10s} {'avail.%':>7s} {'starts':>6s} {'peakC':>5s} {'CPU s':>7s}"
        "  cost% deliv.% against rules"
    )
    everything = {}
    for name, study in scenarios(chosen.only).items():
        scores = everything[name] = compete(study, chosen.policies, values)
        best = min(RULES, key=lambda rule: scores[rule].cost_kwh)
        shown = RULES if chosen.rules else (best,)
        for policy in (*shown, *(p for p in scores if p not in RULES)):
            print(line(name, policy, scores), flush=True)
    for policy in chosen.policies:
        if policy not in RULES:
            print(summary(everything, policy))
    if chosen.json:
        chosen.json.write_text(
            json.dumps({n: {p: asdict(s) for p, s in c.items()} for n, c in everything.items()}, indent=1)
        )


def summary(everything: Mapping[str, Mapping[str, Score]], policy: str) -> str:
    """One sentence on a policy over all scenarios."""
    behind = {name: behind_rules(scores, policy) for name, scores in everything.items()}
    costs = [cost for cost, _ in behind.values()]
    lost = [name for name, (cost, less) in behind.items() if cost > WINS or less > WINS]
    cpu_s = sum(scores[policy].cpu_s for scores in everything.values())
    return (
        f"{policy}: cost against the best rule {100 * sum(costs) / len(costs):+.1f} % in the mean, "
        f"{100 * max(costs):+.2f} % at worst; a rule wins by more than 0.3 % (cost or delivered) in "
        f"{len(lost)} of {len(behind)}{': ' + ', '.join(lost) if lost else ''}; {cpu_s:.1f} CPU s"
    )


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


if __name__ == "__main__":
    main()
