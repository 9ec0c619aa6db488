"""Plants that are slow, that trickle, or that never answer: every call ends in its time, none starves."""

import asyncio
import gc
import select
import socket
import socketserver
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
from plant_partners import Behaviour, Connecting, ManualClock, server

import bess
from bess.edge.plant_io import LinkError, calls, openems
from bess.edge.plant_io.link import StringLink
from bess.edge.plant_io.simulated import SimulatedPlant
from bess.edge.plant_io.simulated_openems import SimulatedEdge
from bess.edge.plant_io.simulated_sunspec import SimulatedDevices

MANY = 32
CALL_S = 0.12
MAX_SHUTDOWN_S = 4.0
"""Longer than any call here may take, shorter than what the partners below would like."""


def _trickle(piece: bytes) -> Behaviour:
    def behave(request: socketserver.StreamRequestHandler, stop: threading.Event) -> None:
        while not stop.wait(0.05):
            request.wfile.write(piece)

    return behave


def _ends(call: Callable[[], object]) -> str:
    """Return the error of a call; fail if it has not ended after a while."""
    said: list[str] = []

    def run() -> None:
        try:
            call()
        except LinkError as error:
            said.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(MAX_SHUTDOWN_S)
    assert not thread.is_alive()
    return said[0]


@pytest.mark.parametrize(
    "piece",
    [b"HTTP/1.1 100 Continue\r\n\r\n", b"X", b""],
    ids=["100 Continue", "one byte of a status line", "silence"],
)
def test_an_edge_that_trickles_before_its_answer_is_left_in_time(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch, piece: bytes
) -> None:
    monkeypatch.setattr(calls, "DEADLINE_S", 0.3)
    with server(_trickle(piece)) as port:
        link = connecting(f"openems=http://127.0.0.1:{port}?ess=ess0,ess1,ess2")
        for call in (link.read, link.release):
            assert "no answer within 0.3 s" in _ends(call)


def test_headers_that_trickle_have_no_more_time_than_others(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calls, "DEADLINE_S", 0.3)

    def behave(request: socketserver.StreamRequestHandler, stop: threading.Event) -> None:
        request.wfile.write(b"HTTP/1.1 200 OK\r\n")
        _trickle(b"X-More: 1\r\n")(request, stop)

    with server(behave) as port:
        assert "no answer within 0.3 s" in _ends(connecting(f"openems=http://127.0.0.1:{port}").read)


@pytest.mark.parametrize(
    "piece", [b"\x00\x01\x00\x00\x01\x00\x01", b"\x00", b""], ids=["frames", "bytes", "silence"]
)
def test_a_device_that_trickles_is_left_in_time(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch, piece: bytes
) -> None:
    monkeypatch.setattr(calls, "DEADLINE_S", 0.3)
    with server(_trickle(piece)) as port:
        link = connecting(f"sunspec=127.0.0.1:{port}")
        for call in (link.read, link.release):
            assert _ends(call)


