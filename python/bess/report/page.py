"""One self-contained HTML page, and the figures beside it."""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bess import __version__
from bess.errors import BessError, InputError
from bess.files import parse_toml
from bess.report.contents import (
    MAX_COMPARED_RUNS,
    FigureSpec,
    comparison,
    first_screen,
    optimiser,
    over_time,
    overview,
)
from bess.report.drawing.chart import Chart, draw
from bess.report.drawing.interactive import LegendEntry, bokeh_document, bokeh_script, legend
from bess.report.drawing.style import save_figure, save_svg
from bess.report.runs import Run, runs_in
from bess.report.words.headline import limit_sentences, tiles
from bess.report.words.paper import comparisons, is_case_2, reading
from bess.report.words.summary import choices, gain_sentence, subject, summary, unlike, warnings
from bess.report.words.tables import SweepTable, decision_table, kpi_groups, read_sweep
from bess.simulation.record.files import REPEAT, make_folder, write_bytes
from bess.simulation.record.provenance import IDENTITY

REPORT = "report.html"
FIGURES = "figures"
_REM_PER_INCH = 6.4
_STEPS_WITH_RULES = 5 * 7 * 96
"""Longest run for which the rules are simulated by default: five weeks of quarter-hours."""
_PACKAGES = ("numpy", "clarabel", "xarray", "matplotlib", "bokeh")


@dataclass(frozen=True)
class Options:
    """Options of a page and its files, as in :func:`bess.write_report`."""

    hindsight: bool = False
    rules: bool | None = None
    print_files: bool = False


@dataclass(frozen=True)
class PageFigure:
    """A figure on the page: its description, drawing, and interactive chart (``spec``), if any."""

    about: FigureSpec
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


def write_pages(directory: Path, options: Options) -> Path:
    """Write the pages of :func:`bess.write_report`; return that of the folder."""
    runs, problems = runs_in(directory)
    if len(runs) == 1 and (directory / IDENTITY).exists():
        return _run_page(next(iter(runs.values())), problems, options)
    sweep = read_sweep(directory)
    if len(runs) <= MAX_COMPARED_RUNS:
        for run in runs.values():
            _run_page(run, {}, options, within=_title(directory))
    return _comparison_page(directory, runs, problems, sweep, options)


def write_comparison(runs: dict[str, Run], directory: Path) -> Path:
    """Write a page that compares runs of any folders, with links to their pages.

    Parameters
    ----------
    runs
        Runs by displayed name.
    directory
        Folder for the page and its figures.
    """
    if (directory / IDENTITY).exists():
        raise InputError(f"{directory}: holds a run itself; use another output folder for the comparison")
    make_folder(directory)
    return _comparison_page(directory, runs, {}, None, Options(), title="Comparison of " + ", ".join(runs))


def _run_page(run: Run, problems: dict[str, str], options: Options, within: str = "") -> Path:
    if options.rules or (options.rules is None and run.dataset.sizes["time"] <= _STEPS_WITH_RULES):
        try:
            run.run_rules()
        except BessError as error:
            problems = problems | {"the rules on the same demand": str(error)}
    hindsight = []
    if options.hindsight:
        from bess.simulation.hindsight.best_known import benchmark  # loads the solver, only needed here

        hindsight = [str(benchmark(run.replay))]
    shown = partial(section, folder=run.directory / FIGURES, print_files=options.print_files)
    one = {run.name: run}
    values = {
        "title": run.name if within else _title(run.directory),
        "within": within,
        "subject": subject(one),
        "lead": gain_sentence(run),
        "limits": limit_sentences(run),
        "beside": shown("flow", "", first_screen(run)).figures,
        "summary": hindsight + summary(one, hindsight=options.hindsight),
        "tiles": tiles(run),
        "warnings": warnings(one, problems),
        "sections": [
            shown("overview", "Overview", overview(run)),
            shown("time", "Over time", over_time(run)),
            shown("optimiser", "Optimiser", optimiser(run)),
        ],
        "groups": kpi_groups({"": run.kpis}),
        "names": [""],
        "studies": {run.name: run.study_toml},
        "made_with": run.identity["version"],
    }
    return write_page(run.directory, values)


