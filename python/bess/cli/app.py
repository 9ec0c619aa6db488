"""The commands. Everything heavy is imported inside them, so that ``bess --help`` stays fast."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(
    name="bess",
    help="Power split control of multi-string battery storage, in closed loop with an electro-thermal plant.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


class Format(StrEnum):
    """Kinds of table that ``bess export`` writes."""

    CSV = "csv"
    PARQUET = "parquet"


class PlantKind(StrEnum):
    """Kinds of plant that ``bess demo-plant`` simulates."""

    OPENEMS = "openems"
    SUNSPEC = "sunspec"


class Kind(StrEnum):
    """Kinds of file that ``bess schema`` describes."""

    STUDY = "study"
    SYSTEM = "system"


StudyName = Annotated[
    str, typer.Argument(metavar="STUDY", help="Bundled study (see bess list) or a TOML file.")
]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Folder for the results.")]
Days = Annotated[float | None, typer.Option("--days", help="Length of the run; sets run.days.")]
Assignments = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Set a key of the study, such as policy.horizon_steps=4."
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
    """Take the options that belong to no command."""


@app.command()
def run(
    study: StudyName,
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue an unfinished run in DIR.")] = False,
    days: Days = None,
    assignments: Assignments = None,
) -> None:
    """Run a study in closed loop and print its key figures."""
    from bess.cli.kpi_table import kpi_table
    from bess.simulation import run, run_scenarios
    from bess.study import load_study

    loaded = load_study(study, _values(days, assignments))
    folder = _folder(out, loaded.name, resume)
    if loaded.scenario or loaded.sweep:
        results = run_scenarios(loaded, out=folder, resume=resume)
    else:
        results = {loaded.name: run(loaded, out=folder, resume=resume)}
    print(kpi_table({name: result.kpis for name, result in results.items()}))
    print(f"\nResults are in {folder}; bess report {folder} draws them.")


@app.command()
def sweep(
    study: StudyName,
    out: Out = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes of a local Dask cluster.")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="An existing Dask scheduler.")
    ] = None,
    days: Days = None,
    assignments: Assignments = None,
) -> None:
    """Run all scenarios and sweep points of a study side by side on Dask; finished ones are skipped."""
    from bess.errors import BessError, by_reason
    from bess.study import load_study
    from bess.sweep import run_sweep

    loaded = load_study(study, _values(days, assignments))
    folder = out or Path("results") / loaded.name
    done = run_sweep(loaded, folder, workers=workers, scheduler=scheduler)
    failed = done.failed
    print(
        f"{len(done.outcomes)} runs in {folder}: {len(done.outcomes) - len(failed)} done "
        f"({len(done.skipped)} of them before), {len(failed)} failed; bess report {folder} draws them."
    )
    if failed:
        raise BessError(f"{len(failed)} of {len(done.outcomes)} runs failed: {'; '.join(by_reason(failed))}")


@app.command()
def report(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a run or of several, or of bess serve.")
    ],
    hindsight: Annotated[
        bool, typer.Option("--hindsight", help="Say what was possible as well: seconds for a week.")
    ] = False,
) -> None:
    """Draw the figures of a run, or of a plant's journal, and write a self-contained HTML page."""
    from bess.plants.journal import is_journal
    from bess.report import drawing_extra, write_report

    if is_journal(directory):
        with drawing_extra():
            from bess.plants.journal_page import write_journal_report
        print(write_journal_report(directory))
    else:
        print(write_report(directory, hindsight=hindsight))


@app.command()
def serve(
    study: StudyName,
    host: Annotated[str, typer.Option("--host", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Port to listen on.")] = 8080,
    token_file: Annotated[
        Path | None,
        typer.Option(
            "--token-file", metavar="FILE", help="Ask callers for the token in FILE; a plant needs one."
        ),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(
            "--state", metavar="DIR", help="Folder for what survives a restart; results/NAME-service."
        ),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            "--plant", metavar="openems=URL|sunspec=HOST", help="Drive this plant instead of being called."
        ),
    ] = None,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Watch the plant and recommend; write nothing.")
    ] = False,
    allowed_host: Annotated[
        list[str] | None,
        typer.Option(
            "--allowed-host", metavar="NAME", help="Answer to this name too, as that of a proxy; repeatable."
        ),
    ] = None,
    assignments: Assignments = None,
) -> None:
    """Run the controller of a study as a service that a plant can call over HTTP."""
    from bess.serve.run import serve
    from bess.study import load_study

    loaded = load_study(study, _values(None, assignments))
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
        list[Path], typer.Argument(metavar="DIR DIR...", help="Folders of runs, or one of several.")
    ],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the page.")] = Path(
        "comparison"
    ),
) -> None:
    """Set runs side by side: their key figures here, figures and a page in a folder."""
    from bess.cli.comparing import runs_of
    from bess.cli.kpi_table import kpi_table
    from bess.report import drawing_extra
    from bess.report.words.unlike import unlike

    with drawing_extra():
        from bess.report.page import write_comparison

    runs = runs_of(directories)
    if differing := unlike(runs):
        print(f"{differing}\n")
    print(kpi_table({name: run.kpis for name, run in runs.items()}))
    print(f"\n{write_comparison(runs, out)}")


