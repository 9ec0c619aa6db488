"""``bess.run``: a study in closed loop, saved in parts."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from bess.control.policies import Policy, as_policy, build_policy
from bess.control.policies.adapters import Function
from bess.errors import BessError, InputError, StoppedEarly
from bess.files import path_of
from bess.plant import Plant
from bess.simulation.analysis.kpis import kpis
from bess.simulation.closed_loop import ClosedLoop
from bess.simulation.inputs import Inputs, prepare
from bess.simulation.progress import reporting, stop_requests
from bess.simulation.record import files, provenance, store
from bess.simulation.record.dataset import FLOWS, dataset_of, describe_frame, write_netcdf
from bess.simulation.record.result import RESULTS, Result, open_netcdf
from bess.study.plant_choice import policy_settings
from bess.study.study import Study, as_study
from bess.system import System

if TYPE_CHECKING:
    import xarray as xr

T = TypeVar("T")

MAX_PART_STEPS = 960
"""Maximum number of steps of a part, which is held in memory."""
MAX_PART_S = 5.0
"""Maximum time between saves [s]: the computing time that a crash can cost."""


def run(
    study: Study | str | Path,
    *,
    policy: Policy | Function | None = None,
    system: System | None = None,
    progress: bool = True,
    out: str | Path | None = None,
    resume: bool = False,
) -> Result:
    """Simulate a study in closed loop with the plant.

    Parameters
    ----------
    study
        A study of one run, the name of a bundled study, or a TOML file. For a study of several runs see
        :func:`bess.run_scenarios`.
    policy
        Replaces the policy of the study: an object of the protocol :class:`bess.control.policies.Policy`, or
        a function from a :class:`bess.control.policies.PolicyInput` to set-points. The record contains the
        name of its class or function.
    system
        Replaces the system of the study; the initial values and parameters of the study still apply.
    progress
        Show progress on standard error.
    out
        Folder for the results; without it they are kept in memory only. If the folder contains this run,
        finished, it is opened without a new simulation.
    resume
        Continue an unfinished run in ``out``. The result is equal to that of an uninterrupted run, to the
        last bit.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        The study or its data are invalid, ``out`` holds something else, or the inputs have changed on resume.
    StoppedEarly
        Ctrl-C or SIGTERM; all completed steps are saved if ``out`` is given.
    BessError
        The run failed, for example because the disk is full; saved steps are intact.
    """
    study = as_study(study)
    if study.scenario or study.sweep:
        raise InputError(f"{study.name}: is a study of several runs; use bess.run_scenarios")
    own = None
    if policy is not None:
        name, own = as_policy(policy)
        study = study.with_values({"policy.name": name})
    if resume and out is None:
        raise InputError("resume: name the folder of the run with out")
    loop = closed_loop(study, prepare(study, system), own)  # raises before a folder is created
    if out is not None:
        return _run_in(path_of(out, "folder"), study, loop, progress=progress, resume=resume)
    # Parts go to a scratch folder, so that one of them is in memory at a time.
    with tempfile.TemporaryDirectory(prefix="bess-") as scratch:
        folder, frame = Path(scratch), _frame(study, loop)
        try:
            dataset = _simulated(
                folder, study, loop, lambda: dataset_of(frame, store.records(folder)), progress=progress
            )
        except StoppedEarly:
            raise StoppedEarly(f"{study.name}: stopped; results not saved: no output folder (out)") from None
        return _result(dataset, folder, None, loop.inputs.system)


def _run_in(directory: Path, study: Study, loop: ClosedLoop, *, progress: bool, resume: bool) -> Result:
    inputs = loop.inputs
    identity = provenance.identity_of(study, inputs.system, inputs.files)
    identity["frame"] = _frame(study, loop)
    _refuse_foreign(directory, files.make_folder(directory))  # before the lock, which is a file
    with store.locked(directory):
        if not _is_finished(directory, identity, resume=resume):
            _simulated(directory, study, loop, lambda: _assemble(directory, identity), progress=progress)
        return _finish(directory, inputs.system)


def _frame(study: Study, loop: ClosedLoop) -> dict[str, Any]:
    return describe_frame(study, loop.inputs.system, loop.inputs.grid, loop.policy.statuses)


def _simulated(
    directory: Path, study: Study, loop: ClosedLoop, record: Callable[[], T], *, progress: bool
) -> T:
    """Simulate to the end and make the ``record``; notes and where the time went go to standard error."""
    if progress:
        for note in loop.inputs.notes:
            print(f"{study.name}: {note}", file=sys.stderr)
    began = time.perf_counter()
    files_s = _complete(directory, study, loop, progress=progress)
    simulated = time.perf_counter()
    made = record()
    ended = time.perf_counter()
    if progress:
        files_s += ended - simulated
        other_s = ended - began - loop.policy_s - loop.plant_s - files_s
        print(
            f"{study.name}: {ended - began:.1f} s, of which policy {loop.policy_s:.1f} s, plant "
            f"{loop.plant_s:.1f} s, files {files_s:.1f} s, demand and closed loop {other_s:.1f} s",
            file=sys.stderr,
        )
    return made


def _refuse_foreign(directory: Path, names: set[str]) -> None:
    """Raise InputError for a folder with files, but without a run."""
    own = {store.LOCK, store.OWNER, provenance.IDENTITY + files.TEMPORARY}
    if provenance.IDENTITY not in names and (others := sorted(names - own)):
        raise InputError(f"{directory}: holds {others[0]!r} but no run; use a new or empty folder")


def _is_finished(directory: Path, identity: provenance.Identity, *, resume: bool) -> bool:
    """Check the content of the folder; write the provenance of a new run into an empty folder."""
    old = provenance.read_identity(directory)
    if old is None:
        files.write_bytes(directory / provenance.IDENTITY, json.dumps(identity, indent=1).encode())
        return False
    if changed := provenance.differences(old, identity):
        shown = "; ".join(changed[:5]) + (f"; and {len(changed) - 5} more" if len(changed) > 5 else "")
        raise InputError(
            f"{directory}: holds another run ({shown}); use another output folder, or delete the folder"
        )
    finished = (directory / RESULTS).exists()
    if not finished and not resume:
        raise InputError(
            f"{directory}: holds this run, unfinished; continue with resume, or delete the folder"
        )
    return finished


def closed_loop(study: Study, inputs: Inputs, own: Policy | None = None) -> ClosedLoop:
    """Build the policy (``own``, or that of the study) and the plant at the first step."""
    policy = own or build_policy(study.policy.name, inputs.system, policy_settings(study, inputs.system))
    plant = Plant(inputs.system, inputs.system.initial_state(), derating_law=study.run.derating_law)
    return ClosedLoop(
        inputs, policy, plant, node_temperatures=study.output.node_temperatures, policy_name=study.policy.name
    )


def _complete(directory: Path, study: Study, loop: ClosedLoop, *, progress: bool) -> float:
    """Simulate from the last checkpoint, or the first step, to the end; return the time for files [s]."""
    files.write_bytes(directory / "study.toml", study.to_toml().encode())
    log_bytes = 0
    if saved := store.parts(directory):
        checkpoint = store.read_checkpoint(saved[-1])
        loop.restore(checkpoint["loop"])
        log_bytes = checkpoint["log_bytes"]
    # Lines of steps that were not saved are written again.
    store.append_log(directory, log_bytes, ())
    n_steps = loop.inputs.grid.n_steps
    files_s = 0.0
    with reporting(study.name, n_steps, shown=progress) as update, stop_requests() as stop_asked:
        while loop.step < n_steps and not stop_asked():
            first, deadline = loop.step, time.monotonic() + MAX_PART_S

            def is_over(step: int, deadline: float = deadline) -> bool:
                update(step)
                return stop_asked() or time.monotonic() > deadline

            record, lines = loop.advance_part(MAX_PART_STEPS, is_over)
            began = time.perf_counter()
            _check_finite(first, record)
            # The log first, so that it is never shorter than the length in the checkpoint.
            log_bytes = store.append_log(directory, log_bytes, lines)
            store.write_part(directory, first, record, {"loop": loop.checkpoint(), "log_bytes": log_bytes})
            files_s += time.perf_counter() - began
        if loop.step < n_steps:
            raise StoppedEarly(
                f"{study.name}: stopped after step {loop.step} of {n_steps}; all is saved in {directory}; "
                f"continue with resume"
            )
    return files_s


def _check_finite(first_step: int, record: store.Record) -> None:
    """Raise BessError if the plant returned non-finite numbers; steps are along the first axis."""
    for name in FLOWS:
        finite = np.isfinite(record[name].reshape(len(record[name]), -1)).all(axis=1)
        if not finite.all():
            step = int(np.argmin(finite))
            raise BessError(
                f"step {first_step + step}: the plant returned {name} = {record[name][step]}; "
                "please report this"
            )


def _assemble(directory: Path, identity: provenance.Identity) -> None:
    path = directory / RESULTS
    with files.clear_errors(path), files.replacing(path) as temporary:
        write_netcdf(temporary, identity["frame"], store.records(directory))
        kept = (provenance.IDENTITY, "study.toml", store.LOG)
        final = {name: directory / name for name in kept} | {RESULTS: temporary}
        files.write_checksums(directory, {name: files.sha256(path) for name, path in final.items()})


def _finish(directory: Path, system: System) -> Result:
    """Compute the KPIs from the record, then delete the parts; repeated after a crash in between."""
    result = _result(open_netcdf(directory / RESULTS), directory, directory, system)
    files.write_checked(directory / "kpis.json", json.dumps(result.kpis, indent=1).encode())
    store.remove_parts(directory)
    return result


def _result(dataset: xr.Dataset, logged: Path, directory: Path | None, system: System) -> Result:
    """Result of a record in ``directory``, with the times of the log in the folder ``logged``."""
    times = np.array(list(store.solve_times_s(logged).values()), dtype=np.float64)
    result = Result(dataset, {}, directory, times, system)
    return replace(result, kpis=kpis(result))
