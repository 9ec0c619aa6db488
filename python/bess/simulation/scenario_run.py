"""A study of several runs, one after the other, a sub-folder each. ``bess sweep`` runs them in parallel."""

from __future__ import annotations

import json
from pathlib import Path

from bess.errors import InputError, option
from bess.record.atomic import folder_in, write_bytes
from bess.record.identity import IDENTITY
from bess.record.result import Result
from bess.simulation.runner import run
from bess.study.scenarios import expand
from bess.study.study import Study, as_study


def run_scenarios(
    study: Study | str | Path, *, progress: bool = True, out: str | Path | None = None, resume: bool = False
) -> dict[str, Result]:
    """Run every scenario and sweep point of a study; parameters as for :func:`bess.run`.

    Returns
    -------
    dict of str to Result
        By the name of the run, which is also its folder in ``out``. Finished ones are opened, not run again.
    """
    study = as_study(study)
    runs = expand(study)
    if out is None:
        return {name: run(each, progress=progress) for name, each in runs.items()}
    folder = Path(out)
    folders = {name: folder_in(folder, name) for name in runs}
    prepare_folder(folder, study)
    results = {
        name: run(each, progress=progress, out=folders[name], resume=resume) for name, each in runs.items()
    }
    write_summary(folder, {name: result.kpis for name, result in results.items()})
    return results


def prepare_folder(folder: Path, study: Study) -> None:
    """Make the folder that holds one sub-folder for each run, with the study as resolved.

    Raises
    ------
    InputError
        The folder holds a single run, or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # a NUL in the path is a ValueError
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"{folder}: is no folder for results ({reason}); use another {option('out')}"
        ) from error
    if (folder / IDENTITY).exists():
        raise InputError(f"{folder}: holds a single run; use another {option('out')}")
    write_bytes(folder / "study.toml", study.to_toml().encode())


def write_summary(folder: Path, kpis: dict[str, dict[str, float]]) -> None:
    """Write ``kpis.json`` of a folder of runs: the key figures by name."""
    write_bytes(folder / "kpis.json", json.dumps(kpis, indent=1).encode())
