"""A twin's samples and events as server-sent events; zenoh is the way for programs."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from itertools import takewhile
from typing import Any

from api.store.database import StoreError
from api.twins.broadcast import Broadcast, EncodedMessage, TwinBuffer, body
from api.twins.live import LiveTwin
from api.twins.messages import Event
from api.twins.schemas import ALIVE, MAX
from api.twins.service import Twins

log = logging.getLogger(__name__)

PERIOD_S = 0.1
"""Of a twin that is faster a reader is shown the newest sample this often: more is not seen [s]."""

EVENTS_FIRST = 50
"""Events told to a reader that comes for the first time."""

EVENTS_READ = 200
"""Events read from the store at once."""

LOOK_S = 0.5
"""How often a reader looks whether the service ends [s]."""

HEARTBEAT_S = 1.0
"""A stream tells this often that all there was to tell has been told: who hears nothing for seconds knows that what it
has is old [s]."""


@dataclass(frozen=True, slots=True)
class StreamCursor:
    """The progress of a reader. Its text is the id of a server-sent event."""

    born: int  # when the twin was started [ms, Unix time]: another may have its id later
    epoch: int
    sample: int  # -1: none
    event: int  # -1: none

    def __str__(self) -> str:
        return f"{self.born}.{self.epoch}.{self.sample}.{self.event}"

    @classmethod
    def parse(cls, text: str | None) -> StreamCursor | None:
        """The place that `str` wrote; None of anything else: who sends that begins anew."""
        parts = (text or "").split(".")
        if len(parts) == 4 and all(len(part) < 16 for part in parts):
            with suppress(ValueError):
                place = cls(*map(int, parts))
                if min(place.born, place.epoch) >= 0 and min(place.sample, place.event) >= -1:
                    return place
        return None


async def stream(
    twins: Twins, twin_id: str, place: StreamCursor, broadcast: Broadcast, ending: threading.Event
) -> AsyncIterator[bytes]:
    """News of a twin behind a place, until it ends, or the service.

    All events, samples as far as the reader keeps up, and heartbeats. While the store is away, events wait that only
    it has.
    """
    with broadcast.reading(twin_id) as news, closing(_Reader(twins, twin_id, news, place)) as reader:
        first: LiveTwin | None = None
        while not ending.is_set():
            turn, live = news.turn, twins.running(twin_id)
            first = first or live
            if live is not None and (live.epoch != place.epoch or live is not first):
                return  # it has just begun anew, and tells some numbers again: who comes again begins with those
            events = await reader.events()  # which may take a while: samples are looked at when they are sent
            part = b"".join([*events, *reader.samples(live), *reader.heartbeat(live)])
            if part:
                yield part
            if live is None and not reader.behind:
                return
            if part and live is not None and _fast(live):
                await asyncio.sleep(PERIOD_S)
            if not (events and reader.behind):  # the store has more
                await news.wait(turn, LOOK_S)


def begin(twins: Twins, twin_id: str, last: StreamCursor | None) -> StreamCursor:
    """The cursor at which a stream begins: some events ago, or after a reader's last place.

    Numbers of what was told, but not stored, before the service was killed have been given anew since then; what has
    them now is told, too.
    """
    begun = twins.begun(twin_id)
    state = twins.state(twin_id)
    born = round(1000 * datetime.fromisoformat(state.created).timestamp())
    if last is None or last.born != born or last.epoch > state.epoch:
        return StreamCursor(born, state.epoch, -1, max(-1, state.events - EVENTS_FIRST - 1))
    if last.epoch == state.epoch or (state.state in ALIVE and not begun):  # not known where: it is being taken up
        return last
    sample, event = twins.told_since(twin_id, last.epoch)
    return StreamCursor(born, state.epoch, min(last.sample, sample - 1), min(last.event, event - 1))


def _fast(live: LiveTwin) -> bool:
    """Whether a twin is faster than readers are shown samples."""
    return live.request.speed == MAX or float(live.request.speed) * PERIOD_S > 1.0


class _Reader:
    """The messages that one reader has not received yet."""

    def __init__(self, twins: Twins, twin_id: str, news: TwinBuffer, place: StreamCursor) -> None:
        self._twins = twins
        self._twin_id = twin_id
        self._news = news
        self._place = place
        self._first = True  # no sample was sent yet
        self._beat = -math.inf  # when the last heartbeat was sent [s, monotonic]
        self._asked: asyncio.Task[Sequence[dict[str, Any]] | None] | None = None  # events asked of the store
        self._asked_behind = -1  # behind this one
        self.behind = True  # the store may have events that the news have not

    def close(self) -> None:
        """Wait for nothing any more."""
        if self._asked is not None:
            self._asked.cancel()

    def heartbeat(self, live: LiveTwin | None) -> Iterator[bytes]:
        """The state of a live twin, when it is due; what was told until then stands before it in the stream."""
        now = time.monotonic()
        if live is None or now - self._beat < HEARTBEAT_S:
            return
        self._beat = now
        yield self._sent(body("heartbeat", {"twin": self._twin_id, "sent": round(time.time(), 3), "state": live.state}))

    def samples(self, live: LiveTwin | None) -> Iterator[bytes]:
        """Samples behind its place: of a fast twin the newest. A `gap` before one says which are left out."""
        fresh = [told for told in self._news.samples() if self._is_new(told.what.epoch, told.what.seq)]
        current = live.current if live else None
        if not fresh and current is not None and self._is_new(current.epoch, current.seq):
            fresh = [EncodedMessage(current)]
        fast = live is not None and _fast(live)
        for told in fresh[-1:] if fast or self._place.sample < 0 else fresh:  # nobody begins with what is seconds old
            expected, seq = self._place.sample + 1, told.what.seq
            self._place = replace(self._place, sample=seq)
            if 0 < expected < seq and (self._first or not fast):
                yield self._sent(body("gap", {"twin": self._twin_id, "first": expected, "last": seq - 1}))
            self._first = False
            yield self._sent(told.body)

    def _is_new(self, epoch: int, sample: int) -> bool:
        return epoch == self._place.epoch and sample > self._place.sample

    async def events(self) -> list[bytes]:
        """The next events behind its place, from the store as long as the news do not go back that far.

        What is told while the store is read is in the news, so a twin that tells much keeps nobody reading the store.
        None of a later epoch: a twin may have been taken up since a moment ago, and begins with numbers it gave before.
        """
        if self._is_behind():
            documents = await self._answered()
            if documents is None:
                return []
            self.behind = len(documents) == EVENTS_READ
            if documents:
                return [self._event(document["seq"], body("event", document)) for document in documents]
        return [self._event(told.what.seq, told.body) for told in self._news.events() if self._follows(told.what)]

    def _is_behind(self) -> bool:
        """Whether the news do not go back as far as its place."""
        known = next((told.what.seq for told in self._news.events() if told.what.epoch == self._place.epoch), None)
        if known is not None:
            self.behind = known > self._place.event + 1
        return self.behind

    def _follows(self, event: Event) -> bool:
        return event.epoch == self._place.epoch and event.seq > self._place.event

    async def _answered(self) -> Sequence[dict[str, Any]] | None:
        """The store's answer; None as long as there is none: samples and heartbeats continue meanwhile."""
        if self._asked_behind != self._place.event:  # the news have told what was asked for
            self.close()
            self._asked = None
        if self._asked is None:
            self._asked, self._asked_behind = asyncio.create_task(self._stored_events()), self._place.event
        await asyncio.wait({self._asked}, timeout=LOOK_S)
        if not self._asked.done():
            return None
        asked, self._asked = self._asked, None
        return asked.result()

    async def _stored_events(self) -> Sequence[dict[str, Any]] | None:
        try:
            found = await self._news.asking(partial(self._twins.events, self._twin_id, self._place.event, EVENTS_READ))
        except StoreError as error:
            log.info("events of %s wait: %s", self._twin_id, error)
            return None
        return list(takewhile(lambda event: event["epoch"] <= self._place.epoch, found))

    def _event(self, seq: int, event: bytes) -> bytes:
        self._place = replace(self._place, event=seq)
        return self._sent(event)

    def _sent(self, what: bytes) -> bytes:
        return b"%bid: %b\n\n" % (what, str(self._place).encode())
