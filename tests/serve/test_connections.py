"""Connections that are silent, slow or too many: whoever holds the token is served all the same."""

from __future__ import annotations

import http.client
import json
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

pytest.importorskip("fastapi")

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

from bess.edge.serve.gate import HEADER_TIMEOUT_S, MAX_BODY
from service_load import Server

pytestmark = pytest.mark.process

TOKEN = "0123456789abcdef0123456789abcdef"
HEADERS = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"}
BODY = json.dumps({"demand_kw": 60.0, "strings": [{"soc": 0.6}, {"soc": 0.5}]})
HEAD = b"POST /v1/split HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("service")
    (folder / "token").write_text(TOKEN)
    made = Server(folder, 2, "--token-file", str(folder / "token"))
    yield made
    made.kill()


def connected(server: Server) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=60.0)


def ask(connection: http.client.HTTPConnection) -> int:
    connection.request("POST", "/v1/split", BODY, HEADERS)
    answer = connection.getresponse()
    answer.read()
    return answer.status


def test_a_thousand_callers_that_never_finish_keep_nobody_out(server: Server) -> None:
    with ExitStack() as stack:
        kept = stack.enter_context(closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)))
        assert ask(kept) == 200
        slow = [stack.enter_context(connected(server)) for _ in range(1000)]
        stop = threading.Event()

        def trickle() -> None:
            for one in slow:
                _send(one, b"GET / HTTP/1.1\r\n")
            while not stop.wait(0.5):
                for one in slow:
                    _send(one, b"X: y\r\n")

        thread = threading.Thread(target=trickle)
        thread.start()
        try:
            began_s = time.monotonic()
            while time.monotonic() - began_s < HEADER_TIMEOUT_S + 1.0:
                assert ask(kept) == 200
                with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as new:
                    assert ask(new) == 200
        finally:
            stop.set()
            thread.join()
        for one in slow:
            one.settimeout(HEADER_TIMEOUT_S)
            assert _ends(one)


def test_callers_who_are_refused_do_not_fill_the_log(server: Server) -> None:
    refused = 600
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as caller:
        for _ in range(refused):
            caller.request("GET", "/v1/live")
            answer = caller.getresponse()
            answer.read()
            assert answer.status == 401
    lines = server.log.read_text().count("request refused")
    assert 0 < lines < refused / 2
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as holder:
        holder.request("GET", "/metrics", headers=HEADERS)
        text = holder.getresponse().read().decode()
    counted = re.search(r'path="/v1/live",status="401"} (\d+)', text)
    assert counted is not None and int(counted[1]) >= refused


def test_a_body_that_never_ends_is_given_up(server: Server) -> None:
    with connected(server) as slow:
        slow.sendall(HEAD + f"Authorization: Bearer {TOKEN}\r\nContent-Length: 100\r\n\r\n{{".encode())
        assert slow.recv(4096).startswith(b"HTTP/1.1 408 ")
        assert _ends(slow)


def test_a_body_without_a_length_is_cut_at_the_same_size(server: Server) -> None:
    with connected(server) as caller:
        caller.sendall(HEAD + f"Authorization: Bearer {TOKEN}\r\nTransfer-Encoding: chunked\r\n\r\n".encode())
        caller.sendall(f"{MAX_BODY + 1:x}\r\n".encode() + b" " * (MAX_BODY + 1))
        assert caller.recv(4096).startswith(b"HTTP/1.1 413 ")


def test_requests_that_come_at_once_are_answered_in_their_order(server: Server) -> None:
    with connected(server) as caller:
        for path in ("/v1/health", "/v1/live", "/v1/health"):
            _send(caller, f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        _send(caller, b"GET /v1/nothing HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        text = _until_the_end(caller)
    assert re.findall(r"HTTP/1.1 (\d+)", text) == ["200", "401", "200", "401"]


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n", "400"),
        (b"GET /v1/health HTTP/1.1\r\n\r\n", "400"),
        (b"GET /v1/health HTTP/1.0\r\n\r\n", "421"),
        (b"GET http://evil.example/v1/health HTTP/1.1\r\nHost: localhost\r\n\r\n", "401"),
        (b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
         b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MTIzNDU2Nzg5MDEyMzQ1Ng==\r\n\r\n", "200"),
        (b"\x16\x03\x01\x02\x00\x01\x00", "400"),
    ],
)  # fmt: skip
def test_what_is_no_plain_request_is_answered_as_one_or_refused(
    server: Server, head: bytes, status: str
) -> None:
    with connected(server) as caller:
        _send(caller, head)
        caller.settimeout(10.0)
        assert caller.recv(4096).decode().split()[1] == status


def _send(one: socket.socket, data: bytes) -> None:
    with suppress(OSError):  # cut off already
        one.sendall(data)


def _until_the_end(one: socket.socket) -> str:
    data = b""
    with suppress(ConnectionError):
        while part := one.recv(65536):
            data += part
    return data.decode()


def _ends(one: socket.socket) -> bool:
    """Whether the service closes the connection, with or without a word."""
    try:
        _until_the_end(one)
    except TimeoutError:
        return False
    return True
