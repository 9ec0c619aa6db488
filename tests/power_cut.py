"""A run that ends as in a power cut, after so many control steps, with what it had written by then."""

from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

import bess
from bess.study import Study


class PowerCut(BaseException):
    """Stands for the end of the process; nothing in the package catches it."""


def before_steps(patch: pytest.MonkeyPatch, act: Callable[[int], None]) -> None:
    """Call ``act`` with the number of control steps that the plant is about to take."""
    run, follow = bess.Plant.run, bess.Plant.run_controller

    def known(plant: bess.Plant, request_kw: Any, *arguments: Any, **options: Any) -> Any:
        act(len(request_kw))
        return run(plant, request_kw, *arguments, **options)

    def controlled(plant: bess.Plant, controller: Any, ahead_kw: Any, *arguments: Any) -> Any:
        act(len(ahead_kw))
        return follow(plant, controller, ahead_kw, *arguments)

    patch.setattr(bess.Plant, "run", known)
    patch.setattr(bess.Plant, "run_controller", controlled)


def cut_off(study: Study, folder: Path, after: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run ``study`` into ``folder``; the plant takes ``after`` steps and no more."""
    left = iter(range(after))

    def cut(steps: int) -> None:
        if len(list(islice(left, steps))) < steps:
            raise PowerCut

    with monkeypatch.context() as patch:
        before_steps(patch, cut)
        with pytest.raises(PowerCut):
            bess.run(study, progress=False, out=folder)
