"""Claims about the page for contributors: it counts what there is."""

import importlib.util
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_page_counts_the_mutations() -> None:
    spec = importlib.util.spec_from_file_location("mutations", ROOT / "tests/split/mutations.py")
    assert spec is not None and spec.loader is not None
    mutations = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(mutations)
    python, rust = len(mutations.PYTHON), len(mutations.RUST)
    of_proof = sum(path.startswith(mutations.PROOF) for _, path, *_ in mutations.RUST)
    page = " ".join((ROOT / "CONTRIBUTING.md").read_text("utf-8").split())
    assert f"in {python + rust} ways" in page
    counts = re.search(
        r"all (\d+) mutations of .* all (\d+) of the core, (\d+) of them in the proven bound", page
    )
    assert counts is not None and [int(n) for n in counts.groups()] == [python, rust, of_proof]
