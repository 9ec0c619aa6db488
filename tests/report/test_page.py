"""Claims about the page: one file, complete, the same every time, and readable without pictures."""

import base64
import hashlib
import html
import json
import re
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from folders import write_run
from synthetic import record

import bess
from bess.report import write_report
from once import Once

BASE = {
    "availability_pct": 100.0, "derating_efficiency_pct": 100.0, "inverter_efficiency_pct": 97.0,
    "battery_efficiency_pct": 98.0, "system_efficiency_pct": 96.0, "peak_mean_temperature_c": 45.0,
    "peak_string_temperature_c": 45.0, "lost_kwh": 10.0,
}  # fmt: skip
WEIGHTS = {"S1": (1.0, 0.0), "S2": (0.5, 0.5), "S3": (0.0, 1.0)}


class Page(HTMLParser):
    """Every start tag with its attributes, and the text of every script of data."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.data: list[str] = []
        self.text = ""
        self._in_data = False
        source = path.read_text(encoding="utf-8")
        # The library itself is not HTML of ours.
        before, found, _ = source.partition("Bokeh Contributors")
        self.feed(before[: before.rindex("<script>")] if found else source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {key: value or "" for key, value in attrs}
        self.tags.append((tag, named))
        self._in_data = tag == "script" and named.get("type") == "application/json"

    def handle_endtag(self, tag: str) -> None:
        self._in_data = False

    def handle_data(self, data: str) -> None:
        if self._in_data:
            self.data.append(data)
        else:
            self.text += data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attrs for name, attrs in self.tags if name == tag]


@pytest.fixture(scope="module")
def case_2(once: Once) -> Path:
    return once.made("page-of-case-2", lambda: _written(once.folder / "page-of-case-2"))


def _written(directory: Path) -> Path:
    for seed, (name, (w3, w4)) in enumerate(WEIGHTS.items()):
        data = record(2, 96, concentrate=w3, nodes=8, seed=seed)
        write_run(directory / name, data, name, policy={"objectives": {"inverter": w3, "battery": w4}})
    (directory / "study.toml").write_text('title = "Paper <case 2>"\n')
    write_report(directory)
    return directory


@pytest.fixture(scope="module")
def page(case_2: Path) -> Page:
    return Page(case_2 / "report.html")


def test_the_page_asks_for_no_other_file(page: Page) -> None:
    assert not [attrs for attrs in page.all("script") if "src" in attrs]
    assert all(attrs["href"].startswith("data:") for attrs in page.all("link"))
    assert all(attrs["src"].startswith("data:image/svg+xml,") for attrs in page.all("img"))
    assert {attrs["href"] for attrs in page.all("a") if attrs["href"][0] != "#"} == {
        f"{name}/report.html" for name in WEIGHTS
    }


def test_the_library_is_on_the_page_once(case_2: Path) -> None:
    source = (case_2 / "report.html").read_text(encoding="utf-8")
    assert source.count("Bokeh Contributors") == 1


def test_no_page_is_larger_than_two_megabytes(case_2: Path) -> None:
    pages = list(case_2.rglob("report.html"))
    assert len(pages) == 4
    assert max(page.stat().st_size for page in pages) < 2e6


def test_every_link_has_its_target_and_every_id_is_unique(page: Page) -> None:
    ids = Counter(attrs["id"] for _, attrs in page.tags if "id" in attrs)
    assert max(ids.values()) == 1
    assert {attrs["href"][1:] for attrs in page.all("a") if attrs["href"][0] == "#"} <= set(ids)


def test_pictures_have_texts_and_tables_have_headers(page: Page) -> None:
    assert len(page.all("img")) >= 4
    assert all(len(attrs["alt"]) > 20 for attrs in page.all("img"))
    assert all(attrs.get("scope") in ("col", "row", "rowgroup") for attrs in page.all("th"))
    assert len(page.all("table")) >= 3


def test_every_interactive_figure_has_data_and_a_still_picture(page: Page) -> None:
    charts = [attrs for attrs in page.all("div") if attrs.get("class") == "chart"]
    assert len(charts) == len(page.data) == 3
    assert len(page.all("figure")) == len(page.all("img")) > len(charts)
    assert all(json.loads(text)["doc"]["roots"] for text in page.data)


def test_text_of_a_study_cannot_become_markup(page: Page, case_2: Path) -> None:
    assert "Paper <case 2>" in page.text
    assert 'name = "mpc" # <&>' in Page(case_2 / "S1" / "report.html").text


def test_case_2_is_set_beside_the_paper(page: Page) -> None:
    assert "What the paper reports" in page.text and "arXiv:2507.04800" in page.text


def test_figures_are_saved_beside_each_page(case_2: Path) -> None:
    for folder, stems in ((case_2, ("losses", "durations")), (case_2 / "S1", ("flow", "power"))):
        names = {path.name for path in (folder / "figures").iterdir()}
        for stem in stems:
            assert f"{stem}.svg" in names


def test_figures_for_print_are_saved_beside_a_page_when_asked(tmp_path: Path) -> None:
    write_report(write_run(tmp_path / "run", record(1, 96)), print_files=True)
    names = {path.name for path in (tmp_path / "run" / "figures").iterdir()}
    for stem in ("flow", "power"):
        assert {f"{stem}.svg", f"{stem}.png", f"{stem}.pdf"} <= names


def test_each_scenario_has_a_page_of_its_own_that_leads_back(case_2: Path) -> None:
    page = Page(case_2 / "S2" / "report.html")
    assert "../report.html" in [attrs["href"] for attrs in page.all("a")]
    assert {"figure-flow", "figure-strings", "figure-solver"} <= {attrs["id"] for attrs in page.all("figure")}


def test_one_run_and_a_stopped_run_have_a_page(tmp_path: Path) -> None:
    data = record(1, 96, price=True)
    written = write_report(write_run(tmp_path / "whole", data))
    whole = Page(written)
    part = Page(write_report(write_run(tmp_path / "part", data, done=30)))
    assert "Stopped early" in part.text and "Stopped early" not in whole.text
    assert any(attrs.get("id") == "figure-market" for attrs in whole.all("figure"))
    assert "What the paper reports" not in whole.text
    before = written.read_bytes()
    assert write_report(tmp_path / "whole").read_bytes() == before, "the same results give the same page"


def test_the_numbers_of_the_first_screen_are_those_of_the_record(tmp_path: Path) -> None:
    """Each is computed here anew, from the arrays of the record and runs under the rules alone."""
    study = bess.load_study("case1", {"run.days": 1.0, "system.initial_soc": [0.2, 0.5]})
    runs = {rule: bess.run(study.with_values({"policy.name": rule}), progress=False)
            for rule in ("equal", "soc", "temperature")}  # fmt: skip
    study = study.with_values({"policy.name": "priority"})
    page = Page(write_report(bess.run(study, out=tmp_path / "run", progress=False).directory or tmp_path))
    data = bess.open_result(tmp_path / "run").load()

    def kwh(*names: str) -> float:
        return float(sum(data[f"{name}_loss_kw"].values.sum() for name in names)) * 0.25

    def number(value: float) -> str:
        return f"{value:,.0f}" if value >= 100.0 or value == 0.0 else f"{value:,.1f}"

    def said(value: float) -> str:
        return f"{number(value)} kWh"

    lost = kwh("availability", "derating", "inverter", "battery")
    name, best = min(((rule, run.kpis["lost_kwh"]) for rule, run in runs.items()), key=lambda pair: pair[1])
    text = " ".join(page.text.split())
    gain, better = abs(best - lost), "less" if lost < best else "more"
    assert (
        f"priority: {said(lost)} undelivered or lost, {said(gain)} ({100 * gain / best:.0f} %) {better}"
        in text
    )
    assert f"than the best rule, {name}" in text
    assert f"Peak string temperature{data['temperature_c'].values.max():.1f} °C" in text
    undelivered = kwh("availability", "derating")
    assert f"{number(undelivered)} undelivered + {number(kwh('inverter'))} inverters" in text
    power = data["delivered_kw"].values
    for word, sign in (("Charged", -1.0), ("Discharged", 1.0)):
        asked = 0.25 * np.maximum(sign * data["demand_kw"].values, 0.0).sum()
        given = 0.25 * np.maximum(sign * power, 0.0).sum()
        assert f"{word}: {said(given)} of {said(asked)} demand, {100 * given / asked:.1f} %." in text


@pytest.fixture
def comparison_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write the page that compares runs, without a page of each."""
    monkeypatch.setattr("bess.report.page._run_page", lambda *_, **__: None)


