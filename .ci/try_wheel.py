"""Install the package by name from a folder of wheels into a new environment, and try it there.

Imports it, runs a day of case 1, and runs the quick tests against the installed package.
Usage: ``python .ci/try_wheel.py dist``.
"""

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
QUICK = ("tests/physics", "tests/split/test_control_model.py", "tests/simulation/test_policies.py")
NEEDED = ("hypothesis", "pytest", "pytest-benchmark")


def main(dist: Path) -> None:
    """Try the wheel in ``dist`` that fits this interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        venv.create(work / "env", with_pip=True)
        binaries = work / "env" / ("Scripts" if os.name == "nt" else "bin")

        def run(*command: str | Path) -> None:
            print("+", *command, flush=True)
            program, *rest = command
            subprocess.run([binaries / program, *rest], cwd=work, check=True)

        install = ("python", "-m", "pip", "install", "--quiet")
        ours = ("--no-index", "--no-deps", "--only-binary", ":all:", "--find-links", dist)
        run(*install, *ours, "bess-powersplit")
        run(*install, "bess-powersplit[plant]", *NEEDED)
        run("python", "-c", "import bess, sys; print(bess.__version__, bess.__file__, sys.version)")
        run("bess", "run", "case1", "--days", "1", "--out", work / "day")
        tests = [ROOT / path for path in QUICK]
        run(
            "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow and not process", *tests
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
