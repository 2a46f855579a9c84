"""A client that does not give up: it sends its request until it is answered, and notes what it was told."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Any

import httpx

from tests.nemesis.arena import PATIENCE_S, LostError
from tests.nemesis.history import History

Request = dict[str, Any]

Ask = Callable[[], httpx.Response]

ANSWER_S = 30.0
"""An answer is waited for so long [s]: longer than the service works at one, so that none is done behind the next."""

TROUBLE = (HTTPStatus.SERVICE_UNAVAILABLE, HTTPStatus.CONFLICT, HTTPStatus.TOO_MANY_REQUESTS)
"""What a service in trouble may answer: 503, 409 while the first request is answered, 429 when it is busy.

500 is none of them: whatever is done to it, the service knows what is the matter.
"""


class Client:
    """HTTP to the service, and a history of what came of it."""

    def __init__(self, url: str, history: History) -> None:
        self.history = history
        self.http = httpx.Client(base_url=url, timeout=ANSWER_S, trust_env=False)
        self.close = self.http.close

    def post(self, key: str, path: str, request: Request) -> str:
        """Ask for something under a key until it is there; its place."""
        self.history.note("asked", key=key, path=path, request=request)
        headers = {"idempotency-key": key}
        answer = self.until("acknowledged", lambda: self.http.post(path, json=request, headers=headers), key=key)
        return answer.headers["location"]

    def until(self, what: str, ask: Ask, *, gone: bool = False, **about: Any) -> httpx.Response:
        """Ask again and again until the answer is good; anything but a server in trouble is a failure.

        With `gone`, 404 is good, too, when it was asked before.
        """
        end = time.monotonic() + PATIENCE_S
        last = ""
        while time.monotonic() < end:
            before = last
            try:
                answer = ask()
            except httpx.HTTPError as error:
                last = repr(error)
            else:
                last = f"{answer.status_code} {answer.text:.300}"
                if answer.is_success or (gone and before and answer.status_code == HTTPStatus.NOT_FOUND):
                    self.history.note(what, status=answer.status_code, body=answer.text, **about)
                    return answer
                self.history.note("refused", status=answer.status_code, body=answer.text, **about)
                if answer.status_code not in TROUBLE:
                    raise LostError(f"{about}: {last}")
            time.sleep(0.1)
        raise LostError(f"{about}: no good answer within {PATIENCE_S:g} s, the last one {last}")

    def try_once(self, ask: Ask) -> bool:
        """Whether a request that is sent but once is answered well."""
        with suppress(httpx.HTTPError):
            return ask().is_success
        return False

    def look(self, twin: str) -> bool:
        """Note where a twin stands, None where there is none; False if the service does not say."""
        with suppress(httpx.HTTPError):
            answer = self.http.get(f"/v1/twins/{twin}")
            if answer.is_success or answer.status_code == HTTPStatus.NOT_FOUND:
                self.history.note("looked", twin=twin, shown=answer.json() if answer.is_success else None)
                return True
        return False
