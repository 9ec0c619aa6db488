"""Calls to many strings at once: results, expected errors, and others."""

import asyncio
import gc
from typing import Any

import pytest

from bess.edge.plant_io.calls import Rounds


def test_of_several_unexpected_errors_the_first_is_raised_and_none_is_left_to_the_event_loop() -> None:
    left: list[dict[str, Any]] = []

    async def fails(key: int) -> None:
        raise KeyError(key)

    async def round_of_three() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: left.append(context))
        rounds: Rounds[int, None] = Rounds(ValueError)
        with pytest.raises(KeyError, match="1"):
            await rounds([1, 2, 3], fails, lambda key: asyncio.Semaphore())
        gc.collect()

    asyncio.run(round_of_three())
    assert left == []


def test_a_round_that_is_cancelled_ends_all_of_its_calls() -> None:
    left: list[dict[str, Any]] = []
    written: list[int] = []

    async def write(key: int) -> None:
        if key == 0:
            raise KeyError(key)
        await asyncio.sleep(0.02)
        written.append(key)

    async def cancelled_round() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: left.append(context))
        rounds: Rounds[int, None] = Rounds(ValueError)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(rounds([0, 1, 2], write, lambda key: asyncio.Semaphore()), 0.005)
        await asyncio.sleep(0.05)
        gc.collect()

    asyncio.run(cancelled_round())
    assert (written, left) == ([], [])
