"""The command line's way to a running service: plain HTTP, problems as errors, and again where an answer was lost."""

from __future__ import annotations

import sys
import time
import uuid
from collections.abc import Callable
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

import httpx

from api.settings import Settings
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


class Client:
    """Requests to one service.

    Once it was reached, a request whose answer is lost on the way is sent again. A POST carries one Idempotency-Key
    all the time, so that it is done once.
    """

    def __init__(self, settings: Settings) -> None:
        self._url = settings.service_url
        headers = {"Authorization": f"Bearer {settings.api_key}"} if settings.api_key else {}
        self._http = httpx.Client(base_url=self._url, headers=headers, timeout=30.0, trust_env=False)
        self._reached = False

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def get(self, path: str, **query: Any) -> Any:
        """GET a document."""
        return self._ask("GET", path, params={name: value for name, value in query.items() if value is not None})

    def post(self, path: str, document: Any = None) -> Any:
        """POST a document; done once, however often it is sent."""
        return self._ask("POST", path, json=document, headers={"Idempotency-Key": str(uuid.uuid4())})

    def put(self, path: str, document: Any, headers: dict[str, str] | None = None) -> Any:
        """PUT a document."""
        return self._ask("PUT", path, json=document, headers=headers or {})

    def delete(self, path: str) -> None:
        """DELETE what is there."""
        self._ask("DELETE", path)

    def _ask(self, method: str, path: str, **more: Any) -> Any:
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
        return answer.json() if answer.content else None

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
    why = _refused(error.response) if isinstance(error, httpx.HTTPStatusError) else f"the connection broke ({error})"
    print(f"{why}: the same request again in {details.wait_for:g} s", file=sys.stderr, flush=True)


def _later(answer: httpx.Response) -> float | None:
    """When a refused request may succeed [s]; None where it will not."""
    given = answer.headers.get("retry-after", "")
    return float(given) if answer.status_code in _LATER and given.isdecimal() else None


def _refused(answer: httpx.Response) -> StationError:
    try:
        problem = answer.json()
        errors = [(item["field"], item["message"]) for item in problem.get("errors", [])]
        if errors:
            return InputError("the service", errors)
        return ServiceError(f"{problem['title']}: {problem.get('detail', '')}".rstrip(": "))
    except (ValueError, KeyError, TypeError):
        return ServiceError(f"{answer.request.url} answered {answer.status_code}; is it a service of hrs-twin?")
