"""One scenario of a sweep, as a worker runs it."""

from __future__ import annotations

import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from bess.errors import BessError, command_line
from bess.record.result import RESULTS
from bess.study.study import Study


@dataclass(frozen=True)
class Outcome:
    """What became of a scenario.

    Attributes
    ----------
    status : str
        ``done`` (also if it was so before) or ``failed``.
    error : str
        One sentence, if it failed.
    kpis : dict
        If it is done.
    skipped : bool
        Whether an earlier sweep had done it.
    """

    status: Literal["done", "failed"]
    error: str = ""
    kpis: dict[str, float] = field(default_factory=dict)
    skipped: bool = False


def run_scenario(study: Study, directory: Path, *, flags: bool = False) -> Outcome:
    """Run a scenario in its folder, continue it, or find it done.

    Nothing is raised: what is wrong with one scenario must not end the others. ``flags`` says whether
    messages go to the command line.
    """
    try:
        from bess.simulation import run

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
