"""Messages of live twins for many readers: each waits in the event loop, and nothing is encoded twice."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Generic, TypeVar

import orjson
from fastapi.sse import format_sse_event
from starlette.concurrency import run_in_threadpool

from api.store.patience import REQUEST_S, patient
from api.twins.messages import Event, Sample

SAMPLES_RECENT = 32
"""Samples kept for readers that are a little late; who is later is told of the gap."""

EVENTS_RECENT = 256
"""Events likewise; who is later is given them from the store."""

BATCH_WINDOW_S = 0.005
"""Readers are woken so long after the first news, so that a second and its events are one message to each [s]."""

ASKING_MAX = 4
"""Readers of a twin that are in the store at once: many that come together leave threads to other requests."""

Message = TypeVar("Message", Sample, Event)
Result = TypeVar("Result")


class EncodedMessage(Generic[Message]):
    """A sample or an event, and what is sent of it."""

    def __init__(self, what: Message) -> None:
        self.what: Message = what

    @cached_property
    def body(self) -> bytes:
        """Its server-sent event but for the id, which is the reader's."""
        return body("sample" if isinstance(self.what, Sample) else "event", self.what.document())


def body(kind: str, document: object) -> bytes:
    """A server-sent event that still wants its id and the empty line."""
    return format_sse_event(event=kind, data_str=orjson.dumps(document).decode()).removesuffix(b"\n")


class TwinBuffer:
    """The last messages of one twin. Its thread adds; readers, all of one event loop, take."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.readers = 0
        self._loop = loop
        self._lock = threading.Lock()
        self._samples: deque[EncodedMessage[Sample]] = deque(maxlen=SAMPLES_RECENT)
        self._events: deque[EncodedMessage[Event]] = deque(maxlen=EVENTS_RECENT)
        self._waking = False
        self._asking = asyncio.Semaphore(ASKING_MAX)
        self.turn = asyncio.Event()
        """Set when there is more than there was while this was the turn."""

    def add_sample(self, sample: Sample) -> None:
        """Keep a sample, and wake the readers."""
        with self._lock:
            self._samples.append(EncodedMessage(sample))
        self.wake()

    def add_event(self, event: Event) -> None:
        """Keep an event, and wake the readers."""
        with self._lock:
            self._events.append(EncodedMessage(event))
        self.wake()

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._samples.clear()
            self._events.clear()

    def wake(self) -> None:
        """Let the readers go on soon; from any thread."""
        if not self._waking:
            self._waking = True
            with suppress(RuntimeError):  # the loop has ended, and its readers
                self._loop.call_soon_threadsafe(self._loop.call_later, BATCH_WINDOW_S, self._wake)

    def _wake(self) -> None:
        self._waking = False
        turned, self.turn = self.turn, asyncio.Event()
        turned.set()

    @staticmethod
    async def wait(turn: asyncio.Event, patience_s: float) -> None:
        """Until there is more than there was in a turn, at most so long."""
        with suppress(TimeoutError):
            await asyncio.wait_for(turn.wait(), patience_s)

    async def asking(self, question: Callable[[], Result]) -> Result:
        """The store's answer; few readers ask at a time."""

        def ask() -> Result:
            with patient(REQUEST_S):  # the request that opened the stream arrived long ago
                return question()

        async with self._asking:
            return await run_in_threadpool(ask)

    def samples(self) -> Sequence[EncodedMessage[Sample]]:
        """The last samples, in order."""
        with self._lock:
            return tuple(self._samples)

    def events(self) -> Sequence[EncodedMessage[Event]]:
        """The last events, in order."""
        with self._lock:
            return tuple(self._events)


class Broadcast:
    """Listens to every twin, and keeps the news of those that somebody reads."""

    def __init__(self) -> None:
        self._news: dict[str, TwinBuffer] = {}

    @contextmanager
    def reading(self, twin: str) -> Iterator[TwinBuffer]:
        """The news of a twin, kept from now on as long as anybody reads; in the readers' event loop."""
        news = self._news.setdefault(twin, TwinBuffer(asyncio.get_running_loop()))
        news.readers += 1
        try:
            yield news
        finally:
            news.readers -= 1
            if news.readers == 0:
                del self._news[twin]

    @property
    def readers(self) -> int:
        """How many streams are open."""
        return sum(news.readers for news in list(self._news.values()))

    # An observer of twins (api.twins.messages); called from the twins' threads.

    def opened(self, twin: str) -> None:
        """It begins anew: what another of its id has told is no news of it."""
        if (news := self._news.get(twin)) is not None:
            news.clear()

    def sample(self, sample: Sample) -> None:
        """A second was simulated."""
        if (news := self._news.get(sample.twin)) is not None:
            news.add_sample(sample)

    def event(self, event: Event) -> None:
        """Something happened."""
        if (news := self._news.get(event.twin)) is not None:
            news.add_event(event)

    def closed(self, twin: str) -> None:
        """The readers see that it has ended."""
        if (news := self._news.get(twin)) is not None:
            news.wake()
