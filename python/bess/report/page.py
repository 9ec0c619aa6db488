"""One self-contained HTML page, and the figures beside it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bess import __version__
from bess.errors import InputError, option
from bess.files import parse_toml
from bess.record.atomic import write_bytes
from bess.record.identity import IDENTITY
from bess.report.contents import MOST_COMPARED, Exhibit, comparison, optimiser, over_time, overview
from bess.report.drawing.interactive import LegendEntry, bokeh_document, bokeh_script, legend
from bess.report.drawing.style import save_figure
from bess.report.runs import Run, runs_in
from bess.report.security import content_policy
from bess.report.sweep_table import SweepTable, read_sweep
from bess.report.words.headline import tiles
from bess.report.words.paper import comparisons, is_case_2, reading
from bess.report.words.summary import subject, summary, warnings
from bess.report.words.tables import decision_table, kpi_groups
from bess.report.words.unlike import unlike

REPORT = "report.html"
FIGURES = "figures"
_REM_PER_INCH = 6.4
_PACKAGES = ("numpy", "clarabel", "xarray", "matplotlib", "bokeh")


@dataclass(frozen=True)
class PageFigure:
    """A figure on the page."""

    id: str
    title: str
    caption: str
    svg: str
    spec: str
    legend: tuple[LegendEntry, ...]
    width_rem: float


@dataclass(frozen=True)
class PageSection:
    """A heading and its figures."""

    id: str
    title: str
    figures: list[PageFigure]


def write_pages(directory: Path, *, hindsight: bool) -> Path:
    """Write the pages of :func:`bess.write_report`; return that of the folder."""
    runs, problems = runs_in(directory)
    if len(runs) == 1 and (directory / IDENTITY).exists():
        (run,) = runs.values()
        return _run_page(directory, run, problems, hindsight=hindsight)
    sweep = read_sweep(directory)
    if len(runs) <= MOST_COMPARED:
        for run in runs.values():
            _run_page(run.directory, run, {}, within=_title(directory), hindsight=hindsight)
    return _comparison_page(directory, runs, problems, sweep, hindsight=hindsight)


def write_comparison(runs: dict[str, Run], directory: Path) -> Path:
    """Write a page that sets runs of any folders side by side, and leads to those that have a page.

    Parameters
    ----------
    runs
        By the name to show.
    directory
        Folder for the page and its figures.

    Raises
    ------
    InputError
        If the folder holds a run, or cannot be made.
    """
    if (directory / IDENTITY).exists():
        raise InputError(f"{directory}: holds a run itself; use another {option('out')} for the comparison")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{directory}: cannot be made ({error.strerror}); use another {option('out')}"
        ) from error
    return _comparison_page(directory, runs, {}, None, title="Comparison of " + ", ".join(runs))


def _run_page(
    directory: Path, run: Run, problems: dict[str, str], within: str = "", *, hindsight: bool = False
) -> Path:
    folder = directory / FIGURES
    sections = [
        section("overview", "Overview", overview(run), folder),
        section("time", "Over time", over_time(run), folder),
        section("optimiser", "Optimiser", optimiser(run), folder),
    ]
    one = {run.name: run}
    values = {
        "title": run.name if within else _title(directory),
        "within": within,
        "subject": subject(one),
        "summary": [*summary(one, hindsight=hindsight), *([_hindsight(run)] if hindsight else [])],
        "tiles": tiles(run.kpis),
        "warnings": warnings(one, problems),
        "sections": sections,
        "groups": kpi_groups({"": run.kpis}),
        "names": [""],
        "studies": {run.name: run.study_toml},
        "made_with": run.identity["version"],
    }
    return write_page(directory, values)


def _hindsight(run: Run) -> str:
    from bess.retrospect import hindsight  # loads the solver, which no other page needs

    return str(hindsight(run.dataset))


def _comparison_page(
    directory: Path,
    runs: dict[str, Run],
    problems: dict[str, str],
    sweep: SweepTable | None,
    title: str = "",
    *,
    hindsight: bool = False,
) -> Path:
    folder = directory / FIGURES
    few = 1 < len(runs) <= MOST_COMPARED
    sections = []
    if sweep is not None:
        problems = problems | sweep.failed
        sections.append(section("front", "The sweep", sweep.exhibits(), folder))
    if few:
        sections.append(section("comparison", "Side by side", comparison(runs), folder))
    kpis = sweep.kpis if sweep is not None and sweep.kpis else {name: run.kpis for name, run in runs.items()}
    differing = unlike(runs)
    paper = comparisons(kpis) if is_case_2(runs) else []
    values = {
        "title": title or _title(directory),
        "subject": subject(runs),
        "summary": summary(runs, hindsight=hindsight) if few else [differing] if differing else [],
        "front": sweep.front_sentence() if sweep is not None else "",
        "decision": decision_table(kpis, alike=not differing),
        "links": {name: _link(directory, run) for name, run in runs.items()},
        "warnings": warnings(runs, problems),
        "paper": paper,
        "reading": reading(paper) if paper else [],
        "sections": sections,
        "groups": kpi_groups(kpis, alike=not differing) if len(kpis) <= MOST_COMPARED else [],
        "names": list(kpis),
        "alike": not differing,
        "table_beside": sweep is not None,
        "studies": _studies(directory, runs),
        "made_with": next(iter(runs.values())).identity["version"],
    }
    return write_page(directory, values)


def section(id_: str, title: str, exhibits: Iterable[Exhibit], folder: Path) -> PageSection:
    """Return a section with its figures, which are saved into ``folder`` as well."""
    return PageSection(id_, title, [_show(exhibit, folder) for exhibit in exhibits])


def _show(exhibit: Exhibit, folder: Path) -> PageFigure:
    figure, chart = exhibit.drawn()
    svg, *_ = save_figure(figure, folder / f"{exhibit.name}.svg")
    # "</" would end the script element that holds the data, "<!--" change how it is read.
    spec = "" if chart is None else bokeh_document(chart).replace("<", "\\u003c")
    return PageFigure(
        id=exhibit.name,
        title=exhibit.title,
        caption=exhibit.caption,
        svg=_embedded(svg.read_text(encoding="utf-8")),
        spec=spec,
        legend=() if chart is None else tuple(legend(chart)),
        width_rem=round(_REM_PER_INCH * figure.get_figwidth(), 1),
    )


def _embedded(svg: str) -> str:
    """A picture as the address of an image; a quarter shorter than in base 64."""
    single = svg.replace("'", "&quot;").replace('"', "'")
    return "data:image/svg+xml," + quote(single, safe=" '/:;,.=+-()!*?@$&[]{}|~\n")


def write_page(directory: Path, values: dict[str, Any]) -> Path:
    """Write the page of the template; values that only some pages have may be missing."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("bess.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    sections = [section for section in values["sections"] if section.figures]
    drawn = any(figure.spec for section in sections for figure in section.figures)
    scripts = [*([bokeh_script()] if drawn else []), environment.get_template("report.js").render()]
    nothing: dict[str, Any] = {
        "within": "", "front": "", "tiles": [], "decision": None, "links": {}, "paper": [], "reading": [],
        "alike": False,
        "table_beside": False,
    }  # fmt: skip
    page = environment.get_template("report.html.j2").render(
        nothing
        | values
        | {
            "sections": sections,
            "report_version": __version__,
            "packages": {name: version(name) for name in _PACKAGES},
            "scripts": scripts,
            "policy": content_policy(scripts),
        }
    )
    path = directory / REPORT
    write_bytes(path, page.encode())
    return path


def _link(directory: Path, run: Run) -> str:
    """Where the page of a run is from here; nothing if it has none."""
    page = run.directory / REPORT
    if not page.exists():
        return ""
    return Path(os.path.relpath(page, directory)).as_posix()


def _title(directory: Path) -> str:
    """Title of the study that the folder was made from, else the name of the folder."""
    try:
        study = parse_toml((directory / "study.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        study = {}
    return str(study.get("title") or study.get("name") or directory.resolve().name)


def _studies(directory: Path, runs: dict[str, Run]) -> dict[str, str]:
    """The study that all runs were made from, or that of each if there is no such file."""
    path = directory / "study.toml"
    if path.exists():
        return {"The study of all scenarios": path.read_text(encoding="utf-8", errors="replace")}
    return {name: run.study_toml for name, run in list(runs.items())[:MOST_COMPARED]}
