"""Requests to a running service: plain HTTP, problems as errors, and again where an answer was lost."""

from __future__ import annotations

import math
import sys
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Self

import httpx
import numpy as np

from api.settings import Settings, load_settings
from station import InputError, StationError

if TYPE_CHECKING:
    from stamina.instrumentation import RetryDetails

POLL_S = 0.2
"""How often a job is asked how far it has come [s]."""


AGAIN_S = 1.0
"""After a connection broke, the service is asked again behind this [s]."""

PATIENCE_S = 300.0
"""A request is given up so long after it was begun; compiling a controller may take as long [s]."""

_LATER = (HTTPStatus.SERVICE_UNAVAILABLE, HTTPStatus.CONFLICT)
"""Not now, where `Retry-After` says when; a conflict says so if the first request is still being answered."""


class ServiceError(StationError):
    """The service refused, or cannot be reached."""


class BrokenConnectionError(ServiceError):
    """The connection broke while an answer went on."""


def _document(answer: httpx.Response) -> Any:
    return answer.json() if answer.content else None


def _sendable(document: Any) -> Any:
    """A document as JSON can hold it: NumPy's numbers and arrays are those of Python.

    Raises
    ------
    InputError
        naming each value that JSON has not.
    """
    wrong: list[tuple[str, str]] = []
    found = _plain(document, "", wrong)
    if wrong:
        raise InputError("the request", wrong)
    return found


def _plain(value: Any, field: str, wrong: list[tuple[str, str]]) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {name: _plain(item, f"{field}.{name}" if field else str(name), wrong) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, f"{field}.{place}" if field else str(place), wrong) for place, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        wrong.append((field, f"must be a finite number; given {value}"))
    elif value is not None and not isinstance(value, bool | int | float | str):
        wrong.append((field, f"must be a number, text, true, false, a list or a mapping; given {value!r:.100}"))
    return value


def _given(query: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in query.items() if value is not None}


