"""The table of a sweep: one row for each scenario, as CSV and Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from bess.record.atomic import write_bytes
from bess.study.study import Study
from bess.sweep.task import Outcome

SWEEP_CSV: Final = "sweep.csv"
SWEEP_PARQUET: Final = "sweep.parquet"
RESERVED: Final = ("name", "status", "error")
"""Columns that are neither a parameter (dotted keys of the study) nor a KPI (no dot)."""


def is_parameter(column: str) -> bool:
    """Whether a column holds a swept key of the study."""
    return "." in column


def swept_keys(study: Study) -> list[str]:
    """Dotted keys in which the scenarios of a study differ, in the order of the file."""
    keys: dict[str, None] = {}
    for scenario in study.scenario:
        keys |= dict.fromkeys(scenario.set)
    for axis in study.sweep:
        keys |= dict.fromkeys(axis.simplex or ([axis.key] if axis.key else []))
    return [key for key in keys if is_parameter(key)]


def write_table(
    directory: Path, keys: Iterable[str], studies: Mapping[str, Study], outcomes: Mapping[str, Outcome]
) -> None:
    """Write ``sweep.csv`` and ``sweep.parquet``; scenarios without an outcome are ``open``."""
    import pandas as pd

    keys = list(keys)
    rows: list[dict[str, Any]] = []
    for name, study in studies.items():
        outcome = outcomes.get(name)
        document = study.document()
        row = {
            "name": name,
            "status": outcome.status if outcome else "open",
            "error": outcome.error if outcome else "",
            **{key: _plain(_value(document, key)) for key in keys},
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


def _plain(value: Any) -> Any:
    """Lists and tables as text: a column of a table holds one kind of value."""
    return value if isinstance(value, int | float | str | None) else str(value)
