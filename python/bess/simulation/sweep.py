"""Studies of several runs: scenario sets and Pareto sweeps, one after another or in parallel on Dask."""

from __future__ import annotations

import io
import json
import logging
import multiprocessing
import os
import signal
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from bess.arrays import whole_number
from bess.display import as_table, one_line
from bess.errors import BessError, InputError, StoppedEarly, placed
from bess.files import path_of
from bess.optional_dependencies import extra
from bess.simulation.progress import progress_bar
from bess.simulation.record.files import folder_in, make_folder, write_bytes
from bess.simulation.record.provenance import IDENTITY
from bess.simulation.record.result import RESULTS, Result
from bess.simulation.runner import run
from bess.study.keys import value_at
from bess.study.scenarios import expand, refined
from bess.study.study import Study, as_study

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client


@dataclass(frozen=True)
class Outcome:
    """Outcome of a scenario."""

    status: Literal["done", "failed", "open"]
    """``done`` (also by an earlier sweep), ``failed``, or ``open`` in the table of an interrupted sweep."""
    error: str = ""
    """One sentence, if the scenario failed."""
    kpis: dict[str, float] = field(default_factory=dict)
    """KPIs, if the scenario is done."""
    skipped: bool = False
    """Whether an earlier sweep had finished the scenario."""


def run_scenario(study: Study, directory: Path) -> Outcome:
    """Start or continue a scenario in its folder, or skip a finished one.

    It raises no exception, so that the failure of one scenario does not end the others.
    """
    try:
        skipped = (directory / RESULTS).exists()
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


SWEEP_CSV: Final = "sweep.csv"
SWEEP_PARQUET: Final = "sweep.parquet"
RESERVED: Final = ("name", "status", "error")
"""Columns that are neither parameters (dotted keys of the study) nor KPIs (without a dot)."""


def is_parameter(column: str) -> bool:
    """Whether a column holds a swept key of the study."""
    return "." in column


def swept_keys(study: Study) -> list[str]:
    """Return the dotted keys that differ between the scenarios of a study, in file order."""
    keys: dict[str, None] = {}
    for scenario in study.scenario:
        keys |= dict.fromkeys(scenario.set)
    for axis in study.sweep:
        keys |= dict.fromkeys(axis.simplex or ([axis.key] if axis.key else []))
    return [key for key in keys if is_parameter(key)]


def write_table(
    directory: Path, study: Study, studies: Mapping[str, Study], outcomes: Mapping[str, Outcome]
) -> None:
    """Write ``sweep.csv`` and, with pyarrow, ``sweep.parquet``; scenarios without an outcome are ``open``.

    The table has a column for each swept key of ``study``. Priorities and tolerances of an objective get
    columns of their own if they differ between scenarios.
    """
    import pandas as pd

    keys = swept_keys(study)
    documents = [each.document() for each in studies.values()]
    columns = [dict(_columns(document, keys)) for document in documents]
    constant = {key for key in columns[0] if key not in keys and len({row.get(key) for row in columns}) == 1}
    rows = []
    for name, parameters in zip(studies, columns, strict=True):
        outcome = outcomes.get(name, Outcome("open"))
        varied = {key: value for key, value in parameters.items() if key not in constant}
        rows.append(
            {"name": name, "status": outcome.status, "error": outcome.error, **varied, **outcome.kpis}
        )
    frame = pd.DataFrame(rows)
    write_bytes(directory / SWEEP_CSV, frame.to_csv(index=False).encode())
    buffer = io.BytesIO()
    with suppress(ImportError):
        frame.to_parquet(buffer, index=False)
        write_bytes(directory / SWEEP_PARQUET, buffer.getvalue())