class Client:
    """Requests to one service; a context manager that closes its connections.

    Once it was reached, a request whose answer is lost on the way is sent again. A POST carries one Idempotency-Key
    all the time, so that it is done once.

    Parameters
    ----------
    settings
        Of the command line; left out: those of HRS_URL and HRS_API_KEY, or `url` and `key` where they are given.
    url
        Of the service, as http://127.0.0.1:8000.
    key
        Of a service that asks for one.

    Raises
    ------
    InputError
        if a setting is wrong.
    """

    def __init__(self, settings: Settings | None = None, *, url: str | None = None, key: str | None = None) -> None:
        if settings is None:
            settings = load_settings(url=url, api_key=key)
        self._url = settings.service_url
        headers = {"Authorization": f"Bearer {settings.api_key}"} if settings.api_key else {}
        self._http = httpx.Client(base_url=self._url, headers=headers, timeout=30.0, trust_env=False)
        self._reached = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def get(self, path: str, **query: Any) -> Any:
        """GET a document."""
        return _document(self._ask("GET", path, params=_given(query)))

    def read(self, path: str, **query: Any) -> bytes:
        """GET content that is no document, as a file in the format that the query names."""
        return self._ask("GET", path, params=_given(query)).content

    def pages(self, path: str, **query: Any) -> Iterator[dict[str, Any]]:
        """The items of a list, page after page."""
        while True:
            page = self.get(path, **query)
            yield from page["items"]
            if page["next"] is None:
                return
            query = {**query, "cursor": page["next"]}

    @contextmanager
    def stream(self, path: str, headers: dict[str, str], silence_s: float) -> Iterator[Iterator[str]]:
        """The lines of an answer that goes on; asked for once, and given up after so long without a byte.

        Raises
        ------
        ServiceError
            if it is refused, or breaks.
        """
        timeout = httpx.Timeout(30.0, read=silence_s)
        try:
            with self._http.stream("GET", path, headers=headers, timeout=timeout) as answer:
                if answer.is_error:
                    answer.read()
                    raise _refused(answer)
                yield answer.iter_lines()
        except httpx.HTTPError as error:
            raise BrokenConnectionError(f"the connection to {self._url} broke ({error})") from None

    def post(self, path: str, document: Any = None) -> Any:
        """POST a document; done once, however often it is sent."""
        key = {"Idempotency-Key": str(uuid.uuid4())}
        return _document(self._ask("POST", path, json=_sendable(document), headers=key))

    def send(self, path: str, content: bytes, media: str, **query: Any) -> Any:
        """POST bytes of a media type; done once, however often they are sent, where the query numbers them."""
        return _document(self._ask("POST", path, content=content, headers={"Content-Type": media}, params=query))

    def put(self, path: str, document: Any, headers: dict[str, str] | None = None) -> Any:
        """PUT a document."""
        return _document(self._ask("PUT", path, json=_sendable(document), headers=headers or {}))

    def patch(self, path: str, document: Any) -> Any:
        """PATCH a document; done twice it does the same."""
        return _document(self._ask("PATCH", path, json=_sendable(document)))

    def delete(self, path: str) -> None:
        """DELETE what is there."""
        self._ask("DELETE", path)

    def _ask(self, method: str, path: str, **more: Any) -> httpx.Response:
        import stamina  # brings asyncio, which a command that asks no service need not wait for

        until = time.monotonic() + PATIENCE_S
        stamina.instrumentation.set_on_retry_hooks((_say_again,))
        try:
            for attempt in stamina.retry_context(lambda error: self._pause(error, until), attempts=None, timeout=None):
                with attempt:
                    answer = self._http.request(method, path, **more).raise_for_status()
        except httpx.HTTPStatusError as error:
            raise _refused(error.response) from None
        except httpx.HTTPError as error:
            message = f"no service answers at {self._url} ({error}); start one with `hrs serve`"
            raise ServiceError(message) from None
        self._reached = True
        return answer

    def _pause(self, error: Exception, until: float) -> float | bool:
        """Time until the request is sent again [s]; False where it is given up."""
        if isinstance(error, httpx.HTTPStatusError):
            pause_s = _later(error.response)
        else:
            pause_s = AGAIN_S if self._broken(error) else None
        if pause_s is None or time.monotonic() + pause_s > until:
            return False
        self._reached = True
        return pause_s

    def _broken(self, error: Exception) -> bool:
        """Whether the service was there, and may be again."""
        if isinstance(error, httpx.ConnectError | httpx.ConnectTimeout):
            return self._reached
        return isinstance(error, httpx.NetworkError | httpx.RemoteProtocolError | httpx.TimeoutException)

    def wait(self, path: str, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
        """Poll a job until it has ended."""
        while True:
            job: dict[str, Any] = self.get(path)
            progress(job)
            if job["finished"] is not None:
                return job
            time.sleep(POLL_S)


def _say_again(details: RetryDetails) -> None:
    error = details.caused_by
    if isinstance(error, httpx.HTTPStatusError) and _is_behind(error.response):
        return  # the twin follows as fast as it can, and who sends waits for it
    why = _refused(error.response) if isinstance(error, httpx.HTTPStatusError) else f"the connection broke ({error})"
    print(f"{why}: the same request again in {details.wait_for:g} s", file=sys.stderr, flush=True)


def _later(answer: httpx.Response) -> float | None:
    """When a refused request may succeed [s]; None where it will not."""
    given = answer.headers.get("retry-after", "")
    return float(given) if answer.status_code in _LATER and given.isdecimal() else None


def _is_behind(answer: httpx.Response) -> bool:
    try:
        return bool(answer.json()["type"].endswith(":behind"))
    except (ValueError, KeyError, TypeError, AttributeError):
        return False


def _refused(answer: httpx.Response) -> StationError:
    try:
        return refused(answer.json())
    except (ValueError, KeyError, TypeError):
        return ServiceError(f"{answer.request.url} answered {answer.status_code}; is it a service of hrs-twin?")


def refused(problem: dict[str, Any]) -> StationError:
    """The error that a problem document tells."""
    errors = [(item["field"], item["message"]) for item in problem.get("errors", [])]
    if errors:
        return InputError("the service", errors)
    return ServiceError(f"{problem['title']}: {problem.get('detail', '')}".rstrip(": "))
