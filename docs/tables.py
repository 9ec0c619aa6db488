"""Tables of the manual, generated from the code: every key of a study and a system, and every KPI.

The build calls :func:`write`. The scripts beside this module use its functions for their tables and figures.
"""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from bess.report.drawing.style import save_svg
from bess.simulation.analysis.catalogue import CATALOGUE, HEADINGS
from bess.study.reference import KINDS, Key, keys

DOCS = Path(__file__).parent
FOLDER = DOCS / "_generated"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; the first row is its head."""
    head, *body = ("| " + " | ".join(row) + " |\n" for row in rows)
    return "".join([head, "|" + " --- |" * len(rows[0]) + "\n", *body])


def save_picture(figure: Figure, name: str) -> None:
    """Save a figure of a page."""
    path = DOCS / "_static" / f"{name}.svg"
    save_svg(figure, path)
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


def write() -> None:
    """Write all tables."""
    FOLDER.mkdir(exist_ok=True)
    for kind in KINDS:
        (FOLDER / f"{kind}-keys.md").write_text(key_tables(keys(kind)), encoding="utf-8")
    (FOLDER / "key-figures.md").write_text(figure_tables(), encoding="utf-8")


def key_tables(listed: list[Key]) -> str:
    """One table for each section."""
    parts = []
    for header, group in groupby(listed, key=lambda key: key.section):
        prefix = header.partition(" ")[0].strip("[]")
        rows = [["key", "type", "default", "allowed", "meaning"]]
        for key in group:
            name = key.key.removeprefix(f"{prefix}.") if prefix else key.key
            allowed = f"{_code(key.allowed)} {key.unit}".strip()
            cells = (f"`{name}`", key.type, _code(key.default), allowed, key.meaning)
            rows.append([cell.replace("|", "\\|") or " " for cell in cells])
        parts.append(f"## {f'`{header}`' if header else 'At the top'}\n\n{markdown_table(rows)}")
    return "\n".join(parts)


def figure_tables() -> str:
    """One table for each group of key figures."""
    better = {"max": "more", "min": "less", None: ""}
    parts = []
    for group, heading in HEADINGS.items():
        rows = [["name", "shown as", "unit", "better", "meaning"]]
        rows += [
            [f"`{name}`", kpi.label, kpi.unit, better[kpi.better], kpi.meaning]
            for name, kpi in CATALOGUE.items()
            if kpi.group == group
        ]
        parts.append(f"## {heading}\n\n{markdown_table(rows)}")
    return "\n".join(parts)


def _code(text: str) -> str:
    return text if text in ("", "required", "name of the file") else f"`{text}`"
