"""Bytes of every kind of file that is read, mutated by a seed: they are read, or refused in one sentence.

``test_mutations`` changes tables, studies and systems as people do; here bits flip, blocks go, digits grow
and nesting has no end, inside archives too, in every file that a command opens: tables, workbooks, Parquet,
cells, inverters, systems, studies, controllers, the folders of runs, sweeps and services.
"""

from __future__ import annotations

import gzip
import io
import random
import shutil
import zipfile
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from test_mutations import FILES, outcome

import bess
from bess.control.explicit import ExplicitController
from bess.control.explicit.controller import Tables
from bess.dispatch import read_profile
from bess.edge.distil.training import first_weights
from bess.edge.plant_io import Measurements
from bess.edge.plant_io.journal import Journal, open_journal
from bess.market.capacity_prices import read_capacity_prices
from bess.market.frequency import read_frequency
from bess.report.runs import runs_in
from bess.report.words.tables import read_sweep
from bess.simulation.record.files import CHECKSUMS
from bess.system.components import read_ocv, read_resistance
from power_cut import cut_off

HOURS = pd.date_range("2024-03-29 23:00", periods=95, freq="h", tz="UTC")
FRAME = pd.DataFrame({"price": np.round(60.0 + 80.0 * np.sin(np.arange(95.0)), 2)}, index=HOURS)
FRAME.index.name = "time"
SHORT = {"policy.name": "soc", "run.days": 0.25}
SYSTEM = bess.System.reference(2)
TOKENS = [b"9" * 400, b"1e999", b"-1e999", b"nan", b"-1", b"0", b"null", b"[]", b"{}", b'"', b"\0", b"\xff",
          b"\xe2\x82\xac", b"1" * 5000, b"true", b"\n" * 50, b"[" * 200_000, b'{"a":' * 200_000,
          b"a." * 20_000 + b"a=1\n"]  # fmt: skip


def mutated(rng: random.Random, raw: bytes) -> bytes:
    """One to four changes of bytes."""
    out = bytearray(raw)
    for _ in range(rng.randint(1, 4)):
        i, n = rng.randrange(len(out) + 1), rng.randint(1, 40)
        how = rng.randrange(9)
        if how == 0 and out:
            out[i % len(out)] ^= 1 << rng.randrange(8)
        elif how == 1:
            out[i : i + n] = rng.randbytes(rng.randint(0, 40))
        elif how == 2:
            del out[i : i + n]
        elif how == 3:
            del out[i:]
        elif how == 4:
            out[i : i + n] = bytes([rng.choice([0, 255, 0x7F])]) * n
        elif how == 5:
            j = rng.randrange(len(out) + 1)
            out[i : i + n], out[j : j + n] = out[j : j + n], out[i : i + n]
        elif how == 6:
            out[i:i] = out[i : i + 10 * n]
        else:
            digits = [k for k in range(i, min(i + 200, len(out))) if 48 <= out[k] < 58]
            k = rng.choice(digits) if digits else i
            out[k : k + 1] = rng.choice(TOKENS)
    return bytes(out)


def mutated_within(rng: random.Random, raw: bytes) -> bytes:
    """Mutated as it is, or in one member of the archive that it is."""
    if rng.random() < 0.5 or not zipfile.is_zipfile(io.BytesIO(raw)):
        return mutated(rng, raw)
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(raw)) as old, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new:
        struck = rng.choice(old.namelist())
        for name in old.namelist():
            new.writestr(name, mutated(rng, old.read(name)) if name == struck else old.read(name))
    return out.getvalue()


# --- single files ------------------------------------------------------------------------------------------


def as_parquet(frame: pd.DataFrame, **options: Any) -> bytes:
    out = io.BytesIO()
    frame.to_parquet(out, **options)
    return out.getvalue()


def as_workbook(frame: pd.DataFrame) -> bytes:
    out = io.BytesIO()
    frame.tz_localize(None).to_excel(out)
    return out.getvalue()


def as_zip(text: str) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("prices.csv", text)
    return out.getvalue()


