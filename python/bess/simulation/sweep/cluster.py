"""Workers for a sweep: a local cluster of processes, or an existing scheduler."""

from __future__ import annotations

import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bess.errors import BessError, InputError

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_TIMEOUT_S = 20
# Scenarios run in parallel, so threads inside a worker would compete with other workers.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@contextmanager
def workers_for(workers: int | None, scheduler: str | None) -> Iterator[Client]:
    """Yield a Dask client; a cluster started here is stopped at the end.

    Raises
    ------
    InputError
        If both are given, or ``workers`` is not positive.
    BessError
        If the scheduler does not answer.
    """
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
    count = workers if workers is not None else os.cpu_count() or 1
    if count < 1:
        raise InputError(f"--workers {count}: needs at least 1")
    with _interrupts_blocked():
        cluster = LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            env=_ONE_THREAD,
            # Failures are outcomes of scenarios. Other messages of Dask concern workers that are stopped
            # while busy; their runs are saved.
            silence_logs=logging.CRITICAL,
        )
    with cluster, Client(cluster) as client:
        yield client


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C in threads and processes started meanwhile; this process stops them itself."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
