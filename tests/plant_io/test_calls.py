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
