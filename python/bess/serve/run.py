"""``bess serve``: from the command line to a listening process."""

from __future__ import annotations

import logging
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bess.errors import InputError
from bess.extras import extra
from bess.plants import connect
from bess.plants.address import parse_address
from bess.plants.journal import Journal
from bess.policies.reactive import refuse_reactive
from bess.record.store import Lock
from bess.serve.limits import check_host, read_token
from bess.study import Study


def serve(
    study: Study,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    token_file: Path | None = None,
    state: Path | None = None,
    plant: str | None = None,
    shadow: bool = False,
) -> None:
    """Listen until the process is told to stop.

    Raises
    ------
    InputError
        From the study, the token, the address, or a library that is missing.
    """
    refuse_reactive("the service", "share it by another controller", asked=study.reactive is not None)
    token = None if token_file is None else read_token(token_file)
    check_host(host, token)
    if shadow and plant is None:
        raise InputError("--shadow: watches a plant; name one with --plant openems=URL or sunspec=HOST")
    address = None if plant is None else parse_address(plant)
    with extra("plant", "bess serve"):
        import fastapi  # noqa: F401
        import prometheus_client  # noqa: F401
        import uvicorn

    from bess.serve.app import Driven, build_app
    from bess.serve.cycle import STEP_S, Cycle
    from bess.serve.demands import Demands
    from bess.serve.service import JsonLines, Service

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines())
    for name in ("bess.serve", "uvicorn.error"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
        logger.setLevel(logging.INFO)
    if plant is not None and study.service.control_step_s is None:
        study = study.with_values({"service.control_step_s": STEP_S})
    folder = state or Path("results") / f"{study.name}-service"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InputError(f"--state {folder}: is no folder that can be written to ({error})") from error
    with Lock(folder), _listening(host, port) as listener:
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
            cycle = Cycle(service, link, demands, journal, shadow=shadow)
            driven = Driven(f"{address.kind} at {address.url}", demands, cycle)
            thread = threading.Thread(target=cycle.run, name="cycle")
            thread.start()
        config = uvicorn.Config(
            build_app(service, token, driven),
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=5,
            limit_concurrency=1000,
        )
        server = uvicorn.Server(config)
        try:
            # A signal that has been obeyed is raised again.
            with suppress(KeyboardInterrupt):
                server.run(sockets=[listener])
        finally:
            if driven is not None and thread is not None:
                driven.cycle.stop()
                thread.join()
            service.close()


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
        logging.getLogger("bess.serve").info(f"listens at http://{host}:{port}")
        yield listener
