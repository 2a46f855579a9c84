"""Queries about twins, answered on threads of their own: the store may take its time, zenoh's threads may not."""

from __future__ import annotations

import logging
import queue
import re
import threading
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Any

import orjson
import zenoh

from api.http.pagination import FAR
from api.http.problems import MEDIA_TYPE, ProblemError, problem_from
from api.store.patience import REQUEST_S, patient
from api.telemetry.topics import COMMAND, EVENT, HISTORY, SAMPLE, SIGNAL, key
from api.twins.messages import VERSION, signals
from api.twins.service import Twins
from station import InputError

log = logging.getLogger(__name__)

WAITING_MAX = 1000
"""Queries that may wait; beyond it the answer is that the service is busy."""

SAMPLES_MAX = 1000
"""Most samples in an answer: some 800 kB."""

EVENTS_MAX = 1000
"""Most events in an answer."""

PAYLOAD_MAX = 64_000
"""Largest command [bytes]."""

_WHOLE = re.compile(r"-?[0-9]{1,19}")

_PARTS = len(key("TWIN", HISTORY).split("/"))

QueryHandler = Callable[[zenoh.Query], None]


class QueryWorker:
    """Answers queries in the order in which they came."""

    def __init__(self, name: str) -> None:
        self._waiting: queue.Queue[tuple[zenoh.Query, QueryHandler] | None] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, query: zenoh.Query, answer: QueryHandler) -> None:
        """Answer soon; called on zenoh's threads."""
        try:
            self._waiting.put_nowait((query, answer))
        except queue.Full:
            busy = ProblemError(HTTPStatus.TOO_MANY_REQUESTS, "full", "Busy", f"{WAITING_MAX} queries are waiting")
            with query:
                _refuse(query, busy)

    def close(self) -> None:
        """Stop answering: who still waits gets no answer. Nobody may `put` any more."""
        with suppress(queue.Empty):
            while (item := self._waiting.get_nowait()) is not None:
                with item[0]:
                    pass
        self._waiting.put(None)
        self._thread.join(1.0)

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            query, answer = item
            try:
                with query:
                    try:
                        with patient(REQUEST_S):
                            answer(query)
                    except Exception as error:  # noqa: BLE001  # whatever it is, the asker is told
                        _refuse(query, problem_from(error))
            except zenoh.ZError as error:
                log.info("an answer was not taken: %s", error)


class QueryHandlers:
    """Handlers of queries. Commands have a worker of their own: each waits until it is stored, and no query for it."""

    def __init__(self, twins: Twins) -> None:
        self._twins = twins
        self.questions, self.commands = QueryWorker("questions"), QueryWorker("commands")

    def close(self) -> None:
        """Stop answering."""
        self.questions.close()
        self.commands.close()

    def sample(self, twin: str, query: zenoh.Query) -> None:
        """The newest sample."""
        live = self._twins.live(twin)
        if live is not None and live.current is not None:
            _reply(query, key(twin, SAMPLE), live.current.document())

    def signals(self, twin: str, query: zenoh.Query) -> None:
        """The newest value of each signal that is asked for."""
        live = self._twins.live(twin)
        if live is None or live.current is None:
            return
        for name, document in signals(live.current):
            if query.key_expr.intersects(zenoh.KeyExpr(key(twin, SIGNAL, name))):
                _reply(query, key(twin, SIGNAL, name), document)

    def _twin(self, query: zenoh.Query, what: str) -> str | None:
        """The one twin whose key `what` is asked; None where it is another server's."""
        twin = _one(query, what)
        return twin if self._twins.known(twin) else None

    def events(self, query: zenoh.Query) -> None:
        """Events behind number `after`; the last ones where it is left out."""
        twin = self._twin(query, EVENT)
        if twin is None:
            return
        limit = _number(query, "limit", 100, 1, EVENTS_MAX)
        told = self._twins.state(twin).events
        if query.parameters.get("after") is None:
            found = self._twins.last_events(twin, FAR, limit)
        else:
            found = self._twins.events(twin, _number(query, "after", -1, -1, FAR), limit)
        _reply(query, key(twin, EVENT), {"version": VERSION, "twin": twin, "told": told, "events": found})

    def history(self, query: zenoh.Query) -> None:
        """Samples from number `from` on, from the store and from memory."""
        twin = self._twin(query, HISTORY)
        if twin is None:
            return
        first = _number(query, "from", 0, 0, 2**62)
        limit = _number(query, "limit", SAMPLES_MAX, 1, SAMPLES_MAX)
        found = self._twins.history(twin, first, limit)
        epochs = self._twins.epochs(twin)
        document = {
            "version": VERSION, "twin": twin, "epoch": max(epochs, default=0), "first": first,
            "next": found[-1].seq + 1 if found else first, "end": self._twins.samples(twin),
            "thinned_to": self._twins.thinned_to(twin),
            "epochs": {str(epoch): begin for epoch, begin in epochs.items()},
            "samples": [sample.document() for sample in found],
        }  # fmt: skip
        _reply(query, key(twin, HISTORY), document)

    def command(self, twin: str, query: zenoh.Query) -> None:
        """Do what the payload says; the twin's state then."""
        _one(query, COMMAND)  # `stop` to every twin at once is more likely a slip than a wish
        payload = b"" if query.payload is None else query.payload.to_bytes()
        if len(payload) > PAYLOAD_MAX:
            message = f"must not exceed {PAYLOAD_MAX} bytes; given {len(payload)}"
            raise InputError("command", [("", message)])
        try:
            document = orjson.loads(payload)
        except orjson.JSONDecodeError as error:
            raise InputError("command", [("", f"is not JSON: {error}")]) from None
        state = self._twins.command(twin, document)
        query.reply(key(twin, COMMAND), state.model_dump_json(), encoding=zenoh.Encoding.APPLICATION_JSON)


def _one(query: zenoh.Query, what: str) -> str:
    """The one twin whose key `what` a query names; InputError where wildcards name several."""
    given = str(query.key_expr)
    parts = given.split("/")
    if "*" in given or len(parts) != _PARTS:
        raise InputError("query", [("key", f"must be {key('TWIN', what)} of one twin; given {given!r:.100}")])
    return parts[2]


def _number(query: zenoh.Query, name: str, default: int, low: int, high: int) -> int:
    text = query.parameters.get(name)
    if text is None:
        return default
    number = int(text) if _WHOLE.fullmatch(text) else low - 1
    if not low <= number <= high:
        raise InputError("query", [(name, f"must be a whole number from {low} to {high}; given {text!r:.40}")])
    return number


def _reply(query: zenoh.Query, name: str, document: dict[str, Any]) -> None:
    query.reply(name, orjson.dumps(document), encoding=zenoh.Encoding.APPLICATION_JSON)


def _refuse(query: zenoh.Query, error: ProblemError) -> None:
    encoding = zenoh.Encoding.APPLICATION_JSON.with_schema(MEDIA_TYPE)
    query.reply_err(error.problem.model_dump_json(exclude_defaults=True), encoding=encoding)
