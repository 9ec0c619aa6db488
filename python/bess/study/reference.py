"""Every key of a study file and of a system file: type, unit, default, range and meaning.

Names, types, defaults and ranges are read from the models that check the files, meanings from
``bess/data/keys.toml``. They are the source of ``bess schema``, of the study of ``bess init`` and of the
tables of the manual.
"""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import create_model

from bess.errors import InputError
from bess.files import bundled_toml
from bess.study.study import Study
from bess.system.parse import COMPONENTS, STRING_SECTIONS, PlantSections
from bess.system.section import Section

Kind = Literal["study", "system"]
KINDS: Final[tuple[Kind, ...]] = ("study", "system")

# The first ending that fits; longer ones stand before those they end with.
_UNITS: Final = {
    "eur_kw_month": "EUR/kW/month", "_mwh_per_year": "MWh/year", "eur_kw_year": "EUR/kW/year",
    "eur_mw": "EUR/MW", "_mhz": "mHz",
    "eur_mwh": "EUR/MWh", "eur_per_mwh": "EUR/MWh", "eur_kwh": "EUR/kWh", "_eur": "EUR", "_kwh": "kWh",
    "kvar": "kvar", "_kw": "kW", "_kg_m3": "kg/m³", "_j_kgk": "J/(kg K)", "_w_m2k": "W/(m² K)",
    "_w_mk": "W/(m K)",
    "_kg_s": "kg/s", "_m2": "m²", "_k_per_j": "K/J", "_per_k_step": "1/(K step)", "_per_k": "1/K",
    "_mv_k": "mV/K", "_w_per_w": "", "_w_k": "W/K", "_kj_k": "kJ/K", "_pa": "Pa",
    "_kw_per_s": "kW/s",
    "_per_s": "1/s", "_mohm": "mΩ", "_ah": "Ah", "_kg": "kg", "soc_min": "", "_min": "min", "_h": "h",
    "_s": "s", "_c": "°C", "_k": "K", "_m": "m", "days": "days",
}  # fmt: skip

_TYPES: Final = {
    "number": "number", "integer": "whole number", "string": "text", "boolean": "true or false",
    "object": "table",
}  # fmt: skip


@dataclass(frozen=True)
class Key:
    """One key of a file."""

    section: str
    """Header of the key, such as ``[demand]`` or ``[[event]]``; with the kind of demand if it has one."""
    key: str
    """Dotted, from the root of the file."""
    type: str
    unit: str
    default: str
    allowed: str
    """Texts of the page; empty if not applicable."""
    meaning: str


@cache
def meanings(kind: Kind) -> dict[str, str]:
    """Meaning of each dotted key; ``*`` stands for one name."""
    entries: dict[str, str] = bundled_toml("keys.toml")[kind]
    return entries


def schema(kind: Kind) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a study or system file, with a description and a unit for each key.

    It serves completion and checks in editors. Keys with another source are optional: the name of a study
    defaults to its file name, and sections of a system can come from a component or a ``[[string]]`` table.
    """
    made = _described(kind)
    if kind == "study":
        made["required"] = [name for name in made["required"] if name != "name"]
    else:
        sections = {name: field for name, field in made["properties"].items() if name != "about"}
        made["properties"]["string"] = {
            "type": "array",
            "description": "Parameters of single strings, in their order; they override the sections above.",
            "items": {"type": "object", "properties": sections, "additionalProperties": False},
        }
        for table in (made, *made["$defs"].values()):
            table.pop("required", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **made, "title": f"bess {kind} file"}


def _described(kind: Kind) -> dict[str, Any]:
    """JSON schema of the models of a file, with a description and a unit for each key."""
    made: dict[str, Any]
    if kind == "study":
        made = Study.model_json_schema()
    else:
        whole = dict(PlantSections.model_fields)
        fields = {"about": whole.pop("about"), **STRING_SECTIONS, **whole}
        sections: dict[str, Any] = {name: (field.annotation, field) for name, field in fields.items()}
        made = create_model("SystemFile", __base__=Section, **sections).model_json_schema()
        for section, (key, *_) in COMPONENTS.items():
            table = made["$defs"][section.capitalize()]
            table["properties"] = {key: {"type": "string"}, **table["properties"]}
    known = meanings(kind)
    for prefix, _, table in _tables(made, made):
        for name, field in table.get("properties", {}).items():
            starred = f"{prefix.rstrip('.').rpartition('.')[0]}.*.{name}"
            if meaning := known.get(prefix + name, known.get(starred)):
                field["description"] = meaning
            if unit := next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), ""):
                field["x-unit"] = unit
    return made


def keys(kind: Kind) -> list[Key]:
    """All keys of a study or system file, in the order of the models."""
    made = _described(kind)
    found: dict[tuple[str, str], Key] = {}
    for prefix, header, table in _tables(made, made):
        for name, field in table.get("properties", {}).items():
            options = _options(field, made)
            if _is_section(options, made):
                continue
            dotted = prefix + name
            default = "name of the file" if dotted == "name" else _default(field, name, table)
            types, ranges = (dict.fromkeys(each) for each in zip(*map(_type_and_range, options), strict=True))
            key_type, allowed = " or ".join(types), "; ".join(filter(None, ranges))
            unit, meaning = field.get("x-unit", ""), field.get("description", "")
            found.setdefault((header, dotted), Key(header, dotted, key_type, unit, default, allowed, meaning))
    return list(found.values())


def _tables(
    field: dict[str, Any], root: dict[str, Any], prefix: str = "", header: str = "", many: bool = False
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Every table of a schema: prefix of its keys, header in the file, and its schema."""
    for option in _options(field, root):
        if option.get("type") == "array" and isinstance(option.get("items"), dict):
            yield from _tables(option["items"], root, prefix, header, many=True)
        if "properties" not in option:
            continue
        name = prefix.rstrip(".")
        here = header or (f"[[{name}]]" if many else f"[{name}]" if name else "")
        kind = option["properties"].get("kind", {}).get("const")
        yield prefix, f'{here} kind = "{kind}"' if kind and prefix else here, option
        for key, below in option["properties"].items():
            yield from _tables(below, root, f"{prefix}{key}.")


