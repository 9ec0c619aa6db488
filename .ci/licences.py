"""Write ``THIRD-PARTY-LICENSES``: the crates compiled into the core, with their licence texts.

``--check`` fails if it is not current.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "THIRD-PARTY-LICENSES"
HEAD = """\
The compiled core of bess holds the crates below and the Rust standard library
(MIT OR Apache-2.0, copyright The Rust Project Developers). Where a crate may be
had under Apache-2.0, that licence is the text in LICENSE; all other texts of the
crate follow. Written by .ci/licences.py.
"""


def _cargo(*arguments: str) -> str:
    command = ["cargo", *arguments, "--locked"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def compiled() -> set[tuple[str, str]]:
    """Name and version of each crate of others that is part of the library on some system."""
    tree = ("tree", "-p", "bess-py", "-e", "normal,no-proc-macro", "--target", "all", "--prefix", "none")
    lines = (line.split() for line in _cargo(*tree, "--format", "{p}").splitlines())
    return {(name, version[1:]) for name, version, *_ in lines if not name.startswith("bess-")}


def text() -> str:
    """Content of the file."""
    wanted = compiled()
    parts = [HEAD]
    for crate in json.loads(_cargo("metadata", "--format-version", "1"))["packages"]:
        if (crate["name"], crate["version"]) not in wanted:
            continue
        parts.append(
            f"{'-' * 80}\n{crate['name']} {crate['version']}: {crate['license']}\n{crate['repository']}\n"
        )
        for path in sorted(Path(crate["manifest_path"]).parent.glob("*")):
            if re.match(r"(?i)(un)?licen[cs]e|copying|notice", path.name) and path.is_file():
                content = path.read_text("utf-8").strip()
                if "TERMS AND CONDITIONS FOR USE, REPRODUCTION" not in content:  # Apache-2.0
                    parts.append(f"{content}\n")
    return "\n".join(parts)


if __name__ == "__main__":
    current = text()
    if sys.argv[1:] != ["--check"]:
        TARGET.write_text(current, "utf-8")
    elif TARGET.read_text("utf-8") != current:
        raise SystemExit(f"{TARGET.name}: not that of Cargo.lock; run python .ci/licences.py")
