"""Nothing is written outside the folder that was named, whatever a study says."""

import pytest

import bess
from bess.simulation.record.files import folder_in
from bess.study import expand
from commands import refused

STUDY = """{name}
[demand]
file = "two-cycle-48h"
[policy]
name = "equal"
[run]
days = 0.05
"""
PATHS = ["../S1", "../../../S1", "/tmp/S1", "a/b", "..", "."]
OUTSIDE = [*PATHS, "", "a\\nb", "C:\\\\S1", "x" * 300, ".hidden", "~"]


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("command", ["run", "sweep", "check"])
def test_a_name_that_is_no_folder_is_refused(command, name, tmp_path):
    work = tmp_path / "a" / "b" / "c"
    work.mkdir(parents=True)
    (work / "study.toml").write_text(STUDY.format(name=f'name = "{name}"'))
    before = sorted(tmp_path.rglob("*"))
    line = refused(command, "study.toml", folder=work)
    assert "study.toml: name = " in line and ("names a folder" in line or "at most 200" in line)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("name", ["../S1", "/S1", "a/../../S1"])
def test_python_cannot_write_outside_either(name, tmp_path):
    study = bess.load_study("case1", {"policy.name": "equal", "run.days": 0.05})
    escaped = study.model_copy(update={"name": name})
    for call in (bess.run_scenarios, bess.run_sweep):
        with pytest.raises(bess.InputError, match="would be written outside"):
            call(escaped, out=tmp_path / "o" / "o1")
    assert not any(tmp_path.rglob("*"))
    with pytest.raises(bess.InputError, match="names a folder"):
        study.with_values({"name": name})


def test_a_folder_of_something_else_is_refused_and_left_as_it_is(tmp_path):
    (tmp_path / "notes.txt").touch()
    study = bess.load_study("case1", {"policy.name": "equal", "run.days": 0.0625})
    with pytest.raises(bess.InputError, match=r"holds 'notes\.txt' but no run"):
        bess.run(study, out=tmp_path, progress=False)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_a_link_in_the_folder_does_not_lead_out_of_it(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "case1").symlink_to(tmp_path / "elsewhere")
    study = bess.load_study("case1", {"policy.name": "equal", "run.days": 0.05})
    with pytest.raises(bess.InputError, match="written outside"):
        bess.run_scenarios(study, out=tmp_path / "out")
    assert not any((tmp_path / "elsewhere").iterdir())
    assert folder_in(tmp_path / "out", "S1") == tmp_path / "out" / "S1"


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("my study.toml", "my-study"),
        ("Fälle (2).toml", "Falle-2"),
        ("日本.toml", "study"),
    ],
)
def test_a_study_without_a_name_is_called_like_its_file(file, name, tmp_path):
    path = tmp_path / file
    path.write_text(STUDY.format(name=""))
    assert bess.load_study(path).name == name


def test_names_made_from_swept_values_stay_within_the_folder(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text(STUDY.format(name="") + '[[sweep]]\nkey = "title"\nvalues = ["../../x", "/etc", "a b"]\n')
    assert list(expand(bess.load_study(path))) == ["title=..-..-x", "title=-etc", "title=a-b"]
