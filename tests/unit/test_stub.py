"""Claim: the stub of the compiled core says what the binary has, nothing more and nothing less."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from bess import _core


def test_stub_and_binary_agree(tmp_path: Path) -> None:
    """In a package that holds nothing else: `bess` and all that it imports would be checked too."""
    binary = Path(str(_core.__file__))
    package = tmp_path / "bess"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "system.pyi").write_text("class State: ...", encoding="utf-8")
    for file in (binary, binary.with_name("_core.pyi")):
        shutil.copy(file, package)
    answer = subprocess.run(
        [sys.executable, "-P", "-m", "mypy.stubtest", "bess._core"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )
    assert answer.returncode == 0, answer.stdout + answer.stderr
