"""The header Idempotency-Key: a request that is sent again gets the answer of the first time, and does nothing again.

After the IETF draft "The Idempotency-Key HTTP Header Field". An answer is kept in the transaction of what it answers
for: whoever got it, or lost it on the way, finds that thing and the key together, or neither. A request that was
refused leaves its key free.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from http import HTTPStatus
from typing import Annotated, TypeVar

from fastapi import Depends, Header, Request
from pydantic import BaseModel
from starlette.responses import Response

from api.http.dependencies import SettingsDep, provided
from api.http.in_flight import Flights
from api.http.problems import ProblemError
from api.settings import Settings
from api.store.idempotency import IdempotencyRepository
from api.store.records import Full, KeptAnswer, KeyTaken, NotYet

Made = TypeVar("Made")

Keep = Callable[[Made], KeptAnswer]
"""Called in the transaction that stores what was made: the answer to keep with it."""

REPLAYED = "Idempotency-Replayed"
"""Header of an answer that was given before."""

Key = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        pattern=r"^[\x21-\x7e]{1,255}$",
        description="1 to 255 visible ASCII characters of yours, new for each thing to create: a request that is sent "
        "again with it gets the same answer, and creates nothing",
        examples=["8e03978e-40d5-43dd-bc93-6894a57f9324"],
    ),
]


class Once:
    """One request that creates something, and may carry a key."""

    def __init__(
        self, stored: IdempotencyRepository, flights: Flights, settings: Settings, owner: str, key: str | None,
        digest: bytes,
    ) -> None:  # fmt: skip
        self._stored = stored
        self._flights = flights
        self._settings = settings
        self._owner = owner
        self._key = key
        self._digest = digest

    def answer(
        self, status: HTTPStatus, make: Callable[[Keep[Made] | None], Made],
        shown: Callable[[Made], tuple[str, BaseModel]],
    ) -> Response:  # fmt: skip
        """What `make` makes as an answer, or the answer of the first time.

        `make` stores what its argument returns in its own transaction; `shown` gives location and body of the answer.
        """
        if self._key is None:
            return _response(self._answer(status, *shown(make(None))))
        with self._flights.one(self._owner, self._key) as flight:
            if kept := self._kept(self._key):
                return _response(kept, replayed=True)
            self._check_room()
            told: list[KeptAnswer] = []

            def keep(made: Made) -> KeptAnswer:
                told[:] = [self._answer(status, *shown(made))]
                return told[0]

            try:
                make(keep)
            except KeyTaken:
                kept = self._kept(self._key)
                if kept is None:
                    raise
                return _response(kept, replayed=True)
            except NotYet as late:
                flight.stored = late.stored
                raise
            return _response(told[0])

    def _kept(self, key: str) -> KeptAnswer | None:
        retention_s = 3600 * self._settings.idempotency_retention_h
        kept = self._stored.get(self._owner, key, time.time() - retention_s)
        if kept is not None and kept.request != self._digest:
            raise ProblemError(
                HTTPStatus.UNPROCESSABLE_ENTITY, "key-reused", "Key used before",
                "this Idempotency-Key belongs to a request with another method, path or body; take a new one",
            )  # fmt: skip
        return kept

    def _check_room(self) -> None:
        limit = self._settings.idempotency_keys_max
        if self._stored.count() >= limit:
            raise Full(f"{limit} idempotency keys are kept; the limit is idempotency_keys_max")

    def _answer(self, status: HTTPStatus, location: str, body: BaseModel) -> KeptAnswer:
        content = body.model_dump_json().encode()
        return KeptAnswer(self._owner, self._key or "", self._digest, time.time(), status, location, content)


def _response(answer: KeptAnswer, *, replayed: bool = False) -> Response:
    headers = {"Location": answer.location} | ({REPLAYED: "true"} if replayed else {})
    return Response(answer.body, answer.status, headers=headers, media_type="application/json")


StoredDep = Annotated[IdempotencyRepository, Depends(provided(IdempotencyRepository))]
FlightsDep = Annotated[Flights, Depends(provided(Flights))]


async def once(
    request: Request, settings: SettingsDep, stored: StoredDep, flights: FlightsDep, key: Key = None,
) -> Once:  # fmt: skip
    """The request as something to answer once."""
    if key is None:
        return Once(stored, flights, settings, "", None, b"")
    target = f"{request.method} {request.url.path}?{request.url.query}\n".encode()
    digest = hashlib.sha256(target + await request.body()).digest()
    return Once(stored, flights, settings, request.scope.get("hrs_owner", ""), key, digest)


Asked = Annotated[Once, Depends(once)]
"""Type of a route's argument that answers once."""
