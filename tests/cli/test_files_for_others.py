"""Claims about bess init, export, schema and compare: what they write is of use as it is."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

import bess
from bess.cli.app import app
from bess.study.reference import Kind, keys, meanings, schema, template


def run(*words: str) -> str:
    ended = CliRunner().invoke(app, words, catch_exceptions=False)
    assert ended.exit_code == 0, ended.output
    return ended.output


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "equal"
    values = {"run.days": 0.5, "policy.name": "equal"}
    bess.run(bess.load_study("case1").with_values(values), progress=False, out=folder)
    return folder


@pytest.mark.parametrize("kind", ["study", "system"])
def test_every_key_has_a_meaning_and_no_meaning_is_left_over(kind: str) -> None:
    listed = {key.key: key.meaning for key in keys(kind)}
    assert not [key for key, meaning in listed.items() if not meaning.endswith(".")]
    known = set(listed) | {".".join([*key.split(".")[:-2], "*", key.split(".")[-1]]) for key in listed}
    assert not set(meanings(kind)) - known


def test_ranges_in_the_reference_are_those_the_models_hold_to() -> None:
    study = bess.load_study("case1")
    row = next(key for key in keys("study") if key.key == "weather.offset_k")
    assert (row.unit, row.default, row.allowed) == ("K", "0.0", "[-50, 50]")
    study.with_values({"weather.offset_k": 50.0})
    with pytest.raises(bess.InputError, match=r"must be in \[-50, 50\] K"):
        study.with_values({"weather.offset_k": 50.1})


def test_the_schema_of_a_study_knows_its_keys_with_units_and_meanings() -> None:
    made = json.loads(run("schema", "study"))
    assert made == json.loads(json.dumps(schema("study")))
    offset = made["$defs"]["WeatherSection"]["properties"]["offset_k"]
    assert (offset["minimum"], offset["maximum"], offset["x-unit"]) == (-50.0, 50.0, "K")
    assert offset["description"].startswith("Temperature offset")
    assert "name" not in made["required"] and "demand" in made["required"]
    for key in keys("study"):  # tables of two names say what theirs means
        if key.key in ("replacement.string", "augmentation.string"):
            table = made["$defs"][key.key.partition(".")[0].capitalize()]
            assert table["properties"]["string"]["description"] == key.meaning


def test_the_schema_of_a_system_has_all_that_bundled_systems_use() -> None:
    made = json.loads(run("schema", "system"))
    for name in ("reference", "unequal-4", "mixed-4", "m5bat"):
        text = (Path(bess.__file__).parent / "data" / "systems" / f"{name}.toml").read_text("utf-8")
        for section, content in tomllib.loads(text).items():
            assert section in made["properties"]
            if isinstance(content, dict):
                reference = made["properties"][section]
                options = [reference, *reference.get("anyOf", [])]
                name_of = next(option["$ref"] for option in options if "$ref" in option).rpartition("/")[2]
                assert set(content) <= set(made["$defs"][name_of]["properties"])


@pytest.mark.parametrize("kind", ["study", "system"])
def test_bundled_files_are_valid_by_the_schema(kind: Kind) -> None:
    validator = Draft202012Validator(json.loads(json.dumps(schema(kind))))
    folder = {"study": "studies", "system": "systems"}[kind]
    files = sorted((Path(bess.__file__).parent / "data" / folder).glob("*.toml"))
    documents = [(path.name, tomllib.loads(path.read_text("utf-8"))) for path in files]
    if kind == "study":
        weights = {"battery": 0.5, "inverter": {"weight": 0.5, "priority": 2}}
        documents.append(("weights", {"demand": {"file": "x.csv"}, "policy": {"objectives": weights}}))
    else:
        documents.append(("to_toml", tomllib.loads(bess.load_system("mixed-4").to_toml())))
    assert len(documents) > 4
    for name, document in documents:
        as_json = json.loads(json.dumps(document, default=lambda time: time.isoformat()))
        assert [error.message for error in validator.iter_errors(as_json)] == [], name


def test_a_study_from_init_runs_as_it_is_and_is_not_written_over(tmp_path: Path) -> None:
    run("init", str(tmp_path / "mine"))
    study = bess.load_study(tmp_path / "mine" / "study.toml")
    assert (study.policy.name, study.run.days, study.demand.kind) == ("mpc", 2.0, "profile")
    with pytest.raises(bess.InputError, match="not overwritten"):
        run("init", str(tmp_path / "mine"))
    with pytest.raises(bess.InputError, match="give the folder"):
        run("init", str(tmp_path / "mine.toml"))


def test_init_on_a_full_disk_leaves_no_part_of_a_study(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, limits[1]))
    try:
        with pytest.raises(bess.InputError, match=r"study\.toml: cannot be written"):
            run("init", str(tmp_path))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_every_default_shown_in_a_comment_is_accepted_when_it_is_set(tmp_path: Path) -> None:
    """Uncommented one section at a time, what the template shows is a study."""
    needed = {"[reactive]": "kvar = 20.0"}  # one of its keys without a default
    traded = '[demand]\nkind = "arbitrage"\nprices = "prices.csv"\nplan = "linear"'  # takes a meter
    blocks = template("study.toml").split("\n\n")
    head, live = blocks[1], [block for block in blocks if block.startswith(("[system]", "[demand]"))]
    for block in blocks[2:]:
        if 'kind = "arbitrage"' in block or "[[" in block or not block.startswith("#"):
            continue
        lines = [line.removeprefix("# ") for line in block.splitlines()]
        given = [line for line in lines if not line.split("#")[0].rstrip().endswith("=")]
        given.append(needed.get(lines[0], ""))
        path = tmp_path / "study.toml"
        others = [other for other in live if other.split("\n")[0] != lines[0]]
        if lines[0].startswith("[demand."):
            others = [traded if other.startswith("[demand]") else other for other in others]
        path.write_text("\n".join([head, *others, *given]))
        bess.load_study(path)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_an_export_holds_the_record(kind: str, result: Path) -> None:
    path = Path(run("export", str(result), "--format", kind).strip())
    frame = pd.read_csv(path, parse_dates=["time"]) if kind == "csv" else pd.read_parquet(path)
    with bess.open_result(result) as record:
        np.testing.assert_array_equal(frame["delivered_kw.1"], record["delivered_kw"][:, 1])
        np.testing.assert_array_equal(frame["demand_kw"], record["demand_kw"])
        assert str(frame["time"].dt.tz) == "UTC"
        assert frame["time"].dt.tz_localize(None).tolist() == pd.DatetimeIndex(record["time"]).tolist()


def test_compare_sets_runs_of_two_folders_side_by_side(result: Path, tmp_path: Path) -> None:
    other = tmp_path / "priority"
    values = {"run.days": 0.25, "policy.name": "priority"}
    bess.run(bess.load_study("case1").with_values(values), progress=False, out=other)
    shown = run("compare", str(result), str(other), "--out", str(tmp_path / "both"))
    unlike, _, names, *_ = shown.splitlines()
    assert (
        unlike.startswith("These runs are unlike, so none of them is marked best: ") and "length (" in unlike
    )
    assert names.split() == ["equal", "priority"]
    page = (tmp_path / "both" / "report.html").read_text("utf-8")
    assert "Comparison of equal, priority" in page
    assert (tmp_path / "both" / "figures" / "losses.svg").exists()
    assert not (tmp_path / "both" / "figures" / "mean-temperature.svg").exists(), "they differ in length"
    for same in (
        [str(result)],
        [str(result), f"{result}/"],
        [str(result), str(result / "..") + f"/{result.name}"],
    ):
        with pytest.raises(bess.InputError, match="needs at least two runs"):
            run("compare", *same)
