"""The way in for users: what `pip install` brings, in an environment that has nothing of this checkout."""

import os
import shutil
import subprocess
import sys
import venv
from functools import partial
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]


def _run(*command: str | Path, cwd: Path, **settings: str) -> str:
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | settings
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def empty_environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new virtual environment with the wheel that was built from the sdist, and its `bin` folder."""
    work = tmp_path_factory.mktemp("wheel")
    python = partial(_run, sys.executable, "-m", cwd=work)
    python("build", "--sdist", "--installer", "uv", "--outdir", work / "sdist", ROOT)
    (archive,) = (work / "sdist").glob("*.tar.gz")
    shutil.unpack_archive(archive, work)
    (sdist,) = work.glob("bess_powersplit-*")
    for source in sdist.rglob("*.rs"):
        source.touch()  # to cargo, the old times in the archive mean that they are compiled already
    # Unoptimised, with dependencies that the Rust tests have compiled: what the package contains is the same.
    settings = {"CARGO_TARGET_DIR": str(ROOT / "target"), "MATURIN_PEP517_ARGS": "--profile dev"}
    python("pip", "wheel", "--no-deps", "--wheel-dir", work / "wheel", sdist, **settings)
    (wheel,) = (work / "wheel").glob("*.whl")
    assert "abi3" in wheel.name
    venv.create(work / "env")
    binaries = work / "env" / ("Scripts" if os.name == "nt" else "bin")
    python("uv", "pip", "install", "--quiet", "--python", binaries / "python", wheel)
    return binaries


def test_wheel_from_the_sdist_runs_a_study(empty_environment: Path, tmp_path: Path) -> None:
    _run(
        empty_environment / "bess", "run", "case1", "--days", "0.25", "--out", tmp_path / "out", cwd=tmp_path
    )
    assert (tmp_path / "out" / "kpis.json").is_file()


def test_wheel_carries_its_types_and_its_bundled_data(empty_environment: Path, tmp_path: Path) -> None:
    code = (
        "import bess, importlib.resources as r; files = r.files('bess'); "
        "assert files.joinpath('py.typed').is_file() and files.joinpath('_core.pyi').is_file(); "
        "print(bess.System.reference().n_strings)"
    )
    assert _run(empty_environment / "python", "-c", code, cwd=tmp_path).strip() == "2"
