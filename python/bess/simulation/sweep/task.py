"""Simulation of one scenario of a sweep by a worker."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from bess.errors import BessError, command_line
from bess.simulation.record.result import RESULTS
from bess.study.study import Study


@dataclass(frozen=True)
class Outcome:
    """Outcome of a scenario.

    Attributes
    ----------
    status : str
        ``done`` (also by an earlier sweep) or ``failed``.
    error : str
        One sentence, if the scenario failed.
    kpis : dict
        KPIs, if the scenario is done.
    skipped : bool
        Whether an earlier sweep had finished the scenario.
    """

    status: Literal["done", "failed"]
    error: str = ""
    kpis: dict[str, float] = field(default_factory=dict)
    skipped: bool = False


def run_scenario(study: Study, directory: Path, *, flags: bool = False) -> Outcome:
    """Start or continue a scenario in its folder, or skip a finished one.

    It raises no exception, so that the failure of one scenario does not end the others. ``flags`` selects
    messages for the command line.
    """
    try:
        from bess.simulation.runner import run

        skipped = (directory / RESULTS).exists()
        with command_line(flags):
            result = run(study, out=directory, resume=True, progress=False)
        result.dataset.close()
        return Outcome("done", kpis=result.kpis, skipped=skipped)
    except BessError as error:
        return Outcome("failed", str(error))
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return Outcome(
            "failed", f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        )
