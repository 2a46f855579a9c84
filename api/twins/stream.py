"""A twin's samples and events as server-sent events; zenoh is the way for programs."""

from __future__ import annotations

import asyncio
import logging
import re
import threading
from collections.abc import AsyncIterator

import orjson
from fastapi.sse import format_sse_event
from starlette.concurrency import run_in_threadpool

from api.store.database import StoreError
from api.twins.service import Twins

log = logging.getLogger(__name__)

PERIOD_S = 0.1
"""A browser is shown the newest sample this often: more is not seen [s]."""

EVENTS_MAX = 50
"""Events told when a browser comes."""


_ID = re.compile(r"([0-9]{1,18})-([0-9]{1,18})")
"""Of an event on the stream: its epoch, and its number."""


def place(twins: Twins, twin_id: str, last: str | None) -> int:
    """Number of the event behind which a stream begins: the last ones at first, for who comes again those it missed.

    `last` is the id of the last event it had. An epoch that has begun since may have given that number anew.
    """
    told = twins.state(twin_id).events
    known = _ID.fullmatch(last or "")
    if known is None:
        return max(-1, told - EVENTS_MAX - 1)
    epoch, after = int(known[1]), min(int(known[2]), told - 1)
    while after >= 0:
        first = max(-1, after - EVENTS_MAX)
        found = [event for event in twins.events(twin_id, first, EVENTS_MAX) if event["seq"] <= after]
        had = [event["seq"] for event in found if event["epoch"] <= epoch]
        if had or not found:
            return max(had, default=after)
        after = first
    return after


async def stream(twins: Twins, twin_id: str, after: int, ending: threading.Event) -> AsyncIterator[bytes]:
    """News of a twin, of events those behind number `after`, until the service ends.

    A reader that is slow misses samples, never events; while the store is away, events wait and samples go on.
    """
    seen = None
    while not ending.is_set():
        live = twins.live(twin_id)
        current = live.current if live else None
        if current is not None and (current.epoch, current.seq) != seen:
            seen = (current.epoch, current.seq)
            yield format_sse_event(data_str=orjson.dumps(current.document()).decode(), event="sample")
        if live is None or live.told.events > after + 1:
            try:
                found = await run_in_threadpool(twins.events, twin_id, after, EVENTS_MAX)
            except StoreError as error:
                log.info("events of %s wait: %s", twin_id, error)
            else:
                for event in found:
                    after = event["seq"]
                    number = f"{event['epoch']}-{after}"
                    yield format_sse_event(data_str=orjson.dumps(event).decode(), event="event", id=number)
                if live is None and len(found) < EVENTS_MAX:
                    return
        await asyncio.sleep(PERIOD_S)