def test_a_link_is_whole_again_after_an_edge_that_trickled(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = SimulatedPlant(bess.System.reference(n_strings=3))
    with SimulatedEdge(plant) as edge:
        link = connecting(edge.address)
        link.read()
        plant.faults.delay_s = 5.0
        with monkeypatch.context() as short:
            short.setattr(calls, "DEADLINE_S", 0.3)
            for _ in range(3 * openems.CONNECTIONS):
                assert "no answer within" in _ends(lambda: link.write(np.full(3, 10.0)))
        plant.faults.delay_s = 0.0
        link.write(np.full(3, 20.0))
        assert [plant.holds(string)[0] for string in range(3)] == [20.0] * 3  # type: ignore[index]


def test_a_link_survives_deadlines_at_every_moment_of_a_call(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The pool of httpcore lost a connection now and then, and after four of them no write arrived any more.
    plant = SimulatedPlant(bess.System.reference(n_strings=4))
    with SimulatedEdge(plant) as edge:
        link = connecting(edge.address, 4)
        link.read()
        with monkeypatch.context() as short:
            for deadline_s in np.linspace(0.0005, 0.02, 200):
                short.setattr(calls, "DEADLINE_S", float(deadline_s))
                with suppress(LinkError):
                    link.write(np.full(4, 10.0))
        link.write(np.full(4, 20.0))
        assert [plant.holds(string)[0] for string in range(4)] == [20.0] * 4  # type: ignore[index]


def test_connections_are_closed_even_if_the_machine_is_busy(connecting: Connecting) -> None:
    with SimulatedEdge(SimulatedPlant(bess.System.reference(n_strings=1))) as edge:
        link = connecting(edge.address, 1)
        link.read()
        loop: asyncio.AbstractEventLoop = link._calls._loop  # type: ignore[attr-defined]
        loop.call_soon_threadsafe(time.sleep, 1.2)
        link.close()
        assert loop.is_closed()
        del link, loop
        gc.collect()  # finds a connection that was left open: a ResourceWarning fails the test


def test_32_strings_at_120_ms_a_call_are_all_written_in_one_round(connecting: Connecting) -> None:
    plant = SimulatedPlant(bess.System.reference(n_strings=MANY))
    with SimulatedEdge(plant) as edge:
        link = connecting(edge.address, MANY)
        link.read()
        plant.faults.delay_s = CALL_S
        link.write(np.full(MANY, 62.0))
        plant.faults.delay_s = 0.0
        assert sum(reading.power_kw for reading in plant.truth()) == pytest.approx(MANY * 62.0, abs=0.1)


@pytest.mark.parametrize("kind", [SimulatedEdge, SimulatedDevices])
def test_no_string_starves_at_a_plant_too_slow_for_one_round(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch, kind: type[SimulatedEdge | SimulatedDevices]
) -> None:
    n = 12
    plant = SimulatedPlant(bess.System.reference(n_strings=n), clock=ManualClock())
    with kind(plant) as partner:
        link = connecting(partner.address, n)
        link.read()
        link.write(np.zeros(n))
        monkeypatch.setattr(calls, "DEADLINE_S", 0.3)
        plant.faults.delay_s = 0.12 if kind is SimulatedEdge else 0.02
        for kw in (10.0, 20.0):
            held: list[float] = []
            for _ in range(150):  # three to eight are enough on idle cores
                with suppress(LinkError):
                    link.write(np.full(n, kw))
                held = [hold[0] for string in range(n) if (hold := plant.holds(string))]
                if held == [kw] * n:
                    break
            assert held == [kw] * n


def test_strings_that_were_not_reached_are_named(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    plant = SimulatedPlant(bess.System.reference(n_strings=12))
    with SimulatedEdge(plant) as edge:
        link = connecting(edge.address, 12)
        link.read()
        # Four at a time: the first four have half a second to spare, the next would need as much again.
        monkeypatch.setattr(calls, "DEADLINE_S", 1.5)
        plant.faults.delay_s = 1.0
        with pytest.raises(LinkError, match=r"set-points of ess\d+(, ess\d+){7} not written: .*within 1.5 s"):
            link.write(np.full(12, 10.0))


def test_of_very_many_strings_that_were_not_reached_some_are_named() -> None:
    failures = {f"ess{string}": TimeoutError() for string in range(256)}
    with pytest.raises(LinkError, match=r"set-points of ess0, .* and 236 more not written") as error:
        StringLink._raise(failures)
    assert len(str(error.value)) < 250


def test_an_edge_that_takes_one_connection_has_all_strings_written_one_after_the_other(
    connecting: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Forward(socketserver.BaseRequestHandler):
        """One connection after the other, to the port of the edge and back."""

        def handle(self) -> None:
            with socket.create_connection(("127.0.0.1", edge._port)) as there:
                ends = {self.request: there, there: self.request}
                while ready := select.select(list(ends), [], [], 10.0)[0]:
                    for end in ready:
                        if not (data := end.recv(65_536)):
                            return
                        ends[end].sendall(data)

    plant = SimulatedPlant(bess.System.reference(n_strings=6))
    with SimulatedEdge(plant) as edge, socketserver.TCPServer(("127.0.0.1", 0), Forward) as single:
        threading.Thread(target=single.serve_forever, args=(0.05,), daemon=True).start()
        port = single.server_address[1]
        link = connecting(edge.address.replace(str(edge._port), str(port)), 6)
        link.read()
        monkeypatch.setattr(calls, "DEADLINE_S", 1.5)
        for kw in (10.0, 20.0):
            with suppress(LinkError):
                link.write(np.full(6, kw))
        link.write(np.full(6, 30.0))
        assert [plant.holds(string)[0] for string in range(6)] == [30.0] * 6  # type: ignore[index]
        link.close()
        single.shutdown()
