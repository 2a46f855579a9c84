"""Measurements sent to a twin over zenoh, each again until it is answered."""

from __future__ import annotations

import json
import time
from http import HTTPStatus
from typing import Any

import zenoh

from api.client import AGAIN_S, PATIENCE_S, ServiceError, refused
from api.telemetry.topics import MEASUREMENT, key

ANSWER_S = 10.0
"""An answer is waited for so long before the same is sent again [s]."""

_LATER = (HTTPStatus.SERVICE_UNAVAILABLE, HTTPStatus.TOO_MANY_REQUESTS)


class ZenohSender:
    """Sends batches to one twin on a session."""

    def __init__(self, session: zenoh.Session, twin: str) -> None:
        self._session = session
        self._twin = twin
        self._reached = False

    def sources(self) -> dict[str, int]:
        """Highest sequence of each source that has sent to the twin."""
        return {each["source"]: each["sequence"] for each in self._ask("")["sources"]}

    def send(self, source: str, sequence: int, content: bytes, media: str) -> dict[str, Any]:
        """Store a batch; what the service says of it.

        Raises
        ------
        StationError
            if it is refused, or nobody answers.
        """
        return self._ask(f"?source={source};sequence={sequence}", payload=content, encoding=media)

    def _ask(self, parameters: str, **more: Any) -> dict[str, Any]:
        until = time.monotonic() + PATIENCE_S
        while True:
            problem: dict[str, Any] | None = None
            for reply in self._session.get(f"{key(self._twin, MEASUREMENT)}{parameters}", timeout=ANSWER_S, **more):
                document: dict[str, Any] = json.loads((reply.ok or reply.err).payload.to_bytes())
                if reply.ok is not None:
                    self._reached = True
                    return document
                problem = document
            if problem is None and not self._reached:
                message = f"no live twin {self._twin!r} takes measurements here, or the user's key may not send any"
                raise ServiceError(message)
            if problem is not None and problem.get("status") not in _LATER:
                raise refused(problem)
            if time.monotonic() + AGAIN_S > until:
                raise ServiceError(f"twin {self._twin!r} has not taken measurements for {PATIENCE_S:.0f} s")
            time.sleep(AGAIN_S)
