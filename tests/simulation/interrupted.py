"""A run that is stopped after some steps and continued from its folder."""

from contextlib import contextmanager
from pathlib import Path

import pytest
import xarray as xr

import bess
from bess.simulation import runner


def continued(study: bess.Study, folder: Path, monkeypatch: pytest.MonkeyPatch) -> xr.Dataset:
    """Record of a run in parts of 7 steps that is stopped after 40 looks at the flag, and continued."""
    stops = iter([False] * 40)

    @contextmanager
    def stopping():
        yield lambda: next(stops, True)

    with monkeypatch.context() as patched:
        patched.setattr(runner, "MAX_PART_STEPS", 7)
        patched.setattr(runner, "stop_requests", stopping)
        with pytest.raises(bess.StoppedEarly):
            bess.run(study, progress=False, out=folder)
    return bess.run(study, progress=False, out=folder, resume=True).dataset
