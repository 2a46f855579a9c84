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
from api.http.in_flight import InFlightRequests
from api.http.problems import ProblemError
from api.settings import Settings
from api.store.idempotency import IdempotencyRepository
from api.store.records import CapacityError, KeyTaken, NotDurableYet, StoredResponse

Made = TypeVar("Made")

Keep = Callable[[Made], StoredResponse]
"""Called in the transaction that stores what was made: the answer to keep with it."""

REPLAYED = "Idempotency-Replayed"
"""Header of an answer that was given before."""

KeyHeader = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        pattern=r"^[\x21-\x7e]{1,255}$",
        description="1 to 255 visible ASCII characters of yours, new for each thing to create: a request that is sent "
        "again with it gets the same answer, and creates nothing",
        examples=["8e03978e-40d5-43dd-bc93-6894a57f9324"],
    ),
]


class IdempotencyGuard:
    """One request that creates something, and may carry a key."""

    def __init__(
        self, stored: IdempotencyRepository, in_flight: InFlightRequests, settings: Settings, owner: str,
        key: str | None, digest: bytes,
    ) -> None:  # fmt: skip
        self._stored = stored
        self._in_flight = in_flight
        self._settings = settings
        self._owner = owner
        self._key = key
        self._digest = digest

    def answer(
        self, status: HTTPStatus, make: Callable[[Keep[Made] | None], Made],
        shown: Callable[[Made], tuple[str, BaseModel]],
    ) -> Response:  # fmt: skip
        """The response to what `make` makes, or the response of the first time.

        `make` stores what its argument returns in its own transaction; `shown` gives location and body of the answer.
        """
        if self._key is None:
            return _response(self._answer(status, *shown(make(None))))
        with self._in_flight.one(self._owner, self._key) as flight:
            if kept := self._kept(self._key):
                return _response(kept, replayed=True)
            self._check_room()
            stored_answer: list[StoredResponse] = []

            def keep(made: Made) -> StoredResponse:
                stored_answer[:] = [self._answer(status, *shown(made))]
                return stored_answer[0]

            try:
                make(keep)
            except KeyTaken:
                kept = self._kept(self._key)
                if kept is None:
                    raise
                return _response(kept, replayed=True)
            except NotDurableYet as late:
                flight.stored = late.stored
                raise
            return _response(stored_answer[0])

    def _kept(self, key: str) -> StoredResponse | None:
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
            raise CapacityError(f"{limit} idempotency keys are kept; the limit is idempotency_keys_max")

    def _answer(self, status: HTTPStatus, location: str, body: BaseModel) -> StoredResponse:
        content = body.model_dump_json().encode()
        return StoredResponse(self._owner, self._key or "", self._digest, time.time(), status, location, content)


def _response(answer: StoredResponse, *, replayed: bool = False) -> Response:
    headers = {"Location": answer.location} | ({REPLAYED: "true"} if replayed else {})
    return Response(answer.body, answer.status, headers=headers, media_type="application/json")


StoredDep = Annotated[IdempotencyRepository, Depends(provided(IdempotencyRepository))]
InFlightDep = Annotated[InFlightRequests, Depends(provided(InFlightRequests))]


async def idempotency_guard(
    request: Request, settings: SettingsDep, stored: StoredDep, in_flight: InFlightDep, key: KeyHeader = None,
) -> IdempotencyGuard:  # fmt: skip
    """The request as something to answer once."""
    if key is None:
        return IdempotencyGuard(stored, in_flight, settings, "", None, b"")
    target = f"{request.method} {request.url.path}?{request.url.query}\n".encode()
    digest = hashlib.sha256(target + await request.body()).digest()
    return IdempotencyGuard(stored, in_flight, settings, request.scope.get("hrs_owner", ""), key, digest)


IdempotentRequest = Annotated[IdempotencyGuard, Depends(idempotency_guard)]
"""Type of a route's argument that answers once."""
