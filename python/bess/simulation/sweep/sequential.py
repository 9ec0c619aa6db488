"""Sequential simulation of a study of several runs; ``bess sweep`` simulates them in parallel."""

from __future__ import annotations

import json
from pathlib import Path

from bess.errors import InputError, option
from bess.simulation.record.atomic import folder_in, write_bytes
from bess.simulation.record.provenance import IDENTITY
from bess.simulation.record.result import Result
from bess.simulation.runner import run
from bess.simulation.sweep.table import swept_keys, write_table
from bess.simulation.sweep.task import Outcome
from bess.study.scenarios import expand, refined
from bess.study.study import Study, as_study


def run_scenarios(
    study: Study | str | Path, *, progress: bool = True, out: str | Path | None = None, resume: bool = False
) -> dict[str, Result]:
    """Simulate every scenario and sweep point of a study; parameters as for :func:`bess.run`.

    Returns
    -------
    dict of str to Result
        Results by run name, which is also the folder in ``out``. Finished runs are opened, not repeated.
    """
    study = as_study(study)
    runs = expand(study)
    folder = None if out is None else Path(out)
    if folder is not None:
        for name in runs:
            folder_in(folder, name)
        prepare_folder(folder, study)
    results: dict[str, Result] = {}
    for further in range(1 + study.refinements):
        if further:
            runs |= refined(study, runs, {name: result.kpis for name, result in results.items()})
        for name, each in runs.items():
            if name not in results:
                place = None if folder is None else folder_in(folder, name)
                results[name] = run(each, progress=progress, out=place, resume=resume)
    if folder is not None:
        write_summary(folder, {name: result.kpis for name, result in results.items()})
        if study.sweep:
            done = {name: Outcome("done", kpis=result.kpis) for name, result in results.items()}
            write_table(folder, swept_keys(study), runs, done)
    return results


def prepare_folder(folder: Path, study: Study) -> None:
    """Create the folder with one sub-folder for each run, and save the resolved study.

    Raises
    ------
    InputError
        The folder contains a single run, or cannot be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{folder}: is not a results folder ({reason}); use another {option('out')}"
        ) from error
    if (folder / IDENTITY).exists():
        raise InputError(f"{folder}: holds a single run; use another {option('out')}")
    write_bytes(folder / "study.toml", study.to_toml().encode())


def write_summary(folder: Path, kpis: dict[str, dict[str, float]]) -> None:
    """Write ``kpis.json`` of a folder of runs: KPIs by run name."""
    write_bytes(folder / "kpis.json", json.dumps(kpis, indent=1).encode())
