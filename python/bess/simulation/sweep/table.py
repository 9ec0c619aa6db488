"""The table of a sweep: one row for each scenario, as CSV and Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from bess.simulation.record.atomic import write_bytes
from bess.simulation.sweep.task import Outcome
from bess.study.study import Study

SWEEP_CSV: Final = "sweep.csv"
SWEEP_PARQUET: Final = "sweep.parquet"
RESERVED: Final = ("name", "status", "error")
"""Columns that are neither parameters (dotted keys of the study) nor KPIs (without a dot)."""


def is_parameter(column: str) -> bool:
    """Whether a column holds a swept key of the study."""
    return "." in column


def swept_keys(study: Study) -> list[str]:
    """Return the dotted keys that differ between the scenarios of a study, in file order."""
    keys: dict[str, None] = {}
    for scenario in study.scenario:
        keys |= dict.fromkeys(scenario.set)
    for axis in study.sweep:
        keys |= dict.fromkeys(axis.simplex or ([axis.key] if axis.key else []))
    return [key for key in keys if is_parameter(key)]


def write_table(
    directory: Path, keys: Iterable[str], studies: Mapping[str, Study], outcomes: Mapping[str, Outcome]
) -> None:
    """Write ``sweep.csv`` and ``sweep.parquet``; scenarios without an outcome are ``open``.

    The table has a column for each of ``keys``. Priorities and tolerances of an objective have own columns if
    they differ between scenarios.
    """
    import pandas as pd

    keys = list(keys)
    documents = [study.document() for study in studies.values()]
    columns = [dict(_columns(document, keys)) for document in documents]
    constant = {key for key in columns[0] if key not in keys and len({row.get(key) for row in columns}) == 1}
    rows: list[dict[str, Any]] = []
    for name, parameters in zip(studies, columns, strict=True):
        outcome = outcomes.get(name)
        row = {
            "name": name,
            "status": outcome.status if outcome else "open",
            "error": outcome.error if outcome else "",
            **{key: value for key, value in parameters.items() if key not in constant},
        }
        rows.append(row | (outcome.kpis if outcome else {}))
    frame = pd.DataFrame(rows)
    write_bytes(directory / SWEEP_CSV, frame.to_csv(index=False).encode())
    buffer = io.BytesIO()
    frame.to_parquet(buffer, index=False)
    write_bytes(directory / SWEEP_PARQUET, buffer.getvalue())


def _value(document: Mapping[str, Any], key: str) -> Any:
    node: Any = document
    for part in key.split("."):
        try:
            node = node[int(part)] if isinstance(node, list | tuple) else node[part]
        except (KeyError, IndexError, TypeError):
            return None
    return node


def _columns(document: Mapping[str, Any], keys: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """Swept values under the keys of the study: a list as text, an objective as its weight, as study files
    have it, with its other values beside it."""
    for key in keys:
        value = _value(document, key)
        if isinstance(value, Mapping) and "weight" in value:
            yield key, value["weight"]
            yield from ((f"{key}.{name}", other) for name, other in value.items() if name != "weight")
        else:
            yield key, value if isinstance(value, int | float | str | None) else str(value)
