"""A twin's samples and events as server-sent events; zenoh is the way for programs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator

import orjson
from fastapi.sse import format_sse_event
from starlette.concurrency import run_in_threadpool

from api.twins.service import Twins

PERIOD_S = 0.1
"""A browser is shown the newest sample this often: more is not seen [s]."""

EVENTS_MAX = 50
"""Events told when a browser comes."""


async def stream(twins: Twins, twin_id: str, ending: threading.Event) -> AsyncIterator[bytes]:
    """News of a twin until the service ends; a reader that is slow misses samples, never events."""
    state = await run_in_threadpool(twins.state, twin_id)
    after = max(-1, state.events - EVENTS_MAX - 1)
    seen = None
    while not ending.is_set():
        live = twins.live(twin_id)
        current = live.current if live else None
        if current is not None and (current.epoch, current.seq) != seen:
            seen = (current.epoch, current.seq)
            yield format_sse_event(data_str=orjson.dumps(current.document()).decode(), event="sample")
        if live is None or live.told.events > after + 1:
            for event in await run_in_threadpool(twins.events, twin_id, after, EVENTS_MAX):
                after = event["seq"]
                yield format_sse_event(data_str=orjson.dumps(event).decode(), event="event", id=str(after))
        if live is None:
            return
        await asyncio.sleep(PERIOD_S)
