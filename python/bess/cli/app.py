"""The commands. Everything heavy is imported inside them, so that ``bess --help`` stays fast."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from bess.study import Study

app = typer.Typer(
    name="bess",
    help="Power split control of multi-string battery storage, in closed loop with an electro-thermal plant.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


# Words for shell completion, of which typer offers those that continue the typed text.
def _names_of_studies() -> list[str]:
    from bess.study import bundled_studies

    return list(bundled_studies())


def _keys_of_studies() -> list[str]:
    from bess.study.reference import keys

    return sorted({each.key for each in keys("study") if "*" not in each.key})


def _kinds_of_list() -> list[str]:
    from bess.cli.studies import KINDS

    return list(KINDS)


StudyName = Annotated[
    str,
    typer.Argument(
        metavar="STUDY",
        help="Bundled study (see bess list studies) or TOML file.",
        autocompletion=_names_of_studies,
    ),
]
Out = Annotated[Path | None, typer.Option(metavar="DIR", help="Output folder.")]
Days = Annotated[float | None, typer.Option(help="Length of the run; sets run.days.")]
Assignments = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a key of the study, such as policy.horizon_steps=4.",
        autocompletion=_keys_of_studies,
    ),
]


def _version(asked: bool) -> None:
    if asked:
        from bess import __version__

        print(f"bess {__version__}")
        raise typer.Exit


@app.callback()
def bess(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Handle the options without a command."""


@app.command()
def run(
    study: StudyName,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an unfinished run in DIR.")] = False,
    days: Days = None,
    assignments: Assignments = None,
) -> None:
    """Run a study in closed loop and print its KPIs."""
    from bess.cli.records import kpi_table
    from bess.simulation.runner import run
    from bess.simulation.sweep import run_scenarios

    loaded = _study(study, days, assignments)
    folder = _folder(out, loaded.name, resume)
    if loaded.scenario or loaded.sweep:
        results = run_scenarios(loaded, out=folder, resume=resume)
    else:
        results = {loaded.name: run(loaded, out=folder, resume=resume)}
    print(kpi_table({name: result.kpis for name, result in results.items()}))
    print(f"\nResults are in {folder}; create the report with bess report {_quoted(folder)}.")


@app.command()
def sweep(
    study: StudyName,
    out: Out = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Number of processes of a local Dask cluster.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Address of an existing Dask scheduler.")
    ] = None,
    days: Days = None,
    assignments: Assignments = None,
) -> None:
    """Run all scenarios and sweep points of a study in parallel on Dask; skip finished runs."""
    from bess.errors import BessError, by_reason
    from bess.simulation.sweep import run_sweep

    loaded = _study(study, days, assignments)
    folder = out or Path("results") / loaded.name
    done = run_sweep(loaded, folder, workers=workers, scheduler=scheduler)
    failed = done.failed
    print(
        f"{len(done.outcomes)} runs in {folder}: {len(done.outcomes) - len(failed)} done "
        f"({len(done.skipped)} previously), {len(failed)} failed; report: bess report {_quoted(folder)}"
    )
    if failed:
        raise BessError(f"{len(failed)} of {len(done.outcomes)} runs failed: {'; '.join(by_reason(failed))}")


@app.command()
def report(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of one or more runs, or of bess serve.")
    ],
    hindsight: Annotated[
        bool, typer.Option("--hindsight", help="Also compute the hindsight benchmark and bound.")
    ] = False,
    rules: Annotated[
        bool | None,
        typer.Option(
            "--rules/--no-rules",
            help="Simulate the rules on the same demand; default: for runs up to five weeks.",
        ),
    ] = None,
    print_files: Annotated[
        bool, typer.Option("--print", help="Save every figure as PNG and PDF in addition to SVG.")
    ] = False,
) -> None:
    """Write a self-contained HTML report and figures of a run or of a plant journal."""
    from bess.edge.plant_io.journal import is_journal
    from bess.report import drawing_extra, write_report

    if is_journal(directory):
        with drawing_extra():
            from bess.edge.plant_io.journal_page import write_journal_report
        print(write_journal_report(directory))
    else:
        print(write_report(directory, hindsight=hindsight, rules=rules, print_files=print_files))


@app.command()
def serve(
    study: StudyName,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8080,
    token_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Require the token in FILE from callers; mandatory to control a plant."
        ),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for persistent state; default: results/NAME-service."),
    ] = None,
    plant: Annotated[
        str | None, typer.Option(metavar="openems=URL|sunspec=HOST", help="Control this plant directly.")
    ] = None,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Shadow mode: log set-points, do not write them.")
    ] = False,
    allowed_host: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Additional accepted host name, such as of a proxy; repeatable."),
    ] = None,
    assignments: Assignments = None,
) -> None:
    """Run the controller of a study as an HTTP service, or control a plant directly."""
    from bess.optional_dependencies import extra

    with extra("plant", "bess serve"):
        from bess.edge.serve.run import serve

    loaded = _study(study, None, assignments)
    serve(
        loaded,
        host=host,
        port=port,
        token_file=token_file,
        state=state,
        plant=plant,
        shadow=shadow,
        allowed_hosts=allowed_host or (),
    )