@pytest.mark.usefixtures("comparison_alone")
def test_a_sweep_begins_with_its_knee_and_the_points_worth_a_look(tmp_path: Path) -> None:
    head = ["name", "status", "error", "policy.objectives.inverter", *BASE]
    points = {"a": (0.0, 96.0, 99.0, 30.0), "b": (0.4, 97.9, 98.9, 35.0), "c": (1.0, 98.0, 97.0, 50.0)}
    lines = [",".join(head)]
    for name, (weight, inverter, battery, peak) in points.items():
        write_run(tmp_path / name, record(2, 24), name)
        kpis = BASE | {"inverter_efficiency_pct": inverter, "battery_efficiency_pct": battery}
        kpis |= {"peak_string_temperature_c": peak, "lost_kwh": 100.0 - inverter}
        lines.append(",".join(map(str, [name, "done", "", weight, *(kpis[key] for key in BASE)])))
    (tmp_path / "sweep.csv").write_text("\n".join(lines) + "\n")
    source = write_report(tmp_path).read_text(encoding="utf-8")
    text = " ".join(Page(tmp_path / "report.html").text.split())
    assert (
        "Knee of the front: objectives.inverter 0.4, with 97.90 % inverter and 98.90 % battery efficiency."
        in text
    )
    assert "3 of 3 scenarios lie on the front" in text
    for why, weight, peak in (("knee of the front", 0.4, 35), ("least lost", 1, 50), ("coolest", 0, 30)):
        (row,) = re.findall(rf'<th scope="row">{why}</th>(.*?)</tr>', source)
        first, *_, last = re.findall("<td>(.*?)</td>", row)
        assert (first, last) == (f"{weight:g}", f"{peak:.1f}"), why


