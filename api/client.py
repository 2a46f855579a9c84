"""The command line's way to a running service: plain HTTP, problems as errors."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import httpx

from api.settings import Settings
from station import InputError, StationError

POLL_S = 0.2
"""How often a job is asked how far it has come [s]."""


class ServiceError(StationError):
    """The service refused, or cannot be reached."""


class Client:
    """Requests to one service."""

    def __init__(self, settings: Settings) -> None:
        self._url = settings.service_url
        headers = {"Authorization": f"Bearer {settings.api_key}"} if settings.api_key else {}
        self._http = httpx.Client(base_url=self._url, headers=headers, timeout=30.0, trust_env=False)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._http.close()

    def get(self, path: str, **query: Any) -> Any:
        """GET a document."""
        return self._ask("GET", path, params={name: value for name, value in query.items() if value is not None})

    def post(self, path: str, document: Any = None) -> Any:
        """POST a document."""
        return self._ask("POST", path, json=document)

    def _ask(self, method: str, path: str, **more: Any) -> Any:
        try:
            answer = self._http.request(method, path, **more)
        except httpx.HTTPError as error:
            raise ServiceError(f"no service answers at {self._url} ({error}); start one with `hrs serve`") from None
        if answer.is_success:
            return answer.json() if answer.content else None
        raise _refused(answer)

    def wait(self, path: str, progress: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
        """Poll a job until it has ended."""
        while True:
            job: dict[str, Any] = self.get(path)
            progress(job)
            if job["finished"] is not None:
                return job
            time.sleep(POLL_S)


def _refused(answer: httpx.Response) -> StationError:
    try:
        problem = answer.json()
        errors = [(item["field"], item["message"]) for item in problem.get("errors", [])]
        if errors:
            return InputError("the service", errors)
        return ServiceError(f"{problem['title']}: {problem.get('detail', '')}".rstrip(": "))
    except (ValueError, KeyError, TypeError):
        return ServiceError(f"{answer.request.url} answered {answer.status_code}; is it a service of hrs-twin?")
