"""Claims: the fronts of the manual are what the code gives, and as fine as they say."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import make_fronts

import bess
from bess.study.scenarios import expand


def test_the_tables_are_made_of_the_stored_numbers() -> None:
    for name, text in make_fronts.tables(make_fronts.read()).items():
        assert (make_fronts.DOCS / "_cases" / name).read_text(encoding="utf-8") == text


def test_each_front_is_searched_with_a_hundred_points_and_more() -> None:
    for runs in make_fronts.read().values():
        assert len(runs) >= 100


@pytest.mark.parametrize("share", ["0.5", "1"])
def test_a_weight_gives_its_stored_figures(share: str, tmp_path: Path) -> None:
    path = tmp_path / "weights.toml"
    path.write_text(make_fronts.WEIGHTS_STUDY, encoding="utf-8")
    runs = expand(bess.load_study(path))
    study = next(
        study
        for study in runs.values()
        if study.policy.objectives.inverter.weight == pytest.approx(float(share))
    )
    kpis = bess.run(study, progress=False).kpis
    stored = make_fronts.read()["weights"][share]
    assert {key: kpis[key] for key in stored} == pytest.approx(stored, rel=1e-6)


def test_a_knee_is_on_the_front_and_its_volume_within_the_box() -> None:
    runs = make_fronts.read()
    for name, axes in (("weights", make_fronts.WEIGHTS), ("wear", make_fronts.WEAR)):
        front = make_fronts.front_of(runs[name], axes)
        assert front["knee"] in front["on_front"]
        assert 0.0 < front["share"] < 1.0
