"""Property: a mutated system file is a valid system or one InputError, never another exception."""

from __future__ import annotations

import copy
import datetime
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bess

REFERENCE = bess.System.reference().document


def _places(table: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every key and every list element of a document."""
    keys = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    return [p for key, value in keys for p in ((*path, key), *_places(value, (*path, key)))]


numbers = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.integers(),
    st.sampled_from([0, -1, 1, 2, 1e-300, 1e300, -0.0, 10**400, 2**64, 0.5, 1.5, 1e6, 10_000]),
)
hostile = st.one_of(
    numbers,
    st.booleans(),
    st.text(max_size=8),
    st.none(),
    st.just(datetime.date(2024, 1, 1)),
    st.just(1j),
    st.just(b"x"),
    st.lists(numbers, max_size=4),
    st.lists(st.lists(numbers, max_size=3), max_size=3),
    st.dictionaries(st.text(max_size=5), numbers, max_size=3),
    st.recursive(st.just(1.0), lambda inner: st.lists(inner, min_size=1, max_size=1), max_leaves=3),
)
place = st.sampled_from(
    [*_places(REFERENCE), ("string",), ("battery", "cell"), ("inverter", "model"), ("x",)]
)
change = st.tuples(place, st.sampled_from(["replace", "delete", "append", "reverse", "scale"]), hostile)


def _mutate(document: Any, path: tuple[Any, ...], kind: str, value: Any) -> None:
    *parents, key = path
    for parent in parents:
        try:
            document = document[parent]
        except (KeyError, IndexError, TypeError):
            return  # an earlier mutation took this place away
    if isinstance(document, list) and not (isinstance(key, int) and key < len(document)):
        return
    if not isinstance(document, list | dict):
        return
    old = document[key] if isinstance(document, list) else document.get(key)
    if kind == "delete":
        document.pop(key) if isinstance(document, list) else document.pop(key, None)
    elif kind == "append" and isinstance(old, list):
        old.append(value)
    elif kind == "reverse" and isinstance(old, list):
        old.reverse()
    elif kind == "scale" and isinstance(old, float) and isinstance(value, float):
        document[key] = old * value
    else:
        document[key] = value


@settings(max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(change, min_size=1, max_size=3))
def test_a_mutated_document_is_a_system_or_one_input_error(changes: list[tuple[Any, str, Any]]) -> None:
    document = copy.deepcopy(REFERENCE)
    for path, kind, value in changes:
        _mutate(document, path, kind, value)
    try:
        system = bess.System(document, name="plant.toml")
    except bess.InputError as error:
        message = str(error)
        assert message.startswith("plant.toml: ")
        assert "\n" not in message.replace("\\n", "")
        assert len(message) < 2000
    else:
        assert math.isfinite(float(system.nominal_energy_kwh.sum()))
        assert all(
            b > a for s in system.strings for a, b in zip(s.inverter.load, s.inverter.load[1:], strict=False)
        )


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.binary(max_size=60))
def test_any_bytes_are_a_system_file_or_one_input_error(tmp_path_factory: Any, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "plant.toml"
    path.write_bytes(content)
    with pytest.raises(bess.InputError, match=r"plant\.toml"):
        bess.load_system(path)


@pytest.mark.parametrize(
    "text", ["a = " + "[" * 5000, "a" + ".a" * 4000 + " = 1", "a = " + "[" * 40 + "]" * 40]
)
def test_deep_nesting_is_refused_in_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(text)
    with pytest.raises(bess.InputError, match=r"deep\.toml"):
        bess.load_system(path)
