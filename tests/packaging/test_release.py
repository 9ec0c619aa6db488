"""Claims: one version, one address, a change log cut by a command, licences of all that is compiled in."""

import importlib.util
import json
import re
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def script(name: str) -> ModuleType:
    """A script of `.ci`, which is no package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def release() -> ModuleType:
    return script("release")


def test_every_file_that_states_the_version_states_that_of_the_workspace(release: ModuleType) -> None:
    for name, place in release.PLACES.items():
        found = re.search(place, (ROOT / name).read_text("utf-8"))
        assert found is not None and found[2] == release.version(), name


def test_a_cut_moves_what_is_unreleased_under_the_version_and_the_notes_are_that(release: ModuleType) -> None:
    log = "# Changelog\n\n## [Unreleased]\n\n### Added\n- A thing.\n\n## [0.1.0] - 2026-01-01\n- The first.\n"
    after = release.cut(log, "0.2.0", "2026-02-01")
    assert "## [Unreleased]\n\n## [0.2.0] - 2026-02-01\n\n### Added\n- A thing.\n" in after
    assert release.notes(after, "0.2.0") == "### Added\n- A thing.\n"
    assert release.notes(after, "0.1.0") == "- The first.\n"


def test_a_cut_of_nothing_or_of_a_released_version_is_refused(release: ModuleType) -> None:
    with pytest.raises(SystemExit, match="nothing is unreleased"):
        release.cut("## [Unreleased]\n\n## [0.1.0] - 2026-01-01\n- The first.\n", "0.2.0", "2026-02-01")
    with pytest.raises(SystemExit, match=r"0\.1\.0 has been released"):
        release.cut("## [Unreleased]\n- A thing.\n\n## [0.1.0] - 2026-01-01\n", "0.1.0", "2026-02-01")


def test_a_tag_that_is_not_the_version_is_refused(release: ModuleType) -> None:
    with pytest.raises(SystemExit, match=r"tag v99\.0\.0, but Cargo\.toml says"):
        release.main("check", "v99.0.0")


def test_manuals_stand_side_by_side_and_the_latest_release_is_the_front_page(tmp_path: Path) -> None:
    docs, html, site = script("place_docs"), tmp_path / "html", tmp_path / "site"
    html.mkdir()
    (html / "index.html").touch()
    for version in ("dev", "v0.9.0", "v0.10.0"):
        docs.place(html, site, version)
    listed = json.loads((site / "switcher.json").read_text("utf-8"))
    assert [(entry["version"], entry["preferred"]) for entry in listed] == [
        ("v0.10.0", True),
        ("v0.9.0", False),
        ("dev", False),
    ]
    assert "url=v0.10.0/" in (site / "index.html").read_text("utf-8")


def test_every_address_of_the_project_is_that_of_its_metadata() -> None:
    known = (PROJECT["urls"]["Repository"], PROJECT["urls"]["Documentation"].rstrip("/"))
    owner, name = known[0].split("/")[-2:]
    known += (f"https://raw.githubusercontent.com/{owner}/{name}/main/",)
    pages = [*ROOT.glob("*.md"), ROOT / "CITATION.cff", ROOT / "conda" / "recipe.yaml"]
    for path in (*pages, *(ROOT / ".github").rglob("*.yml")):
        for address in re.findall(rf"https://[^\s)>\"]*{owner}[^\s)>\"]*", path.read_text("utf-8")):
            assert address.startswith(known), f"{path.name}: {address}"


def test_the_page_on_a_package_index_has_no_link_into_a_checkout() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    links = re.findall(r"\]\(([^)]+)\)", readme)
    assert links != []
    assert [link for link in links if not link.startswith(("https://", "#"))] == []


def test_what_the_readme_installs_first_draws_the_report_that_it_shows() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    first = re.search(r"pip install \S+", readme)
    assert first is not None and first[0] == 'pip install "bess-powersplit[report]"'
    assert "bess.write_report(" in readme and "bess report " in readme


def test_links_of_the_readme_into_the_repository_lead_to_files() -> None:
    readme = (ROOT / "README.md").read_text("utf-8")
    paths = re.findall(r"/main/([^)#]+)", readme)
    assert len(paths) > 10
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_the_recipe_needs_what_the_package_needs() -> None:
    recipe = (ROOT / "conda" / "recipe.yaml").read_text("utf-8")
    for needed in PROJECT["dependencies"]:
        assert f"- {needed.replace('>=', ' >=')}\n" in recipe


def test_licences_are_there_for_the_versions_that_are_compiled_in() -> None:
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text("utf-8"))["package"]
    versions = {(package["name"], package["version"]) for package in locked}
    text = (ROOT / "THIRD-PARTY-LICENSES").read_text("utf-8")
    listed = set(re.findall(r"(?m)^-{80}\n(\S+) (\S+): ", text))
    assert {"pyo3", "numpy", "ndarray", "serde_json"} <= {name for name, _ in listed}
    assert listed <= versions
