"""Every number of a closed loop in the documentation is one that the code gives.

``make cases`` stores the numbers and writes the tables and phrases made of them. Here they are measured
again. What fails after a change that is meant to move numbers is mended by ``make cases``.
"""

import math
import re
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import bess
from bess.dispatch import synthetic
from bess.system.components.registry import list_systems

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import numbers_of_pages as numbers

from bess.study import expand
from m5bat_day import replayed
from once import Once

pytestmark = pytest.mark.golden

DOCS = numbers.DOCS
RELATIVE = 2e-3
"""Other processors round differently, and a search may then take another of two nearly equal ways."""
ABSOLUTE = 0.02


def leaves(tree: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, float]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{path}{key}: ")
        else:
            yield path + key, value


def differences(stored: Mapping[str, Any], measured: Mapping[str, Any]) -> list[str]:
    old, new = dict(leaves(stored)), dict(leaves(measured))
    found = [f"{key}: only on one side" for key in sorted(old.keys() ^ new.keys())]
    for key in old.keys() & new.keys():
        close = math.isclose(old[key], new[key], rel_tol=RELATIVE, abs_tol=ABSOLUTE)
        if not (close or (math.isnan(old[key]) and math.isnan(new[key]))):
            found.append(f"{key}: the documentation says {old[key]:g}, the code gives {new[key]:g}")
    return found


@pytest.mark.parametrize("name", numbers.STUDIES)
def test_numbers_of_a_study_are_those_the_code_gives(name: str, once: Once) -> None:
    runs = {key: once.simulated(study) for key, study in expand(numbers.study(name)).items()}
    measured = numbers.figures_of(runs)
    changed = differences(numbers.stored()[name], measured)
    assert not changed, "run `make cases`:\n" + "\n".join(changed)


def test_numbers_of_the_measured_plant_are_those_the_code_gives(once: Once) -> None:
    measured = numbers.m5bat(replay=partial(replayed, once))
    if measured is None:
        pytest.skip("the measured day is not beside the repository (../shared/data)")
    changed = differences(numbers.stored()["m5bat"], measured)
    assert not changed, "run `make cases`:\n" + "\n".join(changed)


def test_tables_and_phrases_are_made_of_the_stored_numbers() -> None:
    for name, text in numbers.tables(numbers.stored()).items():
        written = (numbers.TABLES / name).read_text(encoding="utf-8")
        assert written == text, f"{name}: run `make cases`"


def test_the_page_on_differing_strings_quotes_what_announced_events_save() -> None:
    page = " ".join((DOCS / "howto/differing-strings.md").read_text(encoding="utf-8").split())
    given, stored = bess.load_study("differing").event, numbers.stored()
    events = [{**event.model_dump(exclude_none=True), "announced": True} for event in given]
    own: dict[str, Any] = {"scenario": [], "policy.name": "mpc", "event": events}
    for name, values, words in (
        (
            "differing",
            {},
            r"loses ([\d.]+) kWh \(([\d.]+) unannounced\) with (\d+) .* starts instead of (\d+),",
        ),
        ("differing-tight", {"demand.scale": 1.5}, r"`demand.scale=1.5` ([\d.]+) kWh \(([\d.]+)\)"),
    ):
        study = bess.load_study("differing", own | values)
        announced, unannounced = bess.run(study, progress=False).kpis, stored[name]["mpc"]
        quoted = re.search(words, page)
        assert quoted is not None
        figures = [announced["lost_kwh"], unannounced["lost_kwh"]]
        figures += [4.0 * kpis["inverter_starts_mean"] for kpis in (announced, unannounced)]
        for text, figure in zip(quoted.groups(), figures, strict=False):
            assert float(text) == pytest.approx(figure, rel=RELATIVE, abs=0.06)


def test_texts_give_the_energy_of_a_reference_string() -> None:
    one_kwh = bess.System.reference(1).nominal_energy_kwh.sum()
    pages = [DOCS / "parameters.md", DOCS / "notebooks/your-csv-to-a-decision.ipynb"]
    read = (page.read_text(encoding="utf-8") for page in pages)
    for text in (*read, bess.System.reference.__doc__, list_systems()[0].description):
        assert f"{one_kwh:.0f} kWh" in text
    for text in ((DOCS / "quickstart.md").read_text(encoding="utf-8"), synthetic.__doc__):
        assert f"{2 * one_kwh:.0f} kWh" in text


def test_pages_ask_for_phrases_that_there_are_and_use_all_of_them() -> None:
    pages = [page.read_text(encoding="utf-8") for page in DOCS.glob("**/*.md")]
    asked = {name for text in pages for name in re.findall(r"\{\{ (\w+) \}\}", text)}
    assert asked == set(numbers.words(numbers.stored()))


def test_a_number_that_the_code_no_longer_gives_is_found() -> None:
    stored = {"case": {"mpc": {"lost_kwh": 100.0, "starts": 3.0}}}
    assert not differences(stored, {"case": {"mpc": {"lost_kwh": 100.1, "starts": 3.0}}})
    assert differences(stored, {"case": {"mpc": {"lost_kwh": 101.0, "starts": 3.0}}}) == [
        "case: mpc: lost_kwh: the documentation says 100, the code gives 101"
    ]
    assert differences(stored, {"case": {"mpc": {"lost_kwh": 100.0}}}) == [
        "case: mpc: starts: only on one side"
    ]