def controller() -> bytes:
    tables = Tables.of(SYSTEM, 8, 0.25, 3.0)
    made = ExplicitController(study="s", system="r", weights=tuple(first_weights()), tables=tables)
    return made.to_json().encode()


OCV = b"SOC,OCV\n" + b"".join(b"%.2f,%.4f\n" % (x / 20, 3.2 + x / 20) for x in range(21))
OHM = b"SOC,R_Ch(298 K_0.5C),R_DCh(298 K_0.5C)\n" + b"".join(
    b"%.2f,%.3f,%.3f\n" % (x / 20, 1.0 + x / 50, 1.1 + x / 50) for x in range(21)
)
SECONDS = pd.date_range("2024-01-01", periods=600, freq="s", tz="UTC")
FREQUENCY = pd.DataFrame({"frequency_hz": 50.0 + 0.01 * np.sin(np.arange(600.0))}, index=SECONDS)
CAPACITY = "DATE_FROM;TENDER_NUMBER;PRODUCTNAME;GERMANY_SETTLEMENTCAPACITY_PRICE_[EUR/MW]\n" + "".join(
    f"{day:02d}.01.2024;1;NEGPOS_{4 * block:02d}_{4 * block + 4:02d};{50 + day + block},5\n"
    for day in range(1, 4)
    for block in range(6)
)
ETA = b"p_norm,eta\n" + b"".join(b"%.2f,%.4f\n" % (x / 20, 0.97 - 0.02 / (x + 1)) for x in range(1, 21))

Read = Callable[[Path], object]
SINGLE: dict[str, tuple[str, bytes, Read]] = {
    **{kind: ("input", text.encode(), read) for kind, (read, text) in FILES.items()},
    "parquet": ("p.parquet", as_parquet(FRAME), bess.read_prices),
    "weather parquet": ("w", as_parquet(FRAME / 10, compression=None), bess.read_weather),
    "profile parquet": ("p", as_parquet(FRAME), lambda path: read_profile(path, dt_h=1.0)),
    "frequency parquet": ("f", as_parquet(FREQUENCY), read_frequency),
    "workbook": ("p.xlsx", as_workbook(FRAME), lambda path: bess.read_prices(path, time_zone="UTC")),
    "zip": ("p.zip", as_zip(FRAME.to_csv()), bess.read_prices),
    "gzip": ("p.gz", gzip.compress(FRAME.to_csv().encode()), bess.read_prices),
    "capacity prices": ("c.csv", CAPACITY.encode(), read_capacity_prices),
    "inverter": ("i.csv", ETA, lambda path: bess.read_inverter(path, nominal_kw=92.0)),
    "inverter parquet": (
        "i.parquet",
        as_parquet(pd.read_csv(io.BytesIO(ETA))),
        lambda path: bess.read_inverter(path, nominal_kw=92.0),
    ),
    "cell": ("o.csv", OCV, read_ocv),
    "resistance": ("r.csv", OHM, lambda path: read_resistance(path, control_c_rate=0.5)),
    "system": ("s.toml", SYSTEM.to_toml().encode(), bess.load_system),
    "study": ("s.toml", bess.load_study("case1").to_toml().encode(), bess.load_study),
    "controller": ("policy.json", controller(), ExplicitController.read),
}


@pytest.mark.parametrize("kind", [kind for kind in SINGLE if kind not in FILES])
def test_what_is_mutated_is_read_whole(kind: str, tmp_path: Path) -> None:
    name, raw, read = SINGLE[kind]
    (tmp_path / name).write_bytes(raw)
    assert read(tmp_path / name) is not None


def try_file(kind: str, seeds: range, folder: Path) -> None:
    name, raw, read = SINGLE[kind]
    for seed in seeds:
        path = folder / name
        path.write_bytes(mutated_within(random.Random(f"{kind}-{seed}"), raw))
        claimed(f"{kind}, seed {seed}", partial(read, path))


def claimed(what: str, call: Callable[[], object]) -> None:
    try:
        outcome(call)
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}") from error


# --- folders -----------------------------------------------------------------------------------------------


