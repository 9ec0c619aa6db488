"""Claim: names, signatures, keys, record, commands and routes of the last release are still there."""

from pathlib import Path

import pytest

pytest.importorskip("fastapi")

from surface import STORED, broken, surface


def test_every_promise_of_the_last_release_is_kept(tmp_path: Path) -> None:
    lost = broken(STORED.read_text("utf-8").splitlines(), surface(tmp_path))
    assert lost == [], (
        "the public surface has lost or changed lines; users need a deprecation first (docs/stability.md).\n"
        "If it is meant: `make surface` (python tests/surface.py), commit tests/surface.txt,\n"
        "add a line to CHANGELOG.md:\n" + "\n".join(lost)
    )


@pytest.mark.parametrize(
    ("promised", "here", "lost"),
    [
        ("bess.run(study)", "bess.run(study, out=None)", False),
        ("bess.run(study, *, out=None)", "bess.run(study, *, out=None, resume=False)", False),
        ("bess.State.copy()", "bess.State.copy(deep=True)", False),
        ("bess.run(study)", "bess.run(study, system)", True),
        ("bess.run(study, *, out=None)", "bess.run(study)", True),
        ("bess.run(study, out=None)", "bess.run(study, out='.')", True),
        ("record soc [1]", "record soc [%]", True),
    ],
)
def test_an_optional_parameter_at_the_end_breaks_no_call(promised: str, here: str, lost: bool) -> None:
    assert bool(broken([promised], [here])) is lost
