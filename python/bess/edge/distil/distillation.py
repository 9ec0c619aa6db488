"""``bess distil``: from a study to a folder with a controller."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bess.control.explicit import ExplicitController, Tables
from bess.control.policies.reactive import refuse_reactive
from bess.control.split.objectives import SHORTFALL
from bess.edge.distil.evaluation import report, trials
from bess.edge.distil.exports import exports
from bess.edge.distil.search import GENERATIONS, first_weights, fit
from bess.edge.distil.training import TrainingCase, TrainingSet
from bess.errors import InputError, option
from bess.simulation.progress import reporting
from bess.simulation.record.atomic import folder_in, write_bytes
from bess.study import Study, expand
from bess.study.study import as_study

MOST_STRINGS: Final = 16
REPORT: Final = "report.md"


def distil(
    study: Study | str | Path, *, generations: int = GENERATIONS, progress: bool = True
) -> ExplicitController:
    """Find the weights of an explicit controller for the plant and the demand of a study.

    Closed loops over the study, and over variations of its demand and of the states at its start, are run
    with many controllers side by side; see :mod:`bess.edge.distil.search`. Results repeat to the last bit.

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
        From the study or its data; the study is one of several runs; more strings than a decision is made
        for.
    """
    study = as_study(study)
    if study.scenario or study.sweep:
        raise InputError(f"{study.name}: is a study of several runs; use bess.edge.distil.distil_runs")
    if generations < 0:
        raise InputError(f"generations = {generations}: must be >= 0")
    refuse_reactive(
        "an explicit controller", "run the study with mpc or a rule", asked=study.reactive is not None
    )
    course = TrainingCase.of(study)
    strings = course.system.n_strings
    if strings > MOST_STRINGS:
        raise InputError(
            f"{study.name}: has {strings} strings; an explicit controller is made for {MOST_STRINGS} at most"
        )
    given = study.policy.objectives.shortfall
    shortfall = SHORTFALL if given is None else given
    tables = Tables.of(course.system, course.ahead_kw.shape[1], course.dt_h, shortfall)

    def controller(weights: NDArray[np.float64]) -> ExplicitController:
        return ExplicitController(
            study=study.name, system=course.system.name, weights=tuple(weights.tolist()), tables=tables
        )

    lessons = TrainingSet(course, controller(first_weights()))
    with reporting(f"{study.name}: generations", generations, shown=progress) as update:
        weights, _ = fit(lessons, generations, update)
    return controller(weights)


def distil_runs(
    study: Study | str | Path, out: str | Path, *, generations: int = GENERATIONS, progress: bool = True
) -> list[Path]:
    """Distil a study into a folder; one of several runs into a sub-folder for each.

    Each folder holds ``policy.json`` (for ``policy.file``), ``split.c``, ``split.h``, ``split.st``, the study
    as resolved, and ``report.md``: what every rule, ``mpc`` and the controller lose.

    Returns
    -------
    list of Path
        The folders.

    Raises
    ------
    InputError
        As :func:`distil`; ``out`` holds something else.
    """
    study = as_study(study)
    runs = expand(study)
    folder = Path(out)
    several = bool(study.scenario or study.sweep)
    folders = {name: folder_in(folder, name) if several else folder for name in runs}
    for inside in folders.values():
        _prepare(inside)
    for name, each in runs.items():
        controller = distil(each, generations=generations, progress=progress)
        texts = {**exports(controller), "study.toml": each.to_toml()}
        texts[REPORT] = report(each, controller, list(trials(each, controller)))
        for file, text in texts.items():
            write_bytes(folders[name] / file, text.encode())
    return list(folders.values())


def _prepare(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        present = {path.name for path in folder.iterdir()}
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{folder}: is not a results folder ({reason}); use another {option('out')}"
        ) from error
    if others := sorted(present - {"policy.json", "split.c", "split.h", "split.st", "study.toml", REPORT}):
        raise InputError(
            f"{folder}: holds {others[0]!r}, which is none of distil's files; use a new or empty folder for "
            f"{option('out')}"
        )
