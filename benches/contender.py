"""Run a contender in a process of its own and read what it measured."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "contenders"
TIME_LIMIT_S = 900.0


@dataclass(frozen=True)
class Outcome:
    """Figures of a contender, or the reason why there are none."""

    figures: Any | None
    reason: str = ""


def run_contender(script: str, *arguments: object) -> Outcome:
    """Run ``contenders/script``; whatever else it prints (solvers do) is kept away from the table.

    A contender prints its figures as one line of JSON at the end, or as lines that begin with ``RESULT``.
    """
    command = [sys.executable, str(FOLDER / script), *map(str, arguments)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return Outcome(None, f"not done within {TIME_LIMIT_S:g} s")
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        if last.startswith("ModuleNotFoundError"):
            return Outcome(None, f"not installed ({last.rpartition('named ')[2]})")
        return Outcome(None, f"failed: {last}")
    lines = done.stdout.strip().splitlines()
    # Bonmin may write into the middle of a line, so results are looked for anywhere.
    results = [line.partition("RESULT ")[2] for line in lines if "RESULT " in line]
    if results:
        return Outcome([json.loads(result) for result in results])
    return Outcome(json.loads(lines[-1]))