def _options(field: dict[str, Any], root: dict[str, Any]) -> list[dict[str, Any]]:
    """Alternatives of a field, with references resolved and without null."""
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return _options(root["$defs"][name], root)
    for word in ("anyOf", "oneOf", "allOf"):
        if word in field:
            return [option for part in field[word] for option in _options(part, root)]
    return [] if field.get("type") == "null" else [field]


def _is_section(options: list[dict[str, Any]], root: dict[str, Any]) -> bool:
    """Whether a field is a table, or a list of tables, whose keys are listed by themselves."""
    items = [part for option in options for part in _options(option.get("items") or {"type": "null"}, root)]
    return any("properties" in option for option in (*options, *items))


def _default(field: dict[str, Any], name: str, table: dict[str, Any]) -> str:
    if name in table.get("required", ()):
        return "required"
    value = field.get("default")
    return "" if value is None or value == {} else json.dumps(value, ensure_ascii=False)


def _type_and_range(option: dict[str, Any]) -> tuple[str, str]:
    """Type of an alternative of a field, and its allowed values."""
    if option.get("format") == "date-time":
        return "instant", ""
    if "enum" in option or "const" in option:
        return "one of", ", ".join(json.dumps(value) for value in option.get("enum", [option.get("const")]))
    if option.get("type") == "array":
        return "list", _range(option["items"])
    return _TYPES.get(option.get("type", ""), "any"), _range(option)


def _range(option: dict[str, Any]) -> str:
    low, high = (
        option.get(word, option.get(f"exclusive{word.capitalize()}")) for word in ("minimum", "maximum")
    )
    if low is None and high is None:
        return ""
    left = "(" if "exclusiveMinimum" in option else "["
    right = ")" if "exclusiveMaximum" in option or high is None else "]"
    return f"{left}{low:g}, {'∞' if high is None else f'{high:g}'}{right}"


_CHOSEN: Final = {
    "title": '"My first study"',
    "system.file": '"reference"',
    "demand.file": '"two-cycle-48h"',
    "demand.repeat": "true",
    "policy.name": '"mpc"',
    "run.days": "2",
}
_HEAD = """\
# A study defines the plant, the demand, the policy and the period.
#   bess check {name}      validates the study and its data
#   bess run {name}        runs the study; bess report writes a report
# Keys in comments show their defaults. bess schema study provides the same information to editors.
"""
_WIDTH = 34


def template(name: str) -> str:
    """Return the text of a study file; its header refers to the file as ``name``."""
    blocks = [_HEAD.format(name=name)]
    for header, group in groupby(keys("study"), key=lambda key: key.section):
        blocks.append("\n".join(_block(header, list(group))) + "\n")
    return "\n".join(blocks)


def _block(header: str, group: list[Key]) -> Iterator[str]:
    # Only the first kind of demand is active; repeatable tables are examples.
    table, _, kind = header.partition(" ")
    live = any(key.key in _CHOSEN for key in group) and kind in ("", 'kind = "profile"')
    if table:
        yield table if live else f"# {table}"
    for key in group:
        name = key.key.removeprefix(table.strip("[]") + ".")
        chosen = _CHOSEN.get(key.key) if live else None
        default = "" if key.default in ("required", "name of the file") else key.default
        line = f"{name} = {chosen}" if chosen else f"# {name} = {default}"
        about = [
            key.meaning,
            f"[{key.unit}]" if key.unit else "",
            f"Allowed: {key.allowed}." if key.allowed else "",
        ]
        yield f"{line.ljust(_WIDTH)} # {' '.join(filter(None, about))}"


STUDY: Final = "study.toml"


def start(directory: Path) -> Path:
    """Write ``study.toml`` into a folder, created if necessary; return its path."""
    path = directory / STUDY
    if directory.suffix == ".toml":
        raise InputError(f"{directory}: give the folder in which {STUDY} is written, not a file")
    if path.exists():
        raise InputError(f"{path}: exists already and is not overwritten; specify another folder")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        path.write_text(template(STUDY), encoding="utf-8")
    except OSError as error:
        with suppress(OSError):
            path.unlink()  # a full disk leaves an empty file
        raise InputError(f"{path}: cannot be written ({error.strerror}); specify another folder") from error
    return path