def finished_run(folder: Path) -> None:
    bess.run(bess.load_study("case1", SHORT), out=folder, progress=False)


def record_without_checksums(folder: Path) -> None:
    finished_run(folder)
    (folder / CHECKSUMS).unlink()


def run_under_way(folder: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bess.simulation.runner.MAX_PART_STEPS", 8)
        cut_off(bess.load_study("case1", SHORT), folder, 20, patch)


def finished_sweep(folder: Path) -> None:
    axis = {"key": "demand.scale", "values": [0.5, 0.8, 1.0]}
    document = {"name": "s", "demand": {"file": "two-cycle-48h"}, "policy": {"name": "soc"}, "sweep": [axis]}
    study = bess.Study.from_document(document | {"run": {"days": 0.125}}, "s")
    assert not bess.run_sweep(study, folder, workers=1, progress=False).failed


def journal(folder: Path) -> None:
    with closing(Journal(folder, SYSTEM, "a plant")) as kept:
        for second in range(40):
            values = np.array([0.5, 0.6])
            kept.append(
                Measurements(
                    HOURS[0].to_pydatetime() + pd.Timedelta(seconds=second), values, values, values, values,
                    values, np.array([True, False]),
                ),
                78.0, [50.0, 28.0],
            )  # fmt: skip


def look_at_run(folder: Path) -> None:
    """All that a report, a comparison and a resumed run read of a folder."""
    bess.open_result(folder).load()
    for run in runs_in(folder)[0].values():
        assert run.kpis
        assert run.study_toml
        assert run.solve_time_s is None or run.solve_time_s.size
        assert run.system.n_strings
    bess.run(bess.load_study("case1", SHORT), out=folder, resume=True, progress=False)


def look_at_sweep(folder: Path) -> None:
    table = read_sweep(folder)
    if table is not None:
        assert list(table.exhibits()) is not None
        table.front_sentence()
    runs_in(folder)


FOLDERS: dict[str, tuple[Callable[[Path], None], Callable[[Path], object]]] = {
    "finished run": (finished_run, look_at_run),
    "record without checksums": (record_without_checksums, look_at_run),
    "run under way": (run_under_way, look_at_run),
    "sweep": (finished_sweep, look_at_sweep),
    "journal": (journal, open_journal),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folders as they are written, each made when it is first used."""
    made: dict[str, Path] = {}

    def folder(kind: str) -> Path:
        if kind not in made:
            made[kind] = tmp_path_factory.mktemp("whole") / "folder"
            FOLDERS[kind][0](made[kind])
        return made[kind]

    return folder


def try_folder(kind: str, seeds: range, whole: Path, folder: Path) -> None:
    paths = sorted(path.relative_to(whole) for path in whole.rglob("*") if path.is_file())
    paths = [path for path in paths if path.name[0] != "."]
    for seed in seeds:
        copy = shutil.copytree(whole, folder / "copy")
        rng = random.Random(f"{kind}-{seed}")
        path = copy / rng.choice(paths)
        path.write_bytes(mutated_within(rng, path.read_bytes()))
        claimed(f"{kind}, {path.name}, seed {seed}", partial(FOLDERS[kind][1], copy))
        shutil.rmtree(copy)


@pytest.mark.parametrize("kind", SINGLE)
def test_a_mutated_file_is_read_or_refused(kind: str, tmp_path: Path) -> None:
    try_file(kind, range(10), tmp_path)


@pytest.mark.parametrize("kind", FOLDERS)
def test_a_mutated_folder_is_read_or_refused(kind: str, whole: Callable[[str], Path], tmp_path: Path) -> None:
    try_folder(kind, range(8), whole(kind), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", SINGLE)
def test_thousands_of_mutated_files_are_read_or_refused(kind: str, tmp_path: Path) -> None:
    try_file(kind, range(1000, 1190), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FOLDERS)
def test_hundreds_of_mutated_folders_are_read_or_refused(
    kind: str, whole: Callable[[str], Path], tmp_path: Path
) -> None:
    try_folder(kind, range(1000, 1060), whole(kind), tmp_path)