@app.command()
def export(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a run or of several.")],
    kind: Annotated[Format, typer.Option("--format", help="Kind of table.")] = Format.CSV,
) -> None:
    """Write the record of a run as a table for other tools."""
    from bess.cli.exporting import export

    for path in export(directory, kind):
        print(path)


@app.command("demo-plant")
def demo_plant(
    study: Annotated[
        str, typer.Argument(metavar="[STUDY]", help="Study whose plant it is: bundled, or a TOML file.")
    ] = "case1",
    kind: Annotated[PlantKind, typer.Option("--kind", help="What the plant speaks.")] = PlantKind.OPENEMS,
    port: Annotated[
        int | None, typer.Option(min=1, max=65_535, help="8084 for OpenEMS, 5020 for SunSpec.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Seconds of the plant in each second.")] = 1.0,
    serve: Annotated[
        bool, typer.Option("--serve", help="Drive it as well, with the page of the service open.")
    ] = False,
) -> None:
    """Simulate a plant on this machine that bess serve can drive."""
    from bess.cli.demo import demo_plant, serve_demo
    from bess.study import load_study

    loaded = load_study(study)
    if serve:
        serve_demo(loaded, kind, port, speed, _folder(None, f"{loaded.name}-demo", False))
    else:
        demo_plant(loaded, kind, port, speed)


@app.command()
def init(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the study.")] = Path(),
) -> None:
    """Write a commented study to start from."""
    from bess.cli.starting import start

    path = start(directory)
    print(f"{path}: a study to start from; bess run {path} runs it as it is.")


@app.command()
def schema(
    kind: Annotated[Kind, typer.Argument(metavar="study|system", help="Kind of file.")],
) -> None:
    """Print the JSON schema of study or system files, for completion in editors."""
    import json

    from bess.study.reference import schema

    print(json.dumps(schema(kind.value), indent=2, ensure_ascii=False))


@app.command()
def distil(
    study: StudyName,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the controller.")],
    generations: Annotated[
        int | None, typer.Option(min=0, help="Effort: generations of the search; 150 if omitted.")
    ] = None,
    days: Days = None,
    assignments: Assignments = None,
) -> None:
    """Distil a study into a controller without a solver: policy.json, C99, structured text, a report."""
    from bess.distil import GENERATIONS, distil_runs
    from bess.study import load_study

    effort = GENERATIONS if generations is None else generations
    for folder in distil_runs(load_study(study, _values(days, assignments)), out, generations=effort):
        print(
            f"{folder}: policy.json (policy.name=distilled, policy.file={folder / 'policy.json'}), split.c, "
            f"split.h, split.st; {folder / 'report.md'} says what was lost"
        )


@app.command()
def check(study: StudyName, days: Days = None, assignments: Assignments = None) -> None:
    """Validate a study and the data it names; run nothing."""
    from bess.cli.checking import findings
    from bess.study import load_study

    for line in findings(load_study(study, _values(days, assignments))):
        print(line)


@app.command("list")
def list_() -> None:
    """List bundled studies, systems, cells, inverters and policies."""
    from bess.cli.listing import listing

    print(listing())


def _values(days: float | None, assignments: list[str] | None) -> dict[str, Any]:
    from bess.study.keys import parse_assignment

    values = dict(parse_assignment(text) for text in assignments or [])
    return values if days is None else {**values, "run.days": days}


def _folder(out: Path | None, name: str, resume: bool) -> Path:
    """``--out``, or a folder that does not exist yet."""
    from bess.errors import InputError

    if out is not None:
        if resume and not (out.is_dir() and any(out.iterdir())):
            raise InputError(f"--resume: {out} holds no run to continue; leave --resume out to begin one")
        return out
    if resume:
        raise InputError("--resume: name the folder of the run with --out")
    folder, number = Path("results") / name, 1
    while folder.exists():
        number += 1
        folder = Path("results") / f"{name}-{number}"
    return folder
