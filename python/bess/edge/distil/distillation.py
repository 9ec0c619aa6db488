"""``bess distil``: from a study to a folder with a controller and its evaluation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pandas as pd

from bess.arrays import Array, whole_number
from bess.control.explicit import ExplicitController, Tables
from bess.control.objectives import SHORTFALL
from bess.control.policies.distilled import DistilledPolicy
from bess.control.policies.reactive import refuse_reactive
from bess.control.policies.registry import RULES
from bess.edge.distil.training import GENERATIONS, TrainingCase, TrainingSet, first_weights, fit
from bess.edge.distil.translate import exports
from bess.errors import InputError
from bess.files import path_of
from bess.simulation.progress import reporting
from bess.simulation.record.files import REPEAT, folder_in, make_folder, write_bytes
from bess.simulation.runner import run
from bess.study import Study, expand
from bess.study.study import as_study

UNTRAINED_DEMANDS: Final = (0.93, 1.05)
"""Factors on the demand that are evaluated in addition to the study, and not part of the training."""
MIN_RELATIVE_SAVINGS: Final = 1e-3
"""Minimum savings of ``mpc``, relative to the ``lost_kwh`` of a rule, for a share of savings retained."""


@dataclass(frozen=True)
class Evaluation:
    """A run under every policy.

    ``scores`` has one row for each policy and the columns ``lost_kwh``, undelivered energy and losses, and
    ``cost_kwh``, undelivered energy times ``shortfall`` and losses, of both directions.
    """

    name: str
    scores: pd.DataFrame

    def best_rule(self, measure: str) -> str:
        """The rule with the lowest ``lost_kwh`` or ``cost_kwh``."""
        return str(self.scores.loc[list(RULES), measure].idxmin())

    def kept(self, measure: str) -> float | None:
        """Share of the savings of ``mpc`` over the best rule; None if these are negligible."""
        rule, planned, own = self.scores.loc[[self.best_rule(measure), "mpc", "distilled"], measure].tolist()
        savings = rule - planned
        return None if savings <= MIN_RELATIVE_SAVINGS * rule else float((rule - own) / savings)


def trials(study: Study, controller: ExplicitController) -> Iterator[Evaluation]:
    """Evaluate the study and, if its demand is a profile, demands that were not part of the training."""
    shortfall = controller.tables.shortfall
    asked = {"as studied": study}
    if study.demand.kind == "profile":
        for scale in UNTRAINED_DEMANDS:
            asked[f"demand x {scale:g}"] = study.with_values({"demand.scale": scale * study.demand.scale})
    for label, each in asked.items():
        scores = {
            name: _score(each.with_values({"policy.name": name}), None, shortfall) for name in (*RULES, "mpc")
        }
        scores["distilled"] = _score(each, DistilledPolicy(controller), shortfall)
        yield Evaluation(label, pd.DataFrame.from_dict(scores, "index", columns=["lost_kwh", "cost_kwh"]))


def _score(study: Study, policy: DistilledPolicy | None, shortfall: float) -> tuple[float, float]:
    kpis = run(study, policy=policy, progress=False).kpis
    return kpis["lost_kwh"], kpis["lost_kwh"] + (shortfall - 1.0) * kpis["undelivered_kwh"]


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
            f"# Evaluation: {study.name}",
            "",
            f"A controller of {tables.strings} strings ({controller.system}), steps of "
            f"{tables.step_h * 60:g} min, prediction horizon {tables.steps * tables.step_h:g} h. Energies in "
            "kWh over the run. Lost: undelivered energy plus losses of inverters and batteries. Cost: the "
            f"same, with undelivered energy counted {tables.shortfall:g} times. Kept: the share of the "
            "savings of `mpc` over the best rule; above 100 %, the distilled controller loses less than "
            "`mpc`. Of these runs, only the study itself was part of the training.",
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


MAX_STRINGS: Final = 16
REPORT: Final = "report.md"
FILES: Final = {"policy.json", "split.c", "split.h", "split.st", "study.toml", REPORT}


def distil(
    study: Study | str | Path, *, generations: int = GENERATIONS, progress: bool = True
) -> ExplicitController:
    """Find the weights of an explicit controller for the plant and the demand of a study.

    The search runs closed loops over the study, and over variations of its demand and initial states, with
    many controllers in parallel; see :mod:`bess.edge.distil.training`. Results repeat to the last bit.

    Parameters
    ----------
    study
        One run, as a study, the name of a bundled one or a TOML file.
    generations
        Effort: generations of the search.
    progress
        Show progress on standard error.

    Raises
    ------
    InputError
        The study or its data are invalid, the study has several runs, or the plant has too many strings.
    """
    study = as_study(study)
    if study.scenario or study.sweep:
        raise InputError(f"{study.name}: is a study of several runs; use bess.edge.distil.distil_runs")
    generations = whole_number("generations", generations, 0)
    refuse_reactive(
        "an explicit controller", "run the study with mpc or a rule", requested=study.reactive is not None
    )
    case = TrainingCase.of(study)
    strings = case.system.n_strings
    if strings > MAX_STRINGS:
        raise InputError(
            f"{study.name}: has {strings} strings; an explicit controller is made for {MAX_STRINGS} at most"
        )
    given = study.policy.objectives.shortfall
    shortfall = SHORTFALL if given is None else given
    tables = Tables.of(case.system, case.ahead_kw.shape[1], case.dt_h, shortfall)

    def controller(weights: Array) -> ExplicitController:
        return ExplicitController(
            study=study.name, system=case.system.name, weights=tuple(weights.tolist()), tables=tables
        )

    training = TrainingSet(case, controller(first_weights()))
    with reporting(f"{study.name}: generations", generations, shown=progress) as update:
        weights = fit(training, generations, update)
    return controller(weights)


def distil_runs(
    study: Study | str | Path, out: str | Path, *, generations: int = GENERATIONS, progress: bool = True
) -> list[Path]:
    """Distil a study into a folder; each run of several gets a sub-folder.

    Each folder holds ``policy.json`` (for ``policy.file``), ``split.c``, ``split.h``, ``split.st``, the
    resolved study, and ``report.md`` with the undelivered energy and losses of every rule, ``mpc`` and the
    controller.

    Returns
    -------
    list of Path
        The folders.

    Raises
    ------
    InputError
        As :func:`distil`, or ``out`` contains other files.
    """
    study = as_study(study)
    runs = expand(study)
    folder = path_of(out, "folder")
    several = bool(study.scenario or study.sweep)
    folders = {name: folder_in(folder, name) if several else folder for name in runs}
    for inside in folders.values():
        if others := sorted(make_folder(inside) - FILES):
            raise InputError(
                f"{inside}: holds {others[0]!r}, which is none of distil's files; use a new or empty folder"
            )
    for name, each in runs.items():
        controller = distil(each, generations=generations, progress=progress)
        texts = {**exports(controller), "study.toml": each.to_toml()}
        texts[REPORT] = report(each, controller, list(trials(each, controller)))
        for file, text in texts.items():
            write_bytes(folders[name] / file, text.encode(), REPEAT)
    return list(folders.values())