def _comparison_page(
    directory: Path,
    runs: dict[str, Run],
    problems: dict[str, str],
    sweep: SweepTable | None,
    options: Options,
    title: str = "",
) -> Path:
    shown = partial(section, folder=directory / FIGURES, print_files=options.print_files)
    few = 1 < len(runs) <= MAX_COMPARED_RUNS
    sections = []
    if sweep is not None:
        problems = problems | sweep.failed
        sections.append(shown("front", "The sweep", sweep.exhibits()))
    if few:
        sections.append(shown("comparison", "Side by side", comparison(runs)))
    kpis = sweep.kpis if sweep is not None and sweep.kpis else {name: run.kpis for name, run in runs.items()}
    differing = unlike(runs)
    paper = comparisons(kpis) if is_case_2(runs) else []
    values = {
        "title": title or _title(directory),
        "subject": subject(runs, alike=not differing),
        "summary": summary(runs, hindsight=options.hindsight) if few else [],
        "lead": (sweep.front_sentence() if sweep is not None else "") or differing or choices(runs),
        "picks": sweep.picks() if sweep is not None else None,
        "decision": decision_table(kpis, alike=not differing),
        "links": {name: _link(directory, run) for name, run in runs.items()},
        "warnings": warnings(runs, problems),
        "paper": paper,
        "reading": reading(paper) if paper else [],
        "sections": sections,
        "groups": kpi_groups(kpis, alike=not differing) if len(kpis) <= MAX_COMPARED_RUNS else {},
        "names": list(kpis),
        "alike": not differing,
        "table_beside": sweep is not None,
        "studies": _studies(directory, runs),
        "made_with": next(iter(runs.values())).identity["version"],
    }
    return write_page(directory, values)


def section(
    id_: str, title: str, exhibits: Iterable[FigureSpec], folder: Path, *, print_files: bool = False
) -> PageSection:
    """Return a section with its figures, which are saved into ``folder`` as well."""
    return PageSection(id_, title, [_show(exhibit, folder, print_files) for exhibit in exhibits])


def _show(exhibit: FigureSpec, folder: Path, print_files: bool) -> PageFigure:
    made = exhibit.make()
    figure, chart = (draw(made), made) if isinstance(made, Chart) else (made, None)
    path = folder / f"{exhibit.name}.svg"
    svg = save_figure(figure, path)[0].read_text(encoding="utf-8") if print_files else save_svg(figure, path)
    # "</" would end the script element that holds the data, "<!--" change how it is read.
    spec = "" if chart is None else bokeh_document(chart).replace("<", "\\u003c")
    return PageFigure(
        about=exhibit,
        svg=_embedded(svg),
        spec=spec,
        legend=() if chart is None else tuple(legend(chart)),
        width_rem=round(_REM_PER_INCH * figure.get_figwidth(), 1),
    )


def _embedded(svg: str) -> str:
    """Return a picture as a data URL; a quarter shorter than in base 64."""
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
        "within": "", "lead": "", "limits": [], "beside": [], "picks": None, "tiles": [], "decision": None,
        "links": {}, "paper": [], "reading": [], "alike": False, "table_beside": False,
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
    write_bytes(path, page.encode(), REPEAT)
    return path


def _link(directory: Path, run: Run) -> str:
    """Relative path of the page of a run; empty if it has none."""
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
    return {name: run.study_toml for name, run in list(runs.items())[:MAX_COMPARED_RUNS]}


def content_policy(scripts: Iterable[str]) -> str:
    """Content policy: only these scripts (by hash), styles of the page itself, and embedded pictures."""
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{text}'" for text in hashes)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
