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
from api.http.timeseries import MEDIA, Format
from api.store.patience import REQUEST_S, patient
from api.telemetry.topics import ALARMS, COMMAND, EVENT, HISTORY, MEASUREMENT, SAMPLE, SIGNAL, key
from api.twins.measurement_schemas import SEQUENCE_MAX, SOURCE_PATTERN
from api.twins.messages import VERSION, signals
from api.twins.service import Twins
from station import InputError

log = logging.getLogger(__name__)

WAITING_MAX = 1000
"""Queries that may wait; beyond it the answer is that the service is busy."""

WAITING_BYTES_MAX = 64_000_000
"""What the payloads of queries that wait may take together [bytes]."""

SAMPLES_MAX = 1000
"""Most samples in an answer: some 800 kB."""

EVENTS_MAX = 1000
"""Most events in an answer."""

PAYLOAD_MAX = 64_000
"""Largest command [bytes]."""

_WHOLE = re.compile(r"-?[0-9]{1,19}")

_SOURCE = re.compile(SOURCE_PATTERN)

_PARTS = len(key("TWIN", HISTORY).split("/"))

QueryHandler = Callable[[zenoh.Query], None]


class QueryWorker:
    """Answers queries in the order in which they came."""

    def __init__(self, name: str) -> None:
        self._waiting: queue.Queue[tuple[zenoh.Query, QueryHandler] | None] = queue.Queue(WAITING_MAX)
        self._bytes = 0  # of the payloads that wait
        self._counting = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, query: zenoh.Query, answer: QueryHandler) -> None:
        """Answer soon; called on zenoh's threads."""
        size = _size(query)
        with self._counting:
            taken = self._bytes + size <= WAITING_BYTES_MAX
            self._bytes += size if taken else 0
        if not taken:
            _busy(query, f"payloads of {WAITING_BYTES_MAX} bytes are waiting")
            return
        try:
            self._waiting.put_nowait((query, answer))
        except queue.Full:
            self._forget(size)
            _busy(query, f"{WAITING_MAX} queries are waiting")

    def _forget(self, size: int) -> None:
        with self._counting:
            self._bytes -= size

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
            self._forget(_size(query))
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
    """Handlers of queries.

    Commands and measurements have a worker each: they wait until they are stored, and no query for them.
    """

    def __init__(self, twins: Twins) -> None:
        self._twins = twins
        self.questions, self.commands = QueryWorker("questions"), QueryWorker("commands")
        self.measurements = QueryWorker("measurements")

    def close(self) -> None:
        """Stop answering."""
        self.questions.close()
        self.commands.close()
        self.measurements.close()

    def sample(self, twin: str, query: zenoh.Query) -> None:
        """The newest sample."""
        live = self._twins.live(twin)
        if live is not None and live.current is not None:
            _reply(query, key(twin, SAMPLE), live.current.document())

    def alarms(self, twin: str, query: zenoh.Query) -> None:
        """The alarms that are shown, and the figures of the alarm system."""
        live = self._twins.live(twin)
        if live is not None and live.alarms is not None:
            found = self._twins.alarms(twin).model_dump_json()
            query.reply(key(twin, ALARMS), found, encoding=zenoh.Encoding.APPLICATION_JSON)

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

    def measurement(self, twin: str, query: zenoh.Query) -> None:
        """Store the measurements of the payload; without one, the newest that each source has sent."""
        _one(query, MEASUREMENT)
        name = key(twin, MEASUREMENT)
        if query.payload is None:
            query.reply(name, self._twins.sources(twin).model_dump_json(), encoding=zenoh.Encoding.APPLICATION_JSON)
            return
        source = query.parameters.get("source") or ""
        if not _SOURCE.fullmatch(source):
            message = f"must be 1 to 64 letters, digits, '.', '_', ':' or '-'; given {source!r:.100}"
            raise InputError("query", [("source", message)])
        sequence = _number(query, "sequence", -1, 0, SEQUENCE_MAX)
        if sequence < 0:
            raise InputError("query", [("sequence", f"must be a whole number from 0 to {SEQUENCE_MAX}; not given")])
        encoding = zenoh.Encoding.ZENOH_BYTES if query.encoding is None else query.encoding
        media = MEDIA[Format.JSON] if encoding == zenoh.Encoding.ZENOH_BYTES else str(encoding)
        batch = self._twins.read_batch(twin, query.payload.to_bytes(), media)
        stored = self._twins.store_batch(twin, source, sequence, batch)
        query.reply(name, stored.model_dump_json(), encoding=zenoh.Encoding.APPLICATION_JSON)


def _size(query: zenoh.Query) -> int:
    return 0 if query.payload is None else len(query.payload)


def _busy(query: zenoh.Query, why: str) -> None:
    with query:
        _refuse(query, ProblemError(HTTPStatus.TOO_MANY_REQUESTS, "full", "Busy", why))


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
