"""``bess serve``: from the command line to a listening process."""

from __future__ import annotations

import errno
import logging
import os
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Final

from bess.control.policies.reactive import refuse_reactive
from bess.edge.plant_io import connect
from bess.edge.plant_io.address import parse_address
from bess.edge.plant_io.journal import Journal
from bess.edge.serve.limits import Names, Rate, check_token, read_token
from bess.errors import BessError, InputError
from bess.optional_dependencies import extra
from bess.simulation.record.store import Lock
from bess.study import Study

ENDS_S: Final = 9.0
"""The process ends so long after it was told to, whatever a plant, a disk or a name server does."""
_NO_FOLDER: Final = (errno.ENOTDIR, errno.EEXIST, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP)
"""What a disk with room would say as well."""
_NOTED_PER_S: Final = 5.0
"""Lines in the log on requests that are refused; callers fill no disk, the metrics count all."""


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
    """Listen until the process is told to stop; a simulated plant may be driven without a token.

    Raises
    ------
    InputError
        From the study, the token, the address, or a library that is missing.
    """
    refuse_reactive("the service", "share it by another controller", asked=study.reactive is not None)
    token = None if token_file is None else read_token(token_file)
    check_token(host, token, drives=plant is not None and not shadow and not simulated)
    names = Names.of(host, allowed_hosts)
    if shadow and plant is None:
        raise InputError("--shadow: watches a plant; name one with --plant openems=URL or sunspec=HOST")
    address = None if plant is None else parse_address(plant)
    with extra("plant", "bess serve"):
        import fastapi  # noqa: F401
        import prometheus_client  # noqa: F401
        import uvicorn

    from bess.edge.serve.app import Driven, build_app
    from bess.edge.serve.connections import BACKLOG, KEEP_ALIVE_S, Connection
    from bess.edge.serve.control_loop import STEP_S, ControlLoop
    from bess.edge.serve.demands import Demands
    from bess.edge.serve.lines import Lines
    from bess.edge.serve.service import Service

    handler = Lines()
    for name in ("bess.serve", "uvicorn.error"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(logging.INFO)
    noted = Rate(_NOTED_PER_S)
    for name in ("bess.serve.requests", "uvicorn.error"):
        logging.getLogger(name).addFilter(lambda record: record.levelno > logging.WARNING or noted.take())
    if plant is not None and study.service.control_step_s is None:
        study = study.with_values({"service.control_step_s": STEP_S})
    folder = state or Path("results") / f"{study.name}-service"
    with _held(folder), _listening(host, port) as listener:
        service = Service(study, folder)
        log = logging.getLogger("bess.serve")
        for note in service.notes:
            log.info(note)
        driven, thread = None, None
        if plant is not None and address is not None:
            controller = service.controller
            link = connect(plant, controller.n_strings)
            demands = Demands(study, controller.plan.step_s)
            journal = Journal(folder, controller.system, study.title or study.name, study.service.journal_mb)
            cycle = ControlLoop(service, link, demands, journal, shadow=shadow)
            driven = Driven(f"{address.kind} at {address.url}", demands, cycle)
            thread = threading.Thread(target=cycle.run, name="cycle", daemon=True)
        try:
            # A signal that has been obeyed is raised again.
            with suppress(KeyboardInterrupt):
                if thread is not None:
                    thread.start()
                config = uvicorn.Config(
                    build_app(service, token, driven, names),
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
                server = uvicorn.Server(config)
                obey = server.handle_exit

                def told_to_end(number: int, frame: FrameType | None) -> None:
                    if driven is not None:
                        driven.cycle.stop()
                    last = threading.Timer(ENDS_S, _end)
                    last.daemon = True
                    last.start()
                    obey(number, frame)

                server.handle_exit = told_to_end  # type: ignore[method-assign, assignment]
                server.run(sockets=[listener])
        finally:
            if driven is not None and thread is not None and thread.is_alive():
                driven.cycle.stop()
                thread.join()
            service.close()


def _end() -> None:
    """End this process: what still runs waits for something outside."""
    logging.getLogger("bess.serve").error(
        f"not done {ENDS_S:g} s after the signal; what the plant was given lapses"
    )
    logging.shutdown()
    os._exit(1)


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    """Hold the folder of the state; a disk that takes nothing keeps no controller from starting.

    Raises
    ------
    InputError
        If it can be no such folder, or another process holds it.
    """
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            stack.enter_context(Lock(folder))
        except InputError:
            raise
        except (BessError, OSError, ValueError) as error:
            cause = error.__cause__ if isinstance(error, BessError) else error
            if not isinstance(cause, OSError) or cause.errno in _NO_FOLDER:
                raise InputError(
                    f"--state {folder}: is no folder that can be written to ({cause})"
                ) from error
            logging.getLogger("bess.serve").error(
                f"{folder}: cannot be held ({cause.strerror}); goes on without"
            )
        yield


@contextmanager
def _listening(host: str, port: int) -> Iterator[socket.socket]:
    """A socket that listens: whether it can is known before anything else begins."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise InputError(f"--host {host}: is no address of this machine ({error})") from error
    with listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
            listener.listen(2048)
        except OSError as error:
            raise InputError(
                f"--host {host} --port {port}: cannot be listened on ({error.strerror}); use another --port"
            ) from error
        shown = f"[{host}]" if ":" in host else host
        logging.getLogger("bess.serve").info(f"listens at http://{shown}:{port}")
        yield listener
