"""Threads that answer requests: those that may wait for the store, and those that never do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import ParamSpec, TypeVar

from anyio import CapacityLimiter, to_thread

MEMORY_THREADS = 8
"""Answers from memory take milliseconds: a few threads are enough, as long as nothing else takes them."""

Given = ParamSpec("Given")
Result = TypeVar("Result")


class Threads:
    """Lets what is in memory be answered while every other thread waits for the store."""

    def __init__(self) -> None:
        self._memory = CapacityLimiter(MEMORY_THREADS)

    async def run(
        self, in_memory: bool, act: Callable[Given, Result], /, *given: Given.args, **named: Given.kwargs
    ) -> Result:
        """The result of `act`, from a thread; `in_memory` promises that it does not wait for the store."""
        return await to_thread.run_sync(partial(act, *given, **named), limiter=self._memory if in_memory else None)
