"""Files, studies, systems and arrays of many kinds, mutated by a seed: they work or are one sentence.

Beside the generic mutations of ``test_broken_inputs`` these know what files and studies look like: lines are
cut, swapped, repeated, cells replaced, whole files truncated anywhere. What is read in spite of that must be
regular and finite, and of a truncated file a part of what the whole one holds.
"""

from __future__ import annotations

import copy
import gzip
import random
import signal
import string
import tomllib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from test_broken_inputs import STUDY, prepared

import bess
from bess.dispatch import read_profile
from bess.study import Study
from bess.system.components.registry import CELLS, INVERTERS, SYSTEMS

HOURS = pd.date_range("2024-03-29 23:00", periods=95, freq="h", tz="UTC")
PRICES = np.round(60.0 + 80.0 * np.sin(np.arange(95.0)), 2)
BERLIN = HOURS.tz_convert("Europe/Berlin").tz_localize(None)
HOUR = pd.Timedelta(hours=1)
ROWS = list(zip(HOURS, PRICES, strict=True))


def comma(value: float) -> str:
    return f"{value:.2f}".replace(".", ",")


FILES: dict[str, tuple[Callable[..., pd.Series], str]] = {
    "plain": (
        lambda path: bess.read_prices(path, time_zone="UTC"),
        "time,price\n" + "".join(f"{t:%Y-%m-%d %H:%M},{v:.2f}\n" for t, v in zip(HOURS, PRICES, strict=True)),
    ),
    "labelled": (
        bess.read_prices,
        "time;DE-LU;FR\n"
        + "".join(f"{t:%Y-%m-%dT%H:%M}Z;{comma(v)};{comma(v + 1)}\n" for t, v in ROWS),
    ),
    "smard": (
        bess.read_prices,
        "Datum von;Datum bis;Deutschland/Luxemburg [€/MWh] Originalauflösungen\n"
        + "".join(
            f"{t:%d.%m.%Y %H:%M};{t + HOUR:%d.%m.%Y %H:%M};{comma(v)}\n"
            for t, v in zip(BERLIN, PRICES, strict=True)
        ),
    ),
    "entsoe old": (
        lambda path: bess.read_prices(path, zone="FI"),
        '"MTU (CET/CEST)","Day-ahead Price [EUR/MWh]","Currency","BZN|FI"\n'
        + "".join(
            f'"{t:%d.%m.%Y %H:%M} - {t + HOUR:%d.%m.%Y %H:%M}","{v:.2f}","EUR"\n'
            for t, v in zip(BERLIN, PRICES, strict=True)
        ),
    ),
    "entsoe new": (
        lambda path: bess.read_prices(path, zone="HU"),
        '"MTU (UTC)","Area","Sequence","Day-ahead (EUR/MWh)"\n'
        + "".join(
            f'"{t:%d/%m/%Y %H:%M:%S} - {t + HOUR:%d/%m/%Y %H:%M:%S}","BZN|HU","Without sequence","{v:.2f}"\n'
            for t, v in zip(HOURS, PRICES, strict=True)
        ),
    ),
    "energinet": (
        lambda path: bess.read_prices(path, zone="DK1"),
        "HourUTC;HourDK;PriceArea;SpotPriceDKK;SpotPriceEUR\n"
        + "".join(
            f"{t:%Y-%m-%d %H:%M};{b:%Y-%m-%d %H:%M};DK1;{comma(v * 7.45)};{comma(v)}\n"
            for t, b, v in reversed(list(zip(HOURS, BERLIN, PRICES, strict=True)))
        ),
    ),
    "station": (
        bess.read_weather,
        "STATIONS_ID;MESS_DATUM;QN_9;TT_TU;RF_TU;eor\n"
        + "".join(f"1078;{t:%Y%m%d%H};3;{v / 10:.1f};80;eor\n" for t, v in zip(HOURS, PRICES, strict=True)),
    ),
    "weather": (
        bess.read_weather,
        "latitude,utc_offset_seconds\n52.5,3600\n\ntime,temperature_2m (°C)\n"
        + "".join(f"{t + HOUR:%Y-%m-%dT%H:%M},{v / 10:.1f}\n" for t, v in zip(HOURS, PRICES, strict=True)),
    ),
    "profile": (
        lambda path: read_profile(path, dt_h=1.0),
        "time,power_kw\n" + "".join(f"{t:%Y-%m-%dT%H:%MZ},{v:.2f}\n" for t, v in ROWS),
    ),
    "json": (
        bess.read_prices,
        '{"unix_seconds": ['
        + ", ".join(str(int(t.timestamp())) for t in HOURS)
        + '], "price": ['
        + ", ".join(f"{v:.2f}" for v in PRICES)
        + '], "unit": "EUR / MWh"}',
    ),
}  # fmt: skip