@app.command()
def compare(
    directories: Annotated[
        list[Path],
        typer.Argument(metavar="DIR DIR...", help="Folders of runs, or one folder with several runs."),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the page.")] = Path("comparison"),
) -> None:
    """Compare runs: print their KPIs and write an HTML page with figures."""
    from bess.cli.records import kpi_table, runs_of
    from bess.report import drawing_extra

    runs = runs_of(directories)
    with drawing_extra():
        from bess.report.page import write_comparison
        from bess.report.words.summary import choices, unlike
    if differing := unlike(runs) or choices(runs):
        print(f"{differing}\n")
    print(kpi_table({name: run.kpis for name, run in runs.items()}))
    print(f"\n{write_comparison(runs, out)}")


@app.command()
def export(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of one or more runs.")],
    kind: Annotated[Literal["csv", "parquet"], typer.Option("--format", help="Table format.")] = "csv",
) -> None:
    """Export the time series of a run as a table."""
    from bess.cli.records import export

    for path in export(directory, kind):
        print(path)


@app.command("demo-plant")
def demo_plant(
    study: Annotated[
        str,
        typer.Argument(metavar="[STUDY]", help="Study that defines the plant: bundled study or TOML file."),
    ] = "case1",
    kind: Annotated[
        Literal["openems", "sunspec"], typer.Option("--kind", help="Communication protocol.")
    ] = "openems",
    port: Annotated[
        int | None,
        typer.Option(
            min=1, max=65_535, help="Port to listen on; default: 8084 for OpenEMS, 5020 for SunSpec."
        ),
    ] = None,
    speed: Annotated[float, typer.Option(help="Speed relative to real time.")] = 1.0,
    serve: Annotated[
        bool, typer.Option("--serve", help="Also run the controller and open its live page.")
    ] = False,
) -> None:
    """Simulate a plant with a network interface, for tests of bess serve."""
    from bess.cli.demo import demo_plant, serve_demo

    loaded = _study(study)
    if serve:
        serve_demo(loaded, kind, port, speed, _folder(None, f"{loaded.name}-demo", False))
    else:
        demo_plant(loaded, study, kind, port, speed)


@app.command()
def init(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the study.")] = Path(),
) -> None:
    """Write a commented study file as a starting point."""
    from bess.study.reference import start

    path = start(directory)
    print(f"{path}: written; run it with bess run {_quoted(path)}")


@app.command()
def schema(
    kind: Annotated[Literal["study", "system"], typer.Argument(metavar="study|system", help="File type.")],
) -> None:
    """Print the JSON schema of study or system files, for editor completion."""
    import json

    from bess.study.reference import schema

    print(json.dumps(schema(kind), indent=2, ensure_ascii=False))


@app.command()
def distil(
    study: StudyName,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the controller.")],
    generations: Annotated[
        int | None, typer.Option(min=0, help="Number of generations of the search; default: 150.")
    ] = None,
    days: Days = None,
    assignments: Assignments = None,
) -> None:
    """Train a solver-free controller for a study: policy.json, C99, structured text and a report."""
    from bess.edge.distil import GENERATIONS, distil_runs

    effort = GENERATIONS if generations is None else generations
    for folder in distil_runs(_study(study, days, assignments), out, generations=effort):
        print(
            f"{folder}: policy.json (policy.name=distilled, policy.file={folder / 'policy.json'}), split.c, "
            f"split.h, split.st; {folder / 'report.md'} compares its losses"
        )


@app.command()
def check(study: StudyName, days: Days = None, assignments: Assignments = None) -> None:
    """Validate a study and its data without running it."""
    from bess.cli.studies import findings

    for line in findings(_study(study, days, assignments)):
        print(line)


@app.command("list")
def list_(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KIND] [WORD]...",
            help="Filter: a kind, such as cells, and words that each entry must contain.",
            autocompletion=_kinds_of_list,
        ),
    ] = None,
) -> None:
    """List bundled studies, systems, cells, inverters, wear models and policies."""
    from bess.cli.studies import listing

    print(listing(words or []))


def _study(name: str, days: float | None = None, assignments: list[str] | None = None) -> Study:
    """Load a study with the values of ``--set`` and ``--days``."""
    from bess.study import load_study
    from bess.study.keys import parse_assignment

    values: dict[str, Any] = dict(parse_assignment(text) for text in assignments or [])
    return load_study(name, values if days is None else {**values, "run.days": days})


def _folder(out: Path | None, name: str, resume: bool) -> Path:
    """Return ``--out``, or a new folder."""
    from bess.errors import InputError

    if out is not None:
        if resume and not (out.is_dir() and any(out.iterdir())):
            raise InputError(f"--resume: {out} contains no run to continue; omit --resume to start a new run")
        return out
    if resume:
        raise InputError("--resume: specify the folder of the run with --out")
    folder, number = Path("results") / name, 1
    while folder.exists():
        number += 1
        folder = Path("results") / f"{name}-{number}"
    return folder


def _quoted(path: Path) -> str:
    """Return a path as a shell takes it."""
    return f'"{path}"' if " " in str(path) else str(path)
