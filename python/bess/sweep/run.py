"""All scenarios of a study, side by side."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bess.display import as_table, one_line
from bess.errors import StoppedEarly, on_command_line
from bess.extras import extra
from bess.record.atomic import folder_in
from bess.simulation import prepare_folder, write_summary
from bess.simulation.progress import progress_bar
from bess.study.scenarios import expand
from bess.study.study import Study, as_study
from bess.sweep.cluster import workers_for
from bess.sweep.table import SWEEP_CSV, swept_keys, write_table
from bess.sweep.task import Outcome, run_scenario

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client

_RETRIES = 3


@dataclass(frozen=True)
class SweepResult:
    """Outcome of :func:`bess.run_sweep`.

    Attributes
    ----------
    directory : Path
        Where ``sweep.csv``, ``sweep.parquet`` and one folder for each scenario are.
    outcomes : dict
        What became of each scenario, by name.
    """

    directory: Path
    outcomes: Mapping[str, Outcome]

    def _facts(self) -> dict[str, str]:
        return {
            "folder": str(self.directory),
            "runs": str(len(self.outcomes)),
            "failed": str(len(self.failed)),
        }

    __repr__ = one_line

    def _repr_html_(self) -> str:
        return as_table(self) + str(self.table().to_html(index=False, max_rows=12))

    @property
    def failed(self) -> dict[str, str]:
        """Errors of the scenarios that failed, by name."""
        return {name: outcome.error for name, outcome in self.outcomes.items() if outcome.status == "failed"}

    @property
    def skipped(self) -> list[str]:
        """Scenarios that an earlier sweep had done."""
        return [name for name, outcome in self.outcomes.items() if outcome.skipped]

    def table(self) -> pd.DataFrame:
        """Parameters and KPIs, one row for each scenario."""
        import pandas as pd

        return pd.read_csv(self.directory / SWEEP_CSV, keep_default_na=False, na_values=[""])


def run_sweep(
    study: Study | str | Path,
    out: str | Path,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: bool = True,
) -> SweepResult:
    """Run every scenario and sweep point of a study on Dask.

    A scenario that fails is reported and the rest is finished. A worker that dies does not end the sweep: its
    scenario continues elsewhere from its last checkpoint. Calling again skips what is done and continues
    what is not. From a script, call it under ``if __name__ == "__main__":``, since workers are processes
    that import it.

    Parameters
    ----------
    study
        Study, bundled name, or TOML file; its ``[[scenario]]`` and ``[[sweep]]`` tables are expanded.
    out
        Folder of the sweep, one sub-folder for each scenario. Workers of another machine need to see it.
    workers
        Processes of a local cluster; one for each core if omitted.
    scheduler
        Address of an existing Dask scheduler, instead of a local cluster.
    progress
        Show one progress bar over all scenarios.

    Raises
    ------
    InputError
        For a bad study, before anything runs.
    StoppedEarly
        If interrupted; what is done is saved, and the same call continues.
    """
    with extra("sweep", "a sweep"):
        import distributed  # noqa: F401 - before a folder is made
        import pyarrow  # noqa: F401
    study = as_study(study)
    studies = expand(study)
    directory = Path(out).absolute()
    folders = {name: folder_in(directory, name) for name in studies}
    prepare_folder(directory, study)
    keys = swept_keys(study)
    outcomes: dict[str, Outcome] = {}
    try:
        with workers_for(workers, scheduler) as client, _bar(len(studies), progress) as advance:
            for name, outcome in _outcomes(client, studies, folders):
                outcomes[name] = outcome
                advance(name, outcome)
    except KeyboardInterrupt:
        raise StoppedEarly(
            f"{directory}: stopped with {len(outcomes)} of {len(studies)} scenarios finished; "
            "run the same sweep again to continue"
        ) from None
    finally:
        write_table(directory, keys, studies, outcomes)
        done = {name: outcomes[name].kpis for name in studies if name in outcomes and outcomes[name].kpis}
        write_summary(directory, done)
    return SweepResult(directory, {name: outcomes[name] for name in studies})


def _outcomes(
    client: Client, studies: Mapping[str, Study], folders: Mapping[str, Path]
) -> Iterator[tuple[str, Outcome]]:
    from distributed import as_completed

    futures = {
        client.submit(
            run_scenario, study, folders[name], flags=on_command_line(), pure=False, retries=_RETRIES
        ): name
        for name, study in studies.items()
    }
    try:
        for future in as_completed(list(futures)):
            error = future.exception()
            # Tasks raise nothing; what arrives here is Dask's own: a worker that died again and again.
            outcome = future.result() if error is None else Outcome("failed", str(error))
            yield futures[future], outcome
    finally:
        client.cancel(list(futures))


@contextmanager
def _bar(total: int, visible: bool) -> Iterator[Any]:
    said: set[str] = set()
    with progress_bar("scenarios", total, shown=visible) as (bar, task):

        def advance(name: str, outcome: Outcome) -> None:
            bar.advance(task)
            if outcome.status == "failed" and outcome.error not in said:
                said.add(outcome.error)
                bar.console.print(f"{name} failed: {outcome.error}", markup=False, soft_wrap=True)

        yield advance
