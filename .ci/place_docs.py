"""Place a manual beside those of other versions: ``python .ci/place_docs.py HTML SITE VERSION``.

The front page leads to the latest release, or to ``dev`` before there is one. ``switcher.json`` is the list
that readers choose from.
"""

import json
import shutil
import sys
import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def place(html: Path, site: Path, version: str) -> None:
    """Replace the manual of one version in the site, and list all that are there."""
    shutil.rmtree(site / version, ignore_errors=True)
    shutil.copytree(html, site / version)
    releases = sorted(
        (folder.name for folder in site.glob("v*.*.*")),
        key=lambda name: [int(part) for part in name[1:].split(".")],
        reverse=True,
    )
    root = tomllib.loads(PYPROJECT.read_text("utf-8"))["project"]["urls"]["Documentation"].rstrip("/")
    shown = [*releases, *(["dev"] if (site / "dev").is_dir() else [])]
    entries = [{"version": name, "url": f"{root}/{name}/", "preferred": name == shown[0]} for name in shown]
    (site / "switcher.json").write_text(json.dumps(entries, indent=1), "utf-8")
    (site / "index.html").write_text(f'<meta http-equiv="refresh" content="0; url={shown[0]}/">\n', "utf-8")
    (site / ".nojekyll").touch()  # folders that begin with an underscore are served


if __name__ == "__main__":
    place(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
