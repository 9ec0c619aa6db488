"""Cut a release. The version has one place, ``Cargo.toml``; files that repeat it are written here.

``python .ci/release.py cut 0.2.0`` writes the version, closes *Unreleased* in ``CHANGELOG.md`` and prints the
commands that commit and tag. ``notes v0.2.0`` prints the section of a version, and fails without one;
``check v0.2.0`` also fails unless that is the version of the sources.
"""

import datetime
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLACES = {
    "Cargo.toml": r'(\[workspace\.package\]\nversion = ")([^"]+)',
    "CITATION.cff": r"(?m)(^version: )(.+)",
    "conda/recipe.yaml": r'(?m)(^  version: ")([^"]+)',
}
"""Files that state the version, with the text before it and itself as groups."""


def version() -> str:
    """Version of the sources."""
    found: str = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"]["package"]["version"]
    return found


def cut(changelog: str, new: str, day: str) -> str:
    """Return the change log with *Unreleased* as the section of a version, and an empty one above."""
    before, heading, after = changelog.partition("## [Unreleased]\n")
    if not heading or not after.partition("\n## [")[0].strip():
        raise SystemExit("CHANGELOG.md: nothing is unreleased; add the changes under '## [Unreleased]'")
    if f"\n## [{new}]" in changelog:
        raise SystemExit(f"CHANGELOG.md: {new} has been released; give a later version")
    return f"{before}{heading}\n## [{new}] - {day}\n{after}"


def notes(changelog: str, released: str) -> str:
    """Return the section of a released version, without its heading."""
    found = re.search(rf"(?ms)^## \[{re.escape(released)}\][^\n]*\n(.*?)(?=^## \[|\Z)", changelog)
    if found is None:
        raise SystemExit(f"CHANGELOG.md: no section '## [{released}]'; cut the release with `make release`")
    return found[1].strip() + "\n"


def main(command: str, given: str) -> None:
    """Do what the module says."""
    log = ROOT / "CHANGELOG.md"
    wanted = given.removeprefix("v")
    if not re.fullmatch(r"\d+\.\d+\.\d+", wanted):
        raise SystemExit(f"{given!r} is not a version; write it as 0.2.0")
    if command == "cut":
        text = cut(log.read_text("utf-8"), wanted, datetime.datetime.now(datetime.UTC).date().isoformat())
        for name, place in PLACES.items():
            content = (ROOT / name).read_text("utf-8")
            (ROOT / name).write_text(re.sub(place, rf"\g<1>{wanted}", content), "utf-8")
        log.write_text(text, "utf-8")
        subprocess.run(["cargo", "update", "--workspace", "--offline"], cwd=ROOT, check=True)
        print(f"git commit -am 'Release {wanted}' && git tag v{wanted} && git push origin HEAD v{wanted}")
    elif command == "check" and wanted != version():
        raise SystemExit(f"tag {given}, but Cargo.toml says {version()}; cut the release with `make release`")
    elif command in ("check", "notes"):
        print(notes(log.read_text("utf-8"), wanted))
    else:
        raise SystemExit(__doc__)


if __name__ == "__main__":
    main(*sys.argv[1:3])
