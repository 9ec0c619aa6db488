"""One wrong bit in the files of a run, finished or under way: an error with a remedy, never other data."""

import json
import random
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import bess
from bess.report.runs import runs_in
from power_cut import cut_off

QUICK = {"policy.name": "soc", "run.days": 0.5, "output.node_temperatures": True, "demand.scale": 3.0}
"""Above the nominal power for some steps, so that the log has lines."""


def flip(path: Path, bit: int) -> None:
    raw = bytearray(path.read_bytes())
    raw[bit // 8] ^= 1 << bit % 8
    path.write_bytes(raw)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "finished"
    bess.run(bess.load_study("case1", QUICK), out=folder, progress=False)
    return folder


@pytest.fixture(scope="module")
def under_way(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "cut"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bess.simulation.runner.MAX_PART_STEPS", 16)
        cut_off(bess.load_study("case1", QUICK), folder, 40, patch)
    return folder


def flipped_copies(folder, name, trials, tmp_path):
    """Copies of a folder with one bit flipped in one of its files, each anew, spread over the whole file."""
    rng = random.Random(name)
    bits = 8 * (folder / name).stat().st_size
    copy = tmp_path / "copy"
    for trial in range(trials):
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(folder, copy)
        bit = int((trial + rng.random()) / trials * bits)
        flip(copy / name, bit)
        yield bit, copy


def test_every_flipped_bit_of_a_record_is_an_error_with_a_remedy(finished, tmp_path):
    for bit, copy in flipped_copies(finished, "results.nc", 150, tmp_path):
        with pytest.raises(bess.InputError, match=r"results\.nc: is damaged .*run the study again"):
            bess.open_result(copy)
            pytest.fail(f"bit {bit}")


def test_every_flipped_bit_of_a_part_is_an_error_with_a_remedy(under_way, tmp_path):
    name = "parts/00000016.npz"
    for bit, copy in flipped_copies(under_way, name, 60, tmp_path):
        with pytest.raises(bess.BessError, match=r"00000016\.npz: damaged .*delete it"):
            bess.open_result(copy)
            pytest.fail(f"bit {bit}")


def test_a_run_continues_from_the_parts_before_a_damaged_one_to_the_same_bits(under_way, finished, tmp_path):
    copy = shutil.copytree(under_way, tmp_path / "copy")
    flip(copy / "parts/00000016.npz", 5000)
    study = bess.load_study("case1", QUICK)
    with pytest.raises(bess.BessError, match="delete it and all later parts"):
        bess.run(study, out=copy, resume=True, progress=False)
    (copy / "parts/00000016.npz").unlink()
    assert bess.run(study, out=copy, resume=True, progress=False).dataset.identical(
        bess.open_result(finished)
    )


def test_flipped_bits_of_key_figures_are_noticed_and_the_record_gives_them_again(finished, tmp_path):
    wanted = json.loads((finished / "kpis.json").read_text())
    for bit, copy in flipped_copies(finished, "kpis.json", 30, tmp_path):
        runs, _ = runs_in(copy)
        assert {key: runs["case1"].kpis[key] for key in wanted} == pytest.approx(wanted, abs=0, rel=0), bit


@pytest.mark.parametrize(("name", "said"), [("run.json", "is damaged"), ("log.jsonl", "is damaged")])
def test_a_flipped_bit_beside_the_record_is_an_error_too(name, said, finished, tmp_path):
    for bit, copy in flipped_copies(finished, name, 10, tmp_path):
        with pytest.raises(bess.InputError, match=said):
            bess.run(bess.load_study("case1", QUICK), out=copy, progress=False)
            pytest.fail(f"bit {bit}")


def test_a_flipped_bit_in_the_checksums_themselves_never_hides_another(finished, tmp_path):
    for bit, copy in flipped_copies(finished, "SHA256SUMS", 20, tmp_path):
        flip(copy / "results.nc", 80_000)
        with pytest.raises(bess.InputError, match="is damaged"):
            bess.open_result(copy)
            pytest.fail(f"bit {bit}")


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="no sha256sum here")
def test_sha256sum_checks_a_finished_run(finished):
    command = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    said = subprocess.run(command, cwd=finished, capture_output=True, text=True, check=True).stdout
    assert sorted(line.partition(":")[0] for line in said.splitlines()) == [
        "kpis.json", "log.jsonl", "results.nc", "run.json", "study.toml",
    ]  # fmt: skip


def test_values_are_checked_by_every_reader_of_hdf5_too(finished, tmp_path):
    """A record that was copied without its checksums: HDF5's own, of every chunk of values."""
    import xarray as xr

    path = shutil.copy(finished / "results.nc", tmp_path / "alone.nc")
    with xr.open_dataset(path, engine="h5netcdf") as data:
        values = data["soc"].values
    where = Path(path).read_bytes().index(values[:2].tobytes())
    flip(Path(path), 8 * where + 3)
    with xr.open_dataset(path, engine="h5netcdf") as data, pytest.raises(OSError):
        np.asarray(data["soc"].values)
