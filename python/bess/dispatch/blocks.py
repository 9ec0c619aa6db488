"""Control steps of equal price merged into blocks of a plan: a smaller problem with the same income."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from bess.arrays import Array

_MAX_BLOCK_H: Final = 1.0
"""Longest block [h]: power and derating are constant within it."""


@dataclass(frozen=True)
class Blocks:
    """Consecutive steps of equal price on one day, at most one hour."""

    first: npt.NDArray[np.int64]
    """``(n_blocks,)``: first step of each."""
    count: npt.NDArray[np.int64]
    """``(n_blocks,)``: number of its steps."""

    @classmethod
    def of(
        cls,
        price_eur_mwh: Array,
        day: npt.NDArray[np.int64],
        dt_h: float,
        *,
        first_h: float = 0.0,
        step_h: float = 0.0,
    ) -> Self:
        """Start a new block at each change of the price or the day, and at the maximum length.

        With several rows of prices, a change in any row starts a block. In the first ``first_h`` hours the
        maximum length is ``step_h``, or one step if that is longer.
        """
        steps = np.arange(day.size)
        changes = (np.diff(np.atleast_2d(price_eur_mwh)) != 0.0).any(axis=0)
        change = np.r_[True, changes | (np.diff(day) != 0)]
        since = steps - np.maximum.accumulate(np.where(change, steps, 0))
        max_h = np.where(steps * dt_h < first_h, step_h, _MAX_BLOCK_H)
        first = np.flatnonzero(since % np.maximum(1, (max_h / dt_h + 1e-9).astype(int)) == 0)
        return cls(first, np.diff(np.r_[first, steps.size]))

    @classmethod
    def single(cls, n_steps: int) -> Self:
        """Return a block for each step."""
        return cls(np.arange(n_steps), np.ones(n_steps, dtype=np.int64))

    @cached_property
    def of_step(self) -> npt.NDArray[np.int64]:
        """Block number of each step."""
        return np.repeat(np.arange(self.first.size), self.count)

    def mean(self, values: Array) -> Array:
        """Return the block means of values by step (last axis)."""
        return np.asarray(np.add.reduceat(values, self.first, axis=-1) / self.count)

    def at_full(self, share: Array) -> Array:
        """Return the power of each step from the mean powers of blocks, both relative to maximum power.

        As in a vertex solution over single steps, the last steps of a block have full power, one step has the
        remainder, and the steps before are idle.
        """
        place = self.count[self.of_step] - 1 - np.arange(self.of_step.size) + self.first[self.of_step]
        whole = (np.abs(share) * self.count)[self.of_step] - place
        return np.asarray(np.sign(share)[self.of_step] * np.clip(whole, 0.0, 1.0))
