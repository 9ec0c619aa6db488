"""Property: a mutated study or data file works or is one InputError; no other exception, no warning."""

from __future__ import annotations

import copy
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bess
from bess.control.policies import build_policy
from bess.dispatch import read_profile
from bess.simulation.inputs import prepare
from bess.study import Study, expand
from bess.study.keys import parse_assignment
from bess.study.plant_choice import policy_settings

FEW = settings(max_examples=100, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
MANY = settings(max_examples=5000, deadline=None, suppress_health_check=list(HealthCheck))

STUDY: dict[str, Any] = {
    "name": "s",
    "system": {"file": "reference", "n_strings": 2, "initial_soc": [0.5, 0.4], "parameters": {"battery": {}}},
    "demand": {"kind": "profile", "file": "two-cycle-48h", "repeat": True, "scale": 1.0},
    "weather": {"offset_k": 0.0},
    "policy": {"name": "soc", "horizon_steps": 4, "objectives": {"inverter": 1.0}, "gap": 1e-3},
    "run": {"start": "2024-01-01T00:00:00Z", "days": 1.0, "plant_step_s": 10.0, "derating_law": "table"},
    "output": {"node_temperatures": False},
    "event": [{"string": 0, "start": "2024-01-01T01:00:00Z", "end": "2024-01-01T02:00:00Z", "limit_kw": 5.0}],
    "scenario": [{"name": "A", "set": {"demand.scale": 0.5}}],
    "sweep": [{"key": "policy.horizon_steps", "values": [2, 3]}],
}
TEXT = """name = "s"
[demand]
file = "two-cycle-48h"
repeat = true
[policy]
name = "equal"
objectives = { inverter = 0.5, battery = 0.5 }
[run]
days = 1
[[event]]
string = 0
start = 2024-01-01T01:00:00Z
end = 2024-01-01T02:00:00Z
"""
STAMPS = [f"2024-06-01 {hour:02d}:{minute:02d}" for hour in range(12) for minute in (0, 15, 30, 45)]
PROFILE = "time;power_kw;other\n" + "".join(f"{t};{i % 7 - 3},5;1\n" for i, t in enumerate(STAMPS))
WEATHER = "# station\ntime,temperature_c\n" + "".join(f"{t}Z,{i % 5}.5\n" for i, t in enumerate(STAMPS))
PRICES = "Datum von;Datum bis;Deutschland/Luxemburg [€/MWh] Originalauflösungen\n" + "".join(
    f"01.06.2024 {hour:02d}:00;01.06.2024 {hour + 1:02d}:00;{hour},5\n" for hour in range(23)
)


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    entries = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [p for key, value in entries for p in ((*path, key), *places(value, (*path, key)))]


numbers = st.one_of(
    st.floats(),
    st.integers(-5, 100),
    st.sampled_from([0, -1, 1e-300, 1e300, 10**400, 2**63, 0.25, 96, 97]),
)
hostile = st.one_of(
    numbers,
    st.booleans(),
    st.none(),
    st.text(max_size=6),
    st.sampled_from(
        [
            "equal",
            "none.csv",
            "./",
            "2024-01-01",
            "mpcc",
            "a\0b",
            "[",
            "é" * 300,
            "a.b",
            "9999-12-31T23:59:59Z",
        ]
    ),
    st.lists(numbers, max_size=3),
    st.dictionaries(
        st.sampled_from(["name", "file", "key", "values", "x", "string", "a.b"]), numbers, max_size=3
    ),
)


@st.composite
def studies(draw: st.DrawFn) -> dict[str, Any]:
    document = copy.deepcopy(STUDY)
    for _ in range(draw(st.integers(1, 3))):
        node: Any = document
        *path, last = draw(st.sampled_from(places(STUDY)))
        try:
            for part in path:
                node = node[part]
            how = draw(st.sampled_from(["replace", "delete", "add", "twice"]))
            if how == "delete":
                del node[last]
            elif how == "twice" and isinstance(node[last], list):
                node[last] = node[last] * 2
            elif how == "add" and isinstance(node, dict):
                node[draw(st.sampled_from(["x", "file", "prices", "weight", "", "nam"]))] = draw(hostile)
            else:
                node[last] = draw(hostile)
        except (KeyError, IndexError, TypeError):
            continue  # an earlier mutation took this place away
    return document


def prepared(study: Study) -> None:
    """All that happens before the first step, for runs that are short enough to prepare in a test."""
    runs = expand(study)
    for each in list(runs.values())[:2]:
        if (each.system.n_strings or 0) <= 8 and (each.run.days or 0) <= 40 and each.policy.name != "mpc":
            inputs = prepare(each)
            build_policy(each.policy.name, inputs.system, policy_settings(each, inputs.system))


@st.composite
def broken(draw: st.DrawFn, text: str) -> bytes:
    content = bytearray(text.encode())
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        end = min(len(content), start + draw(st.sampled_from([0, 0, 1, 2, 8, 40, 400])))
        piece = draw(
            st.one_of(
                st.binary(max_size=4),
                st.text("0123456789.,;:-+eEZ \n\t\"'=[]{}nainf", max_size=6).map(str.encode),
                st.just(bytes(content[start : start + 60])),
            )
        )
        content[start:end] = piece
    return bytes(content)


def only_input_errors(call: Callable[[], Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            call()
        except bess.InputError as error:
            message = str(error)
            assert message.strip()


def read(content: bytes, reader: Callable[[Path], Any], suffix: str = ".csv") -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"input{suffix}"
        path.write_bytes(content)
        only_input_errors(lambda: reader(path))


def try_study(document: dict[str, Any]) -> None:
    only_input_errors(lambda: prepared(Study.from_document(document, "study")))


def try_assignment(text: str) -> None:
    only_input_errors(lambda: prepared(bess.load_study("case1", dict([parse_assignment(text)]))))


def try_study_file(content: bytes) -> None:
    read(content, lambda path: prepared(bess.load_study(path)), ".toml")


def try_profile(content: bytes) -> None:
    read(content, lambda path: read_profile(path, column="power_kw", time_zone="Europe/Berlin"))


def try_weather(content: bytes) -> None:
    read(content, bess.read_weather)


def try_prices(content: bytes) -> None:
    read(content, lambda path: bess.read_prices(path, zone="DE-LU", fill="previous"))


assignments = st.builds(
    lambda key, value: f"{key}={value}",
    st.one_of(
        st.sampled_from([".".join(map(str, place)) for place in places(STUDY)]),
        st.text("abcdemo.0_ []", max_size=8),
    ),
    st.one_of(hostile.map(str), hostile.map(repr), st.text(max_size=8)),
)
TRIED: dict[str, tuple[Callable[[Any], None], st.SearchStrategy[Any]]] = {
    "studies": (try_study, studies()),
    "assignments": (try_assignment, assignments),
    "study files": (try_study_file, broken(TEXT)),
    "profiles": (try_profile, broken(PROFILE)),
    "weather": (try_weather, broken(WEATHER)),
    "prices": (try_prices, broken(PRICES)),
}


@pytest.mark.parametrize(
    "text", [PROFILE, WEATHER, PRICES, TEXT], ids=["profile", "weather", "prices", "study"]
)
def test_what_is_mutated_is_valid(text: str, tmp_path: Path) -> None:
    path = tmp_path / "input.toml"
    path.write_bytes(text.encode())
    if text is TEXT:
        prepared(bess.load_study(path))
        prepared(Study.from_document(STUDY, "study"))
    elif text is PROFILE:
        assert len(read_profile(path, column="power_kw", time_zone="Europe/Berlin")) == 48
    elif text is WEATHER:
        assert len(bess.read_weather(path)) == 48
    else:
        assert len(bess.read_prices(path, zone="DE-LU")) == 23


@pytest.mark.parametrize("kind", TRIED)
@FEW
@given(data=st.data())
def test_a_broken_input_is_an_input_error_or_works(kind: str, data: st.DataObject) -> None:
    attempt, strategy = TRIED[kind]
    attempt(data.draw(strategy))


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRIED)
@MANY
@given(data=st.data())
def test_thousands_of_broken_inputs_are_input_errors_or_work(kind: str, data: st.DataObject) -> None:
    attempt, strategy = TRIED[kind]
    attempt(data.draw(strategy))
