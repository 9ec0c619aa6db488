"""A run that ends as in a power cut, after so many control steps, with what it had written by then."""

from pathlib import Path
from typing import Any

import pytest

import bess
from bess.study import Study


class PowerCut(BaseException):
    """Stands for the end of the process; nothing in the package catches it."""


def cut_off(study: Study, folder: Path, after: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run ``study`` into ``folder``; the plant takes ``after`` steps and no more."""
    step, left = bess.Plant.step, iter(range(after))

    def cut(plant: bess.Plant, *arguments: Any, **options: Any) -> Any:
        if next(left, None) is None:
            raise PowerCut
        return step(plant, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(bess.Plant, "step", cut)
        with pytest.raises(PowerCut):
            bess.run(study, progress=False, out=folder)