CELLS_OF_FILES = [
    "", "-", "n/e", "nan", "inf", "1e400", "-1e400", "9" * 400, "1.234,5", "1,234.5", "0x10", "1_000", "١٢",
    "½", "--5", "2024-02-30 00:00", "24:00", "31.03.2024 02:30", "1999", "€", "GBP", '"', "'", ";", ",",
    "\t", "\0", "\ufeff", "=1+1", "a" * 500, "BZN|SE3", "(CET)", "+25:00", "2024-03-30T00:00+99:99", "-999",
]  # fmt: skip


class HangError(Exception):
    """Nothing here computes for twenty seconds."""


def within_seconds(seconds: float, call: Callable[[], Any]) -> Any:
    """In seconds of this process, not of the clock: other tests may run beside it."""

    def ended(number: int, frame: Any) -> None:
        raise HangError

    before = signal.signal(signal.SIGPROF, ended)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        return call()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def outcome(call: Callable[[], Any]) -> Any:
    """What a call gives, or None if it is refused in one sentence; anything else fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return within_seconds(20, call)
        except bess.InputError as error:
            text = str(error)
            assert 10 < len(text) < 2100 and "\n" not in text and "Traceback" not in text
            return None


# --- tables ------------------------------------------------------------------------------------------------


def mutated_table(rng: random.Random, text: str) -> bytes:
    """One to three changes such as hands, programs and broken lines make."""
    lines = text.splitlines(keepends=True)
    for _ in range(rng.randint(1, 3)):
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        how = rng.randrange(12)
        if how == 0:
            lines[i], lines[j] = lines[j], lines[i]
        elif how == 1:
            del lines[i]
        elif how == 2:
            lines.insert(j, lines[i])
        elif how == 3 and len(lines) > 4:
            del lines[min(i, j) : min(i, j) + rng.randint(1, 30)]
        elif how in (4, 5, 6):
            separator = next((s for s in (";", ",") if s in lines[i]), ",")
            cells = lines[i].rstrip("\n").split(separator)
            cells[rng.randrange(len(cells))] = rng.choice(CELLS_OF_FILES)
            lines[i] = separator.join(cells) + "\n"
        elif how == 7:
            lines = [
                line.replace(*rng.choice([(";", ","), (",", ";"), (".", ","), ("-", "/"), (":", ".")]))
                for line in lines
            ]
        elif how == 8:
            lines[0] = "".join(rng.sample(lines[0], len(lines[0])))
        elif how == 9:
            lines = [line.rstrip("\n") + rng.choice([";", ",", ",x", ";0", " "]) + "\n" for line in lines]
        elif how == 10:
            lines[i] = lines[i][: rng.randrange(len(lines[i]) + 1)]
        else:
            lines[0] = lines[0].replace(
                *rng.choice([("EUR", "USD"), ("MWh", "kWh"), ("UTC", "CET"), ("price", "preis_ct")])
            )
        lines = lines or ["\n"]
    raw = "".join(lines).encode(rng.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16"]), errors="replace")
    if rng.random() < 0.1:
        raw = gzip.compress(raw)
    if rng.random() < 0.1:
        raw = raw[: rng.randrange(len(raw) + 1)]
    return raw


def check_series(series: pd.Series, kind: str) -> None:
    """Regular, in UTC, finite, and not much longer than the file."""
    assert series.index.is_monotonic_increasing and series.index.is_unique
    assert str(series.index.tz) == "UTC" and len(np.unique(np.diff(series.index.asi8))) <= 1
    assert np.isfinite(series.to_numpy()).all() and len(series) >= 2, kind
    assert len(series) < 40_000


def try_table(rng: random.Random, folder: Path) -> None:
    kind = rng.choice(sorted(FILES))
    read, text = FILES[kind]
    path = folder / "input"
    path.write_bytes(mutated_table(rng, text))
    series = outcome(lambda: read(path))
    if series is not None:
        check_series(series, kind)


def try_truncated_table(rng: random.Random, folder: Path) -> None:
    """A file cut off anywhere is refused, or what is read is what the whole file holds there."""
    kind = rng.choice(sorted(FILES))
    read, text = FILES[kind]
    path = folder / "input"
    path.write_bytes(text.encode())
    whole = read(path)
    raw = text.encode()
    path.write_bytes(raw[: rng.randrange(len(raw))])
    series = outcome(lambda: read(path))
    if series is not None:
        check_series(series, kind)
        np.testing.assert_allclose(series, whole[series.index], err_msg=kind)


# --- studies and systems -----------------------------------------------------------------------------------

ODD: list[Any] = [
    None, True, False, 0, -1, 1, 2.5, 1e-300, 1e300, 10**400, -(10**400), 2**63, float("inf"), float("nan"),
    "", "x", "../x", "/x", "a\0b", "é" * 300, "x" * 5000, [], [[]], [1, "a"], {}, {"a": {}}, [{}], "equal",
    "mpc", "2024-01-01", "9999-12-31T23:59:59Z", "0001-01-01T00:00:00Z", [0.5], [0.5, 0.5], [0.5] * 1000,
    "reference", "case1", "~", "$HOME",
]  # fmt: skip


def places(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    entries = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in entries:
        yield (*path, key)
        yield from places(value, (*path, key))


def mutated_document(rng: random.Random, document: dict[str, Any]) -> dict[str, Any]:
    document = copy.deepcopy(document)
    for _ in range(rng.randint(1, 4)):
        every = list(places(document))
        if not every:
            break
        *path, last = rng.choice(every)
        node: Any = document
        for part in path:
            node = node[part]
        how = rng.randrange(5)
        if how == 0:
            del node[last]
        elif how == 1 and isinstance(node, dict):
            node["".join(rng.sample(string.ascii_lowercase + "._- ", 4))] = rng.choice(ODD)
        elif how == 2 and type(node[last]) in (int, float) and abs(node[last]) < 1e15:
            node[last] = node[last] * rng.choice([-1, 0, 0.5, 2, 10, 1e3, 1e9, 1e-9])
        elif how == 3 and isinstance(node[last], list) and node[last]:
            node[last] = rng.choice([node[last] * 2, node[last][:-1], node[last][::-1], [node[last]]])
        else:
            node[last] = copy.deepcopy(rng.choice(ODD))
    return document


def try_study(rng: random.Random, folder: Path) -> None:
    document = mutated_document(rng, STUDY)
    study = outcome(lambda: Study.from_document(document, "study"))
    if study is not None:
        outcome(lambda: prepared(study))


def try_study_file(rng: random.Random, folder: Path) -> None:
    import tomli_w

    try:
        text = tomli_w.dumps(mutated_document(rng, STUDY))
    except (TypeError, ValueError):  # None, or an integer with too many digits
        return
    raw = bytearray(text.encode())
    for _ in range(rng.randint(0, 2)):
        i = rng.randrange(len(raw) + 1)
        raw[i : i + rng.randint(0, 5)] = rng.randbytes(rng.randint(0, 3))
    (folder / "study.toml").write_bytes(raw)
    outcome(lambda: prepared(bess.load_study(folder / "study.toml")))


def try_system(rng: random.Random, folder: Path) -> None:
    name = rng.choice(sorted(SYSTEMS))
    document = mutated_document(rng, bess.load_system(name).document)
    system = outcome(lambda: bess.System(document))
    if system is not None and system.n_strings <= 8:
        assert (system.nominal_kw > 0.0).all() and (system.nominal_energy_kwh > 0.0).all()
        state = outcome(lambda: system.initial_state())
        if state is None or outcome(lambda: system.check_state(state) or True) is None:
            return
        plant = outcome(lambda: bess.Plant(system, state))  # refuses plant steps that are unstable
        if plant is None:
            return
        flows = plant.step(0.3 * system.nominal_kw, step_s=60.0 * system.control.step_min)
        assert np.isfinite(flows.delivered_kw).all() and np.isfinite(flows.soc).all()


def try_parameters(rng: random.Random, folder: Path) -> None:
    """Sections of a study put over a bundled system, named components among them."""
    base = tomllib.loads(bess.System.reference().to_toml())
    parameters: dict[str, Any] = {}
    for _ in range(rng.randint(1, 3)):
        section = rng.choice(["battery", "inverter", "derating", "thermal", "control", "string"])
        if section in base and rng.random() < 0.5:
            parameters |= mutated_document(rng, {section: base[section]})
        else:
            key = rng.choice(["cell", "model", "r_scale", "nominal_kw", "x"])
            parameters[section] = {key: rng.choice([*CELLS, *INVERTERS, *ODD])}
    study: dict[str, Any] = {"name": "s", "demand": {"file": "two-cycle-48h"}, "policy": {"name": "soc"}}
    study |= {"run": {"days": 1}, "system": {"file": rng.choice(sorted(SYSTEMS)), "parameters": parameters}}
    made = outcome(lambda: Study.from_document(study, "study"))
    if made is not None:
        outcome(lambda: prepared(made))


# --- arrays ------------------------------------------------------------------------------------------------

SYSTEM = bess.System.reference(2)
STATE = bess.State([0.5, 0.5], [25.0, 25.0])


def odd_array(rng: random.Random, shape: tuple[int, ...]) -> Any:
    generator = np.random.default_rng(rng.randrange(2**32))
    array: Any = generator.uniform(-90.0, 90.0, shape)
    how = rng.randrange(9)
    if how == 0:
        array = array.astype(
            rng.choice([np.float32, np.int16, np.complex128, bool, object, "U8", "M8[s]", "m8[s]"])
        )
    elif how == 1:
        array = generator.uniform(
            -1.0, 1.0, tuple(rng.choice([0, 1, 2, 3, 5]) for _ in range(rng.randint(0, 3)))
        )
    elif how in (2, 3):
        array.ravel()[rng.randrange(array.size)] = rng.choice(
            [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e18, 5e-324]
        )
    elif how == 4:
        array = array.tolist()
        if array:
            array[0] = rng.choice([None, "a", 10**400, [], {}, 1j])
    elif how == 5:
        array = np.asfortranarray(array)[..., ::-1]
    elif how == 6:
        array = rng.choice([None, "x", {}, object(), 10**400, float("nan"), [], 3])
    return array


def try_array(rng: random.Random, folder: Path) -> None:
    plant = bess.Plant(SYSTEM, STATE)
    ambient = rng.choice([25.0, odd_array(rng, (3,))])
    step_s = rng.choice([900.0, 0.0, -1.0, float("nan"), 1e6, 10.0])
    nominal_kw = rng.choice([92.0, 0.0, -1.0, float("nan")])
    calls: list[Callable[[], Any]] = [
        lambda: bess.State(odd_array(rng, (2,)), odd_array(rng, (2,))),
        lambda: plant.step(odd_array(rng, (2,)), step_s=step_s),
        lambda: plant.run(odd_array(rng, (3, 2)), step_s=900.0, ambient_c=ambient),
        lambda: bess.rollout(SYSTEM, STATE, odd_array(rng, (2, 3))),
        lambda: bess.inverter_from_efficiency(
            odd_array(rng, (4,)),
            discharge=odd_array(rng, (4,)),
            nominal_kw=nominal_kw,
        ),
    ]
    outcome(rng.choice(calls))


TRIED: dict[str, tuple[Callable[[random.Random, Path], None], int]] = {
    "tables": (try_table, 250),
    "truncated tables": (try_truncated_table, 150),
    "studies": (try_study, 150),
    "study files": (try_study_file, 100),
    "systems": (try_system, 80),
    "parameters": (try_parameters, 80),
    "arrays": (try_array, 250),
}
"""What is tried, and how often in every run of the tests; the slow ones try twenty times as many."""


@pytest.mark.parametrize("kind", FILES)
def test_what_is_mutated_is_whole(kind: str, tmp_path: Path) -> None:
    read, text = FILES[kind]
    (tmp_path / "input").write_bytes(text.encode())
    series = read(tmp_path / "input")
    assert (series.index == HOURS).all()
    scale = 10.0 if kind in ("station", "weather") else 1.0
    np.testing.assert_allclose(series, np.round(PRICES / scale, 1 if scale > 1.0 else 2))


def run_seeds(kind: str, seeds: range, folder: Path) -> None:
    attempt, _ = TRIED[kind]
    for seed in seeds:
        try:
            attempt(random.Random(f"{kind}-{seed}"), folder)
        except Exception as error:
            raise AssertionError(f"{kind}, seed {seed}: {type(error).__name__}: {error}") from error


@pytest.mark.parametrize("kind", TRIED)
def test_a_mutation_works_or_is_one_sentence(kind: str, tmp_path: Path) -> None:
    run_seeds(kind, range(TRIED[kind][1]), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIED)
def test_thousands_of_mutations_work_or_are_one_sentence(kind: str, tmp_path: Path) -> None:
    run_seeds(kind, range(10_000, 10_000 + 20 * TRIED[kind][1]), tmp_path)
