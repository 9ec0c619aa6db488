"""Tables of the manual that are made of the code: every key of a study and a system, every key figure.

The build calls :func:`write`; nothing here is typed by hand.
"""

from itertools import groupby
from pathlib import Path

from bess.simulation.analysis.catalogue import CATALOGUE, HEADINGS
from bess.study.reference import KINDS, Key, keys

FOLDER = Path(__file__).parent / "_generated"


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
        parts.append(f"## {f'`{header}`' if header else 'At the top'}\n")
        parts.append("| key | type | default | allowed | meaning |")
        parts.append("| --- | --- | --- | --- | --- |")
        for key in group:
            name = key.key.removeprefix(f"{prefix}.") if prefix else key.key
            allowed = f"{_code(key.allowed)} {key.unit}".strip()
            cells = (f"`{name}`", key.type, _code(key.default), allowed, key.meaning)
            parts.append("| " + " | ".join(cell.replace("|", "\\|") or " " for cell in cells) + " |")
        parts.append("")
    return "\n".join(parts)


def figure_tables() -> str:
    """One table for each group of key figures."""
    better = {"max": "more", "min": "less", None: ""}
    parts = []
    for group, heading in HEADINGS.items():
        parts += [
            f"## {heading}\n",
            "| name | shown as | unit | better | meaning |",
            "| --- | --- | --- | --- | --- |",
        ]
        for name, kpi in CATALOGUE.items():
            if kpi.group == group:
                parts.append(
                    f"| `{name}` | {kpi.label} | {kpi.unit} | {better[kpi.better]} | {kpi.meaning} |"
                )
        parts.append("")
    return "\n".join(parts)


def _code(text: str) -> str:
    return text if text in ("", "required", "name of the file") else f"`{text}`"
