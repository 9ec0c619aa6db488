"""One self-contained HTML page, and the figures beside it."""

from __future__ import annotations

import base64
import hashlib
import json
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bess import __version__
from bess.record.atomic import write_bytes
from bess.report.chart import Chart
from bess.report.contents import MOST_COMPARED, MOST_DETAILED, Exhibit, comparison, details
from bess.report.interactive import plotly_figure
from bess.report.paper import comparisons, is_case_2, reading
from bess.report.runs import Run, runs_in
from bess.report.style import save_figure
from bess.report.sweep_table import SweepTable, read_sweep
from bess.report.tables import kpi_rows, other_rows
from bess.report.words import summary, warnings

REPORT = "report.html"
FIGURES = "figures"
_REM_PER_INCH = 6.4
_PACKAGES = ("numpy", "clarabel", "cvxpy", "xarray", "matplotlib", "plotly")


@dataclass(frozen=True)
class Shown:
    """A figure on the page."""

    id: str
    title: str
    caption: str
    svg: str
    spec: str
    width_rem: float


@dataclass(frozen=True)
class Section:
    """A heading and its figures."""

    id: str
    title: str
    figures: list[Shown]


def write_report(directory: str | Path) -> Path:
    """Write ``report.html`` and ``figures/`` for a run, a set of scenarios, or a sweep.

    The page needs no network and no other file. Unfinished runs are shown as far as they got, and said to be.

    Parameters
    ----------
    directory
        ``--out`` of ``bess run`` or ``bess sweep``.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If there is no run to show.
    """
    directory = Path(directory)
    runs, problems = runs_in(directory)
    sweep = read_sweep(directory)
    few = len(runs) <= MOST_COMPARED
    folder = directory / FIGURES
    sections = []
    if sweep is not None:
        problems |= sweep.failed
        sections.append(_section("front", "The sweep", sweep.exhibits(), folder, ""))
    if few:
        sections.append(_section("comparison", "Overview", comparison(runs), folder, ""))
    if len(runs) <= MOST_DETAILED:
        for name, run in runs.items():
            title = "The run" if len(runs) == 1 else f"Scenario {name}"
            prefix = "" if len(runs) == 1 else f"{name}-"
            sections.append(_section(f"run-{name}", title, details(run), folder, prefix))
    page = _render(directory, runs, problems, sweep, [section for section in sections if section.figures])
    path = directory / REPORT
    write_bytes(path, page.encode())
    return path


def _section(id_: str, title: str, exhibits: Iterable[Exhibit], folder: Path, prefix: str) -> Section:
    return Section(id_, title, [_show(exhibit, folder, prefix) for exhibit in exhibits])


def _show(exhibit: Exhibit, folder: Path, prefix: str) -> Shown:
    figure, chart = exhibit.drawn()
    svg, _ = save_figure(figure, folder / f"{prefix}{exhibit.name}.svg")
    return Shown(
        id=prefix + exhibit.name,
        title=exhibit.title,
        caption=exhibit.caption,
        svg=base64.b64encode(svg.read_bytes()).decode(),
        spec="" if chart is None else _json(chart),
        width_rem=round(_REM_PER_INCH * figure.get_figwidth(), 1),
    )


def _json(chart: Chart) -> str:
    # "</" would end the script element that holds the data, "<!--" change how it is read.
    text = json.dumps(plotly_figure(chart), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _security_policy(scripts: list[str]) -> str:
    """What the page may load and run: nothing but these scripts, its own styles and its own pictures."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{text}'" for text in hashes)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _render(
    directory: Path,
    runs: dict[str, Run],
    problems: dict[str, str],
    sweep: SweepTable | None,
    sections: list[Section],
) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from plotly.offline import get_plotlyjs

    environment = Environment(
        loader=PackageLoader("bess.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    drawn = any(figure.spec for section in sections for figure in section.figures)
    scripts = [*([get_plotlyjs()] if drawn else []), environment.get_template("report.js").render()]
    first = next(iter(runs.values()))
    kpis = {name: run.kpis for name, run in runs.items()}
    if sweep is not None and sweep.kpis:
        kpis = {name: sweep.kpis[name] for name in sweep.kpis}
    paper = comparisons(kpis) if is_case_2(runs) else []
    values: dict[str, Any] = {
        "title": _title(directory),
        "summary": summary(runs) if len(runs) <= MOST_COMPARED else [],
        "front": sweep.front_sentence() if sweep is not None else "",
        "warnings": warnings(runs, problems),
        "names": list(kpis),
        "tall": len(kpis) > MOST_COMPARED,
        "kpi_rows": kpi_rows(kpis),
        "other_rows": other_rows(kpis),
        "parameters": sweep.parameters if sweep is not None else {},
        "paper": paper,
        "reading": reading(paper) if paper else [],
        "sections": sections,
        "studies": _studies(directory, runs),
        "version": first.identity["version"],
        "report_version": __version__,
        "packages": {name: version(name) for name in _PACKAGES},
        "scripts": scripts,
        "policy": _security_policy(scripts),
    }
    return environment.get_template("report.html.j2").render(values)


def _title(directory: Path) -> str:
    """Title of the study that the folder was made from, else the name of the folder."""
    try:
        study = tomllib.loads((directory / "study.toml").read_text(encoding="utf-8"))
    except (FileNotFoundError, tomllib.TOMLDecodeError):
        study = {}
    return str(study.get("title") or study.get("name") or directory.resolve().name)


def _studies(directory: Path, runs: dict[str, Run]) -> dict[str, str]:
    """Studies to print: that of every run, or of many the one they were made from."""
    if len(runs) <= MOST_DETAILED or not (directory / "study.toml").exists():
        return {name: run.study_toml for name, run in list(runs.items())[:MOST_DETAILED]}
    return {"The study of all scenarios": (directory / "study.toml").read_text(encoding="utf-8")}