@pytest.mark.usefixtures("comparison_alone")
def test_a_scenario_that_leaves_demand_unmet_is_not_recommended(tmp_path: Path) -> None:
    """The smallest inverters lose least, because they serve least."""
    columns = [*dict.fromkeys([*BASE, "lost_kwh", "unmet_kwh"])]
    lines = [",".join(["name", "status", "error", "inverter.nominal_kw", *columns])]
    for name, kw, lost, unmet in (
        ("a", 10, 50, 1100),
        ("b", 40, 90, 0),
        ("c", 60, 100, 0),
        ("d", 92, 110, 0),
    ):
        write_run(tmp_path / name, record(2, 24), name)
        kpis = BASE | {"lost_kwh": lost, "unmet_kwh": unmet}
        lines.append(",".join(map(str, [name, "done", "", kw, *(kpis[key] for key in columns)])))
    (tmp_path / "sweep.csv").write_text("\n".join(lines) + "\n")
    source = write_report(tmp_path).read_text(encoding="utf-8")
    assert "Not compared, because more demand is unmet: 1." in source
    (row,) = re.findall(r'<th scope="row">[^<]*least lost</th>(.*?)</tr>', source)
    assert re.findall("<td>(.*?)</td>", row)[0] == "40"


def test_many_scenarios_become_a_table_of_lines(tmp_path: Path) -> None:
    for index in range(10):
        write_run(tmp_path / f"w{index}", record(2, 24, concentrate=index / 9), f"w{index}")
    page = Page(write_report(tmp_path))
    assert not page.all("figure")
    assert {f"w{index}" for index in range(10)} <= set(page.text.split())


def test_the_page_allows_its_own_scripts_and_nothing_else(case_2: Path) -> None:
    source = (case_2 / "report.html").read_text(encoding="utf-8")
    (policy,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', source)
    rules = dict(rule.strip().split(" ", 1) for rule in html.unescape(policy).split(";"))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    scripts = re.findall(r"<script>(.*?)</script>", source, re.DOTALL)
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert len(scripts) == 2
    assert rules["script-src"].split() == [f"'sha256-{digest}'" for digest in hashes]
    assert not re.search(r'<[a-z]+ [^>]*\bon[a-z]+="', source[: source.index("Bokeh Contributors")])


def test_no_text_of_a_figure_ends_its_data(case_2: Path) -> None:
    for data in Page(case_2 / "report.html").data:
        assert "<" not in data and json.loads(data)
