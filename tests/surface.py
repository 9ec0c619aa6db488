"""The public surface as text, one promise a line; ``make surface`` stores it, as each release does.

Annotations are left out: they are printed differently by each Python, and held by ``mypy``.
"""

import dataclasses
import enum
import inspect
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import typer

from api_page import found, listed
from bess.cli.app import app
from bess.simulation.analysis.catalogue import CATALOGUE
from bess.simulation.record.dataset import VARIABLES
from bess.simulation.record.provenance import RECORD_FORMAT
from bess.study.reference import KINDS, keys

STORED = Path(__file__).with_name("surface.txt")


def _default(value: object) -> str:
    return repr(value) if isinstance(value, bool | int | float | str | None) else type(value).__name__


def _signature(thing: Any) -> str:
    shown, star = [], False
    for each in inspect.signature(thing).parameters.values():
        if each.name in ("self", "cls"):
            continue
        if each.kind is each.KEYWORD_ONLY and not star:
            shown.append("*")
        star = star or each.kind in (each.KEYWORD_ONLY, each.VAR_POSITIONAL)
        prefix = {each.VAR_POSITIONAL: "*", each.VAR_KEYWORD: "**"}.get(each.kind, "")
        end = "" if each.default is each.empty else f"={_default(each.default)}"
        shown.append(f"{prefix}{each.name}{end}")
    return f"({', '.join(shown)})"


def _members(thing: type) -> Iterator[str]:
    """Public members of a class that this package defines; those of a study's tables are among its keys."""
    names = {name for base in thing.__mro__ if base.__module__.startswith("bess") for name in vars(base)}
    if dataclasses.is_dataclass(thing):
        names |= {field.name for field in dataclasses.fields(thing)}
    if not thing.__module__.startswith("bess.study"):
        names |= set(getattr(thing, "model_fields", ()))
    for name in sorted(names):
        if name.startswith(("_", "model_")):
            continue
        member = inspect.getattr_static(thing, name, None)
        function = getattr(member, "__func__", member)
        yield name + (_signature(function) if inspect.isfunction(function) else "")


def python() -> Iterator[str]:
    """Names of the page of the API, with parameters, defaults and members."""
    for name in sorted(listed()):
        thing = found(name)
        if isinstance(thing, type) and issubclass(thing, enum.Enum):
            yield from (f"{name}.{member.name} = {member.value!r}" for member in thing)
        elif isinstance(thing, type):
            yield name + (_signature(vars(thing)["__init__"]) if "__init__" in vars(thing) else "")
            yield from (f"{name}.{member}" for member in _members(thing))
        else:
            yield name + (_signature(thing) if inspect.isfunction(thing) else "")


def files() -> Iterator[str]:
    """Keys of study and system files."""
    for kind in KINDS:
        for key in keys(kind):
            place = f"{kind} {key.section} {key.key}"
            yield f"{place}: {key.type} [{key.unit}] {key.allowed}, default {key.default}"


def records() -> Iterator[str]:
    """Variables of a record, and key figures."""
    yield f"record format {RECORD_FORMAT}"
    for name, variable in VARIABLES.items():
        yield f"record {name} {variable.dims} [{variable.units}] {variable.dtype}"
    yield from (f"key figure {name} [{kpi.unit}]" for name, kpi in CATALOGUE.items())


def commands() -> Iterator[str]:
    """Commands with their arguments and options."""
    for name, command in sorted(typer.main.get_group(app).commands.items()):
        yield f"bess {name}"
        yield from (f"bess {name} {'|'.join(each.opts)}" for each in command.params)


def http(folder: Path) -> Iterator[str]:
    """Routes, the fields of their messages, and those of the answer to a demand."""
    from bess.edge.serve.answer import Demand
    from bess.edge.serve.app import build_app
    from bess.edge.serve.messages import SplitMessage, measurements_of
    from bess.edge.serve.service import Service
    from bess.study import load_study

    service = Service(load_study("policies", {"policy.name": "equal"}), folder)
    made = build_app(service).openapi()
    string = {"soc": 0.5, "temperature_c": 25.0}
    message = SplitMessage.model_validate({"demand_kw": 10.0, "strings": [string, string]})
    measured = measurements_of(message, service.controller.system)
    answer = service.answer(measured, Demand.of(message.demand_kw)).document()
    health = service.health()
    service.close()
    for path, methods in made["paths"].items():
        yield from (f"{method.upper()} {path}" for method in methods)
    for name, table in made["components"]["schemas"].items():
        required = table.get("required", ())
        yield from (
            f"{name}.{field}{' (required)' if field in required else ''}"
            for field in table.get("properties", {})
        )
    yield from (f"answer of /v1/split: {field}" for field in answer)
    yield from (f"answer of /v1/health: {field}" for field in health)


def surface(folder: Path) -> list[str]:
    """All of it; ``folder`` takes the state of a service."""
    return [*python(), *files(), *records(), *commands(), *http(folder)]


def _extends(line: str, promised: str) -> bool:
    """Whether a signature is the promised one with further parameters that have defaults."""
    start = promised[:-1]
    if not (promised.endswith(")") and line.endswith(")") and line.startswith(start)):
        return False
    rest = line[len(start) : -1]
    more = rest.removeprefix(", ").split(", ")
    return rest.startswith("" if start.endswith("(") else ", ") and all(
        "=" in one or one == "*" for one in more
    )


def broken(promised: Iterable[str], here: Sequence[str]) -> list[str]:
    """Promises that are not kept."""
    return [line for line in promised if line not in here and not any(_extends(one, line) for one in here)]


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        STORED.write_text("\n".join(surface(Path(folder))) + "\n", "utf-8")
