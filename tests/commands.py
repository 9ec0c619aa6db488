"""The command ``bess`` within the process of a test: one of its own takes a second to start."""

from __future__ import annotations

import contextlib
import io
import signal
import subprocess
import sys
from pathlib import Path
from unittest import mock

from bess.cli import main


def command(*words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """What a process that ran the command in ``folder`` would have left."""
    stdout, stderr = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["bess", *words]),
        contextlib.chdir(folder or Path.cwd()),
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
    ):
        on_sigterm = signal.getsignal(signal.SIGTERM)
        try:
            main()
        except SystemExit as ended:
            status = int(ended.code or 0)
        finally:
            signal.signal(signal.SIGTERM, on_sigterm)
    return subprocess.CompletedProcess(words, status, stdout.getvalue(), stderr.getvalue())


def refused(*words: str, folder: Path | None = None) -> str:
    """The one line on standard error of a command that ends with status 2."""
    ended = command(*words, folder=folder)
    assert ended.returncode == 2, ended.stderr
    assert ended.stdout == ""
    (line,) = ended.stderr.splitlines()
    assert line.startswith("bess: ") and len(line) > 12
    return line
