"""``bess demo-plant`` as a stranger starts it."""

import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plant_partners import Connecting

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))
from service_load import free_port

pytestmark = pytest.mark.process


@pytest.mark.parametrize("kind", ["openems", "sunspec"])
def test_it_says_how_to_drive_it_and_is_driven(connecting: Connecting, kind: str, tmp_path: Path) -> None:
    study = tmp_path / "my study.toml"
    study.write_text('[demand]\nkind = "profile"\nfile = "two-cycle-48h"\n')
    command = [sys.executable, "-m", "bess", "demo-plant", str(study), "--kind", kind]
    command += ["--port", str(free_port())]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert "Simulated plant with 2 strings" in process.stdout.readline()
        command = shlex.split(process.stdout.readline())
        assert command[:3] == ["bess", "serve", str(study)]
        address = command[command.index("--plant") + 1]
        link = connecting(address, 2)
        link.write(np.array([30.0, -20.0]))
        assert link.read().power_kw == pytest.approx([30.0, -20.0], abs=0.01)
        process.send_signal(signal.SIGINT)
        process.wait(30)
        assert process.stdout.read().endswith("The plant has stopped.\n")
        assert process.stderr.read() == ""
    assert process.returncode == 0


def test_a_speed_of_zero_is_bad_input() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bess", "demo-plant", "--speed", "0"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "bess: speed 0.0: expected a positive number of plant seconds per second\n"
