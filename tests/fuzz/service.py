"""A service to be fuzzed: small limits, so that no request costs minutes; what it says of itself afterwards."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

from tests.api.conftest import RunningService
from tests.api.here import hrs

LIMITS = {
    "HRS_RUNS_MAX": "8", "HRS_REPLICATIONS_MAX": "4", "HRS_HORIZON_MAX": "3", "HRS_DURATION_MAX_S": "20000",
    "HRS_CHUNK_MAX_S": "5", "HRS_TWINS_MAX": "6", "HRS_JOBS_MAX": "100", "HRS_IDEMPOTENCY_KEYS_MAX": "1000000",
    "HRS_RATE_LIMIT_PER_S": "1000000", "HRS_RATE_LIMIT_BURST": "1000000",
}  # fmt: skip
"""What a request may cost; a limit that is reached is answered 429 or 422, which fuzzing then sees, too."""


COMPLAINT = r"a request failed|Traceback|Exception in|ended with status (?!1;)"


class Fuzzed(RunningService):
    """`hrs serve` with one worker, and with keys where `guarded`."""

    def __init__(self, data: Path, database: str | None = None, *, guarded: bool = False) -> None:
        options = ["--workers", "1"]
        if database:
            options += ["--database", database]
        self.keys: dict[str, str] = {}
        if guarded:
            options += ["--host", "0.0.0.0"]  # noqa: S104  # what needs the keys
            place = ["--database", database] if database else ["--data", str(data)]
            for scope in ("read", "admin"):
                self.keys[scope] = hrs("keys", "create", scope, "--scope", scope, *place).stdout.strip()
        super().__init__(data, *options, **LIMITS)

    def stop_twins(self) -> None:
        """Make room for others: there may be few."""
        with asking(self) as client:
            for twin in client.get("/v1/twins").json()["items"]:
                if twin["state"] in {"running", "paused"}:
                    client.post(f"/v1/twins/{twin['id']}/stop").raise_for_status()

    def complaints(self) -> list[str]:
        """What must not have happened: requests that failed, threads that died with a traceback, workers that crashed.

        A worker whose job was cancelled or took too long ends itself with status 1.
        """
        bad = [line for line in self.said if re.search(COMPLAINT, line)]
        ready = httpx.get(f"{self.url}/readyz", timeout=30, trust_env=False)
        if ready.status_code != 200 and "workers" not in ready.text:  # one that ended is being replaced
            bad.append(f"not ready: {ready.text}")
        return bad


def asking(service: Fuzzed) -> httpx.Client:
    """A client of it; `with` closes it."""
    return httpx.Client(base_url=service.url, timeout=120, trust_env=False)


@contextmanager
def fuzzed(data: Path, database: str | None = None, *, guarded: bool = False) -> Iterator[Fuzzed]:
    """A service that runs meanwhile."""
    running = Fuzzed(data, database, guarded=guarded)
    try:
        yield running
    finally:
        running.stop()
