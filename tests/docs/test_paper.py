"""Claim: the figures of the paper are those that the pages show."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAPER = " ".join((ROOT / "paper.md").read_text("utf-8").split())


def page(name: str) -> str:
    return (ROOT / "docs" / name).read_text("utf-8")


def test_figures_on_bounds_are_those_of_the_long_search() -> None:
    row = re.search(r"(?m)^\| all (.*)\|$", page("_cases/gaps.md"))
    assert row is not None
    problems, missed, worst, above = (cell.strip() for cell in row[1].split("|")[1:5])
    assert f"On {problems} random power splits" in PAPER
    assert f"more than 0.1 % in {missed}, at most by {worst} %;" in PAPER
    assert f"above the best schedule found in {above}." in PAPER


def test_figures_on_the_closed_loop_are_those_of_the_arena() -> None:
    said = re.search(
        r"over (\d+) scenarios `mpc` costs ([\d.]+ %) less than the best rule of each, .* in none",
        page("_cases/arena.md"),
    )
    assert said is not None, "a rule wins somewhere: say so in paper.md"
    assert f"In {said[1]} scenarios" in PAPER
    assert f"costs {said[2]} less than the best of the bundled rules" in PAPER


def test_figures_on_temperature_are_those_of_the_measured_cell() -> None:
    said = re.search(r"Eight of nine blind predictions are within ([\d.]+ K)", page("validation-thermal.md"))
    assert said is not None
    assert f"eight of nine blind predictions of temperature are within {said[1]}" in PAPER