def _columns(document: Mapping[str, Any], keys: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """Return swept values by key of the study, as in study files: lists as text, objectives as weights, with
    the other values of an objective in separate columns."""
    for key in keys:
        value = value_at(document, key)
        if isinstance(value, Mapping) and "weight" in value:
            yield key, value["weight"]
            yield from ((f"{key}.{name}", other) for name, other in value.items() if name != "weight")
        else:
            shown = list(value) if isinstance(value, tuple) else value
            yield key, shown if isinstance(shown, int | float | str | None) else str(shown)


_CONNECT_TIMEOUT_S = 20
# Scenarios run in parallel, so threads inside a worker would compete with other workers.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_UNGUARDED = "workers import the script that sweeps: call run_sweep under if __name__ == '__main__' there"


@contextmanager
def workers_for(workers: int | None, scheduler: str | None) -> Iterator[Client]:
    """Yield a Dask client; a cluster started here is stopped at the end."""
    from distributed import Client, LocalCluster

    if workers is not None and scheduler is not None:
        raise InputError("give either --workers or --scheduler: an existing scheduler has its own workers")
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=_CONNECT_TIMEOUT_S)
        except (OSError, ValueError, TypeError) as error:
            raise BessError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from error
        with client:
            yield client
        return
    if workers is not None:
        workers = whole_number("workers", workers, 1)
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise BessError(_UNGUARDED)
    try:
        with _interrupts_blocked():
            cluster = LocalCluster(
                n_workers=os.cpu_count() if workers is None else workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0",
                env=_ONE_THREAD,
                # Failures are outcomes of scenarios. Other messages of Dask concern workers that are stopped
                # while busy; their runs are saved.
                silence_logs=logging.CRITICAL,
            )
    except RuntimeError as error:
        raise BessError(f"the workers of the sweep did not start ({error}); {_UNGUARDED}") from None
    with cluster, Client(cluster) as client:
        yield client


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in threads and processes started meanwhile; this process stops them itself."""
    if sys.platform == "win32":
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
    folder = None if out is None else path_of(out, "folder")
    studies = expand(study) if folder is None else prepare_folder(folder, study)
    results: dict[str, Result] = {}
    for left in _rounds(study, studies, results):
        for name, each in left.items():
            place = None if folder is None else folder_in(folder, name)
            with placed(name):
                results[name] = run(each, progress=progress, out=place, resume=resume)
    if folder is not None:
        write_summary(folder, {name: result.kpis for name, result in results.items()})
        if study.sweep:
            done = {name: Outcome("done", kpis=result.kpis) for name, result in results.items()}
            write_table(folder, study, studies, done)
    return results


def _rounds(
    study: Study, studies: dict[str, Study], done: Mapping[str, Result | Outcome]
) -> Iterator[dict[str, Study]]:
    """Yield the runs of a study, then the runs of each refinement, which are added to ``studies``."""
    refined(study, studies, {})  # refuses an invalid search before its runs
    yield studies
    for _ in range(study.refinements):
        new = refined(study, studies, {name: each.kpis for name, each in done.items() if each.kpis})
        studies |= new
        yield {name: each for name, each in new.items() if name not in done}


def prepare_folder(folder: Path, study: Study) -> dict[str, Study]:
    """Create the folder of a study of several runs and save the resolved study; return its runs by name.

    Raises
    ------
    InputError
        The folder contains a single run, cannot be created, or would not contain the sub-folder of each run.
    """
    studies = expand(study)
    for name in studies:
        folder_in(folder, name)
    make_folder(folder)
    if (folder / IDENTITY).exists():
        raise InputError(f"{folder}: holds a single run; use another output folder")
    write_bytes(folder / "study.toml", study.to_toml().encode())
    return studies


def write_summary(folder: Path, kpis: dict[str, dict[str, float]]) -> None:
    """Write ``kpis.json`` of a folder of runs: KPIs by run name."""
    write_bytes(folder / "kpis.json", json.dumps(kpis, indent=1).encode())


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
        runs, failed = len(self.outcomes), len(self.failed)
        return {"folder": str(self.directory), "runs": str(runs), "failed": str(failed)}

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
    directory = path_of(out, "folder").absolute()
    studies = prepare_folder(directory, study)
    outcomes: dict[str, Outcome] = {}
    errors: set[str] = set()
    try:
        max_runs = len(studies) + 2 * study.refinements
        with (
            workers_for(workers, scheduler) as client,
            progress_bar("scenarios", max_runs, shown=progress) as (bar, task),
        ):
            for left in _rounds(study, studies, outcomes):
                for name, outcome in _outcomes(client, left, directory):
                    outcomes[name] = outcome
                    bar.advance(task)
                    if outcome.status == "failed" and outcome.error not in errors:
                        errors.add(outcome.error)
                        text = f"{name} failed: {outcome.error}"
                        bar.console.print(text, markup=False, soft_wrap=True)
    except KeyboardInterrupt:
        raise StoppedEarly(
            f"{directory}: stopped with {len(outcomes)} of {len(studies)} scenarios finished; "
            "run the same sweep again to continue"
        ) from None
    finally:
        write_table(directory, study, studies, outcomes)
        done = {name: outcomes[name].kpis for name in studies if name in outcomes and outcomes[name].kpis}
        write_summary(directory, done)
    return SweepResult(directory, {name: outcomes[name] for name in studies})


def _outcomes(client: Client, studies: Mapping[str, Study], directory: Path) -> Iterator[tuple[str, Outcome]]:
    from distributed import as_completed

    futures = {
        client.submit(run_scenario, study, folder_in(directory, name), pure=False, retries=_RETRIES): name
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
