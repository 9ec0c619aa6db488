"""What was lost on the way from the planner to the distilled controller, and what the rules lose."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import pandas as pd

from bess.control.explicit import ExplicitController
from bess.control.policies.distilled import DistilledPolicy
from bess.edge.distil.training import Variation
from bess.simulation.runner import run
from bess.study import Study

RULES: Final = ("equal", "priority", "soc", "temperature")
UNSEEN: Final = (Variation(1.0, scale=0.93), Variation(1.0, scale=1.05))
"""What a controller was not trained on, beside the study as it is."""
LITTLE: Final = 1e-3
"""Savings of the planner below this share of what a rule loses are too small to keep a share of."""


@dataclass(frozen=True)
class Evaluation:
    """A run under every policy.

    Attributes
    ----------
    name : str
        Which run.
    scores : DataFrame
        One row for each policy, ``mpc`` and ``distilled`` among them; columns in kWh, both directions:
        ``lost_kwh``, undelivered energy and losses; ``cost_kwh``, undelivered energy times ``shortfall`` and
        losses.
    """

    name: str
    scores: pd.DataFrame

    def best_rule(self, measure: str) -> str:
        """The rule with the lowest ``lost_kwh`` or ``cost_kwh``."""
        return str(self.scores.loc[list(RULES), measure].idxmin())

    def kept(self, measure: str) -> float | None:
        """Share of what ``mpc`` saves against the best rule; None where it saves next to nothing."""
        rule, planned, own = self.scores.loc[[self.best_rule(measure), "mpc", "distilled"], measure].tolist()
        return None if rule - planned < LITTLE * rule else float((rule - own) / (rule - planned))


def trials(study: Study, controller: ExplicitController) -> Iterator[Evaluation]:
    """The study as it is and, where the demand is a profile, with a demand that was no part of the
    training."""
    shortfall = controller.tables.shortfall
    for scale in (1.0, *(each.scale for each in UNSEEN if study.demand.kind == "profile")):
        asked = study
        if study.demand.kind == "profile" and scale != 1.0:
            asked = study.with_values({"demand.scale": scale * study.demand.scale})
        scores = {
            name: _score(asked.with_values({"policy.name": name}), None, shortfall)
            for name in (*RULES, "mpc")
        }
        scores["distilled"] = _score(asked, DistilledPolicy(controller), shortfall)
        table = pd.DataFrame.from_dict(scores, "index", columns=["lost_kwh", "cost_kwh"])
        yield Evaluation("as studied" if scale == 1.0 else f"demand x {scale:g}", table)


def _score(study: Study, policy: DistilledPolicy | None, shortfall: float) -> tuple[float, float]:
    kpis = run(study, policy=policy, progress=False).kpis
    missing = kpis["availability_loss_kwh"] + kpis["derating_loss_kwh"]
    losses = kpis["inverter_loss_kwh"] + kpis["battery_loss_kwh"]
    return missing + losses, shortfall * missing + losses


def report(study: Study, controller: ExplicitController, made: list[Evaluation]) -> str:
    """Text of ``report.md``."""
    rows = [
        "| run | best rule | it loses | `mpc` | distilled | kept "
        "| cost of the best rule | `mpc` | distilled | kept |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for trial in made:
        cells = [trial.name, f"`{trial.best_rule('lost_kwh')}`"]
        for measure in ("lost_kwh", "cost_kwh"):
            names = [trial.best_rule(measure), "mpc", "distilled"]
            cells += [f"{kwh:,.1f}" for kwh in trial.scores.loc[names, measure]]
            kept = trial.kept(measure)
            cells.append("–" if kept is None else f"{100.0 * kept:.1f} %")
        rows.append(f"| {' | '.join(cells)} |")
    everything = [
        f"| {trial.name} | `{name}` | {lost:,.1f} | {cost:,.1f} |"
        for trial in made
        for name, lost, cost in trial.scores.itertuples()
    ]
    tables = controller.tables
    return "\n".join(
        [
            f"# What was lost: {study.name}",
            "",
            f"A controller of {tables.strings} strings ({controller.system}), steps of "
            f"{tables.step_h * 60:g} min, told {tables.steps * tables.step_h:g} h ahead. Energies in kWh "
            "over the run. Lost is what was asked for and not delivered, and the losses of inverters and "
            f"batteries; cost counts what was not delivered {tables.shortfall:g} times. Kept is the share of "
            "what `mpc` saves against the best rule; above 100 % the distilled controller loses less than "
            "`mpc`. Runs other than the study itself were no part of the training.",
            "",
            *rows,
            "",
            "## Every policy",
            "",
            "| run | policy | lost | cost |",
            "| --- | --- | ---: | ---: |",
            *everything,
            "",
        ]
    )
