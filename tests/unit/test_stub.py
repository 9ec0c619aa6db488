"""Claim: the stub of the compiled core says what the binary has, nothing more and nothing less."""

import subprocess
import sys


def test_stub_and_binary_agree() -> None:
    answer = subprocess.run(
        [sys.executable, "-m", "mypy.stubtest", "bess._core"], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stdout + answer.stderr
