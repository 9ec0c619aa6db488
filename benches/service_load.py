"""Load on the service: many callers at once, with some malformed requests.

    python benches/service_load.py [--requests 10000] [--at-once 20] [--malformed 0.05] [--strings 2 4 8]

Starts ``bess serve`` as a separate process for each number of strings, and prints response times at the
callers, the memory of the process, and wrong answers. Times depend on the machine and its load; sums and
statuses do not.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

STUDY = """\
[system]
n_strings = {n_strings}
[demand]
file = "two-cycle-48h"
"""
MALFORMED = (
    b"",
    b"{",
    b"[]",
    b'{"demand_kw": NaN, "strings": []}',
    b'{"demand_kw": 1e999, "strings": []}',
    b'{"demand_kw": "78", "strings": []}',
    b'{"demand_kw": 5}',
    b'{"demand_kw": 5, "strings": [{"soc": 7}]}',
    b'{"demand_kw": 5, "strings": 3}',
    b"\xff\xfe",
    b"[" * 20_000,
)


@dataclass
class Outcome:
    """Answers as the callers received them."""

    times_s: list[float] = field(default_factory=list)
    statuses: dict[int, int] = field(default_factory=dict)
    wrong_sums: int = 0
    wrong_statuses: int = 0
    fallbacks: int = 0
    rss_kb: list[int] = field(default_factory=list)


def free_port() -> int:
    """Return a port of the loopback that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Server:
    """``bess serve`` on the loopback, with a state of its own."""

    def __init__(self, folder: Path, n_strings: int, *options: str) -> None:
        study = folder / "study.toml"
        study.write_text(STUDY.format(n_strings=n_strings))
        self.port = free_port()
        self.log = folder / "log"
        self._log = self.log.open("ab")
        arguments = [sys.executable, "-m", "bess", "serve", str(study), "--port", str(self.port)]
        arguments += ["--state", str(folder / "state"), *options]
        self.process = subprocess.Popen(arguments, stderr=self._log, stdout=self._log)
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1.0).close()
                return
            except OSError:
                time.sleep(0.05)
        raise RuntimeError("the service did not come up")

    @property
    def rss_kb(self) -> int:
        """Resident memory of the process [kB]."""
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1])
        return 0

    def kill(self) -> None:
        """End it without notice."""
        os.kill(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._log.close()


async def post(port: int, connection: list[object], body: bytes) -> tuple[int, bytes]:
    """One request over a connection that is kept; ``connection`` is empty or holds its two ends."""
    if not connection:
        connection.extend(await asyncio.open_connection("127.0.0.1", port))
    reader, writer = connection
    head = (
        "POST /v1/split HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    )
    writer.write(head.encode() + body)  # type: ignore[attr-defined]
    lines = (await reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")  # type: ignore[attr-defined]
    length = next(int(line.split(":")[1]) for line in lines if line.lower().startswith("content-length"))
    return int(lines[0].split()[1]), await reader.readexactly(length)  # type: ignore[attr-defined]


async def load(
    server: Server, n_strings: int, requests: int, at_once: int, malformed: float, seed: int = 1
) -> Outcome:
    """Send requests from ``at_once`` callers."""
    outcome, rng = Outcome(), np.random.default_rng(seed)
    total_kw = 92.0 * n_strings
    left = iter(range(requests))

    async def caller() -> None:
        connection: list[object] = []
        for number in left:
            if number % max(1, requests // 10) == 0:
                outcome.rss_kb.append(server.rss_kb)
            bad = rng.random() < malformed
            demand_kw = float(rng.uniform(-1.1, 1.1) * total_kw)
            strings = [
                {"soc": rng.uniform(0.1, 0.9), "temperature_c": rng.uniform(15.0, 45.0)}
                for _ in range(n_strings)
            ]
            good = json.dumps({"demand_kw": demand_kw, "strings": strings}).encode()
            body = MALFORMED[rng.integers(len(MALFORMED))] if bad else good
            began = time.perf_counter()
            status, content = await post(server.port, connection, body)
            outcome.times_s.append(time.perf_counter() - began)
            outcome.statuses[status] = outcome.statuses.get(status, 0) + 1
            outcome.wrong_statuses += status != (422 if bad else 200)
            if status == 200:
                answer = json.loads(content)
                request = np.array(answer["request_kw"])
                sum_kw = request.sum() + np.sign(demand_kw) * answer["unmet_kw"]
                right = abs(sum_kw - demand_kw) < 1e-6 and (np.abs(request) <= 92.0 + 1e-6).all()
                outcome.wrong_sums += not (right and (request * np.sign(demand_kw) >= 0.0).all())
                outcome.fallbacks += answer["fallback"]
        if connection:
            connection[1].close()  # type: ignore[attr-defined]
            await connection[1].wait_closed()  # type: ignore[attr-defined]

    await asyncio.gather(*(caller() for _ in range(at_once)))
    return outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--at-once", type=int, default=20)
    parser.add_argument("--malformed", type=float, default=0.05)
    parser.add_argument("--strings", type=int, nargs="+", default=[2, 4, 8])
    given = parser.parse_args()
    for n_strings in given.strings:
        with tempfile.TemporaryDirectory() as folder:
            server = Server(Path(folder), n_strings)
            try:
                began = time.perf_counter()
                outcome = asyncio.run(load(server, n_strings, given.requests, given.at_once, given.malformed))
                took = time.perf_counter() - began
                ticks = Path(f"/proc/{server.process.pid}/stat").read_text().rpartition(")")[2].split()
                served_s = (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")
            finally:
                server.kill()
        ms = 1e3 * np.percentile(outcome.times_s, [50, 99, 100])
        memory_mb = np.array(outcome.rss_kb)[[1, -1]] / 1024
        facts = [
            f"{given.requests / took:.0f} requests/s",
            f"50th, 99th percentile, longest: {ms[0]:.1f}, {ms[1]:.1f}, {ms[2]:.1f} ms",
            f"{1e3 * served_s / given.requests:.2f} CPU ms a request",
            f"statuses {outcome.statuses}, wrong {outcome.wrong_statuses}",
            f"wrong sums {outcome.wrong_sums}",
            f"fallbacks {outcome.fallbacks}",
            f"memory {memory_mb[0]:.0f} to {memory_mb[1]:.0f} MB",
        ]
        print(f"{n_strings} strings: " + "; ".join(facts), flush=True)


if __name__ == "__main__":
    main()
