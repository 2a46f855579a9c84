"""The queue of jobs: new ones are stored with their chunks, and the executor is woken."""

from __future__ import annotations

from collections.abc import Callable

from api.jobs.work import JobTypes, Spec
from api.store.jobs import JobRepository
from api.store.records import Job, JobKind, StoredResponse

KeepAnswer = Callable[[Job], StoredResponse] | None
"""Makes the answer that is kept with a job under an idempotency key."""


class JobQueue:
    """Accepts jobs.

    Parameters
    ----------
    repository
        Where they are stored.
    types
        The kinds of jobs there are.
    jobs_max
        Most jobs that may wait or run.
    check_room
        Raises StoreFull where the store takes nothing new.
    wake
        Called when there is work.
    """

    def __init__(
        self, repository: JobRepository, types: JobTypes, jobs_max: int, check_room: Callable[[], None],
        wake: Callable[[], None],
    ) -> None:  # fmt: skip
        self._repository = repository
        self._types = types
        self._jobs_max = jobs_max
        self._check_room = check_room
        self._wake = wake

    def submit(self, kind: JobKind, spec: Spec, keep: KeepAnswer = None) -> Job:
        """Queue a job. Raises Full if there are too many, StoreFull if there is no room."""
        self._check_room()
        of = self._types[kind]
        job = self._repository.add(kind, spec, of.summarize(spec), of.initial_chunks(spec), self._jobs_max, keep)
        self._wake()
        return job
