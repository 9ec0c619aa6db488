"""What was lost on the way from the planner to the distilled controller, and what the rules lose."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

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
class Score:
    """What a policy made of a run [kWh], both directions.

    Attributes
    ----------
    lost_kwh : float
        Asked for and not delivered, and losses.
    cost_kwh : float
        The same, what is not delivered times ``shortfall``.
    """

    lost_kwh: float
    cost_kwh: float


@dataclass(frozen=True)
class Evaluation:
    """A run by all policies.

    Attributes
    ----------
    name : str
        What was run.
    scores : dict
        By the name of the policy; ``mpc`` and ``distilled`` among them.
    """

    name: str
    scores: Mapping[str, Score]

    def best_rule(self, measure: str) -> str:
        """The rule with the least ``lost_kwh`` or ``cost_kwh``."""
        return min(RULES, key=lambda rule: float(getattr(self.scores[rule], measure)))

    def kept(self, measure: str) -> float | None:
        """Share of what ``mpc`` saves against the best rule; None where it saves next to nothing."""
        rule, planned, own = (
            float(getattr(self.scores[name], measure))
            for name in (self.best_rule(measure), "mpc", "distilled")
        )
        return None if rule - planned < LITTLE * rule else (rule - own) / (rule - planned)


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
        yield Evaluation("as studied" if scale == 1.0 else f"demand x {scale:g}", scores)


def _score(study: Study, policy: DistilledPolicy | None, shortfall: float) -> Score:
    kpis = run(study, policy=policy, progress=False).kpis
    missing = kpis["availability_loss_kwh"] + kpis["derating_loss_kwh"]
    losses = kpis["inverter_loss_kwh"] + kpis["battery_loss_kwh"]
    return Score(missing + losses, shortfall * missing + losses)


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
            names = (trial.best_rule(measure), "mpc", "distilled")
            cells += [f"{getattr(trial.scores[name], measure):,.1f}" for name in names]
            kept = trial.kept(measure)
            cells.append("–" if kept is None else f"{100.0 * kept:.1f} %")
        rows.append(f"| {' | '.join(cells)} |")
    everything = [
        f"| {trial.name} | `{name}` | {score.lost_kwh:,.1f} | {score.cost_kwh:,.1f} |"
        for trial in made
        for name, score in trial.scores.items()
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
