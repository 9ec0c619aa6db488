"""``bess serve``: the process, its log and its socket."""

from __future__ import annotations

import errno
import json
import logging
import os
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from queue import Full, Queue
from types import FrameType
from typing import Final

import uvicorn

from bess.control.policies.reactive import refuse_reactive
from bess.edge.plant_io import connect
from bess.edge.plant_io.address import parse_address, socket_name
from bess.edge.plant_io.journal import Journal
from bess.edge.serve import LOG
from bess.edge.serve.app import build_app
from bess.edge.serve.control_loop import STEP_S, ControlLoop, Demands
from bess.edge.serve.gate import (
    BACKLOG,
    KEEP_ALIVE_S,
    Connection,
    Names,
    Rate,
    check_token,
    exposure,
    read_token,
)
from bess.edge.serve.service import Service
from bess.errors import BessError, InputError
from bess.simulation.record.store import locked
from bess.study import Study
from bess.study.plant_choice import build_system

MAX_SHUTDOWN_S: Final = 9.0
"""Maximum time from the signal to the end of the process, even if a plant or a disk does not respond."""
_NO_FOLDER: Final = (errno.ENOTDIR, errno.EEXIST, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP)
"""Errors that are not those of a full or a failed disk."""
_REFUSALS_PER_S: Final = 5.0
"""Maximum rate of log lines on refused requests, so that they cannot fill the disk; metrics count all."""
_MAX_LINES: Final = 10_000
"""Maximum number of queued log lines; further ones are lost."""
_LAST_LINES_S: Final = 1.0


def serve(
    study: Study,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    token_file: Path | None = None,
    state: Path | None = None,
    plant: str | None = None,
    shadow: bool = False,
    allowed_hosts: Sequence[str] = (),
    simulated: bool = False,
) -> None:
    """Listen until a signal ends the process; a simulated plant needs no token."""
    refuse_reactive("the service", "share it by another controller", requested=study.reactive is not None)
    token = None if token_file is None else read_token(token_file)
    check_token(host, token, drives=plant is not None and not shadow and not simulated)
    names = Names(host, allowed_hosts)
    if shadow and plant is None:
        raise InputError("--shadow: watches a plant; name one with --plant openems=URL or sunspec=HOST")
    address = "" if plant is None else str(parse_address(plant))
    _log_to_standard_error()
    if token_file is not None and (warning := exposure(token_file)):
        LOG.warning(warning)
    if plant is not None and study.service.control_step_s is None:
        study = study.with_values({"service.control_step_s": STEP_S})
    folder = state or Path("results") / f"{study.name}-service"
    with _held(folder), _listener(host, port) as listener:
        if plant is not None:  # before the service, which sets a state of another system aside
            system = build_system(study.system, study.run, study.wear)
            link = connect(plant, system.n_strings)
            demands = Demands(study, system.control.step_s)
            journal = Journal(folder, system, study.title or study.name, study.service.journal_mb)
        service = Service(study, folder)
        loop = None
        if plant is not None:
            loop = ControlLoop(service, link, demands, journal, address=address, shadow=shadow)
        config = uvicorn.Config(
            build_app(service, token, loop, names),
            http=Connection,
            ws="none",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            backlog=BACKLOG,
            timeout_keep_alive=KEEP_ALIVE_S,
            timeout_graceful_shutdown=2,
            limit_concurrency=1000,
        )
        server = _Server(config, loop)
        LOG.info(f"listens at http://{socket_name(host, port)}")
        # Signals are captured before the thread starts: an exception raised at any other place may be lost.
        # A handled signal is raised again at the end.
        with suppress(KeyboardInterrupt), server.capture_signals(), closing(service), ExitStack() as end:
            if loop is not None:
                thread = threading.Thread(target=loop.run, name="cycle", daemon=True)
                thread.start()
                end.callback(thread.join)
                end.callback(loop.stop)
            server.run(sockets=[listener])


class _Server(uvicorn.Server):
    """Stops the control loop on a signal, and ends the process after :data:`MAX_SHUTDOWN_S`."""

    def __init__(self, config: uvicorn.Config, loop: ControlLoop | None) -> None:
        super().__init__(config)
        self._control_loop = loop

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal, each further one as uvicorn does."""
        if not self.should_exit:
            if self._control_loop is not None:
                self._control_loop.stop()
            last = threading.Timer(MAX_SHUTDOWN_S, _end_process)
            last.daemon = True
            last.start()
        super().handle_exit(sig, frame)


def _end_process() -> None:
    """End the process although a thread still waits for a plant, a disk or a name server."""
    LOG.error(f"not stopped {MAX_SHUTDOWN_S:g} s after the signal; the set-points of the plant expire")
    logging.shutdown()
    os._exit(1)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Lock the state folder; the service starts without the lock if the disk is full or does not respond."""
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(folder))
        except InputError:
            raise
        except (BessError, OSError, ValueError) as error:
            cause = error.__cause__ if isinstance(error, BessError) else error
            if not isinstance(cause, OSError) or cause.errno in _NO_FOLDER:
                raise InputError(f"--state {folder}: is not a writable folder ({cause})") from error
            LOG.error(f"{folder}: cannot be locked ({cause.strerror}); continues without a lock")
        yield


def _listener(host: str, port: int) -> socket.socket:
    """A listening socket, opened before anything else starts."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"--host {host}: is not an address of this machine ({error})") from error
    both = family == socket.AF_INET6 and socket.has_dualstack_ipv6()
    try:
        return socket.create_server(address, family=family, backlog=2048, dualstack_ipv6=both)
    except OSError as error:
        why = os.strerror(error.errno or 0)
        raise InputError(
            f"--host {host} --port {port}: cannot be listened on ({why}); use another --port"
        ) from error


def _log_to_standard_error() -> None:
    handler = _StandardError()
    for name in ("bess.serve", "uvicorn.error"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(logging.INFO)
    rate = Rate(_REFUSALS_PER_S)
    for name in ("bess.serve.requests", "uvicorn.error"):
        logging.getLogger(name).addFilter(lambda record: record.levelno > logging.WARNING or rate.take())


class _StandardError(logging.Handler):
    """Writes one JSON object per line to standard error, from a separate thread."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: Queue[str | None] = Queue(_MAX_LINES)
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def format(self, record: logging.LogRecord) -> str:
        """Time, level, message, and the fields of the record."""
        time = datetime.fromtimestamp(record.created, tz=UTC).isoformat(timespec="milliseconds")
        line = {
            "time": time.replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "message": record.getMessage(),
        }
        line |= getattr(record, "fields", {})
        if record.exc_info:
            line["trace"] = logging.Formatter().formatException(record.exc_info)
        return json.dumps(line)

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a line; a full queue loses it."""
        with suppress(Full):
            self._lines.put_nowait(self.format(record))

    def close(self) -> None:
        """Write the remaining lines if they are read."""
        with suppress(Full):
            self._lines.put_nowait(None)
        self._thread.join(_LAST_LINES_S)
        super().close()

    def _run(self) -> None:
        while (line := self._lines.get()) is not None:
            with suppress(OSError):
                # Not sys.stderr: its lock, held by a thread that cannot write, would abort the exit.
                os.write(2, f"{line}\n".encode())
