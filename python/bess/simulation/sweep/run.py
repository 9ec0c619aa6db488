"""Parallel simulation of all scenarios of a study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bess.display import as_table, one_line
from bess.errors import StoppedEarly, on_command_line
from bess.optional_dependencies import extra
from bess.simulation.progress import progress_bar
from bess.simulation.record.atomic import folder_in
from bess.simulation.sweep.cluster import workers_for
from bess.simulation.sweep.sequential import prepare_folder, write_summary
from bess.simulation.sweep.table import SWEEP_CSV, swept_keys, write_table
from bess.simulation.sweep.task import Outcome, run_scenario
from bess.study.scenarios import expand, refined
from bess.study.study import Study, as_study

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
        Folder of ``sweep.csv``, ``sweep.parquet`` and one folder for each scenario.
    outcomes : dict
        Outcome of each scenario, by name.
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
        """Scenarios finished by an earlier sweep."""
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
    """Simulate every scenario and sweep point of a study with Dask.

    If a scenario fails, it is reported and the others continue. If a worker dies, its scenario continues on
    another worker from its last checkpoint. A second call skips finished scenarios and continues the others.
    In a script, call it under ``if __name__ == "__main__":``, because the worker processes import the script.

    Parameters
    ----------
    study
        Study, bundled name, or TOML file; its ``[[scenario]]`` and ``[[sweep]]`` tables are expanded.
    out
        Folder of the sweep, with one sub-folder for each scenario. Workers on other machines need access.
    workers
        Number of processes of a local cluster; one for each core if omitted.
    scheduler
        Address of an existing Dask scheduler, instead of a local cluster.
    progress
        Show one progress bar over all scenarios.

    Raises
    ------
    InputError
        The study is invalid; no scenario is started.
    StoppedEarly
        The sweep was interrupted. Completed steps are saved; call it again to continue.
    """
    with extra("sweep", "a sweep"):
        import distributed  # noqa: F401 - before a folder is made
        import pyarrow  # noqa: F401
    study = as_study(study)
    studies = expand(study)
    directory = Path(out).absolute()
    for name in studies:
        folder_in(directory, name)
    prepare_folder(directory, study)
    keys = swept_keys(study)
    outcomes: dict[str, Outcome] = {}
    try:
        most = len(studies) + 2 * study.refinements
        with workers_for(workers, scheduler) as client, _bar(most, progress) as advance:
            for further in range(1 + study.refinements):
                if further:
                    done = {name: each.kpis for name, each in outcomes.items() if each.kpis}
                    studies |= refined(study, studies, done)
                left = {name: each for name, each in studies.items() if name not in outcomes}
                for name, outcome in _outcomes(client, left, directory):
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


def _outcomes(client: Client, studies: Mapping[str, Study], directory: Path) -> Iterator[tuple[str, Outcome]]:
    from distributed import as_completed

    futures = {
        client.submit(
            run_scenario,
            study,
            folder_in(directory, name),
            flags=on_command_line(),
            pure=False,
            retries=_RETRIES,
        ): name
        for name, study in studies.items()
    }
    try:
        for future in as_completed(list(futures)):
            error = future.exception()
            # Tasks raise no exceptions; this one is from Dask: a worker died repeatedly.
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
