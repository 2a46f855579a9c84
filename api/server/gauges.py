"""Gauges for Prometheus: read from memory, and from the store as far as it answers."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from api.looks import Look
from api.metrics import Gauge
from api.server.twin_gauges import twin_gauges
from api.store.database import Database, StoreError
from api.store.jobs import JobRepository
from api.store.patience import REQUEST_S, patient
from api.store.size import StoreRoom
from api.store.twins import TwinRepository
from api.twins.queries import TwinQueries

log = logging.getLogger(__name__)

KEPT_S = 0.5
"""Figures are read again after this long [s]."""

PATIENCE_S = 0.5
"""So long a scrape waits for the store; it shows what was known last otherwise [s]."""


@dataclass(frozen=True)
class Figures:
    """The figures of the store when it was last read."""

    jobs: Mapping[tuple[str, str], int] = field(default_factory=dict)  # by kind and state
    waiting: int = 0  # chunks
    twins: Mapping[str, str] = field(default_factory=dict)  # state by id
    found: float | None = None  # when [s, monotonic]; None for never


class StoreGauges:
    """Figures of the store, from memory while it does not answer."""

    def __init__(
        self, database: Database, room: StoreRoom, jobs: JobRepository, stored: TwinRepository, twins: TwinQueries
    ) -> None:  # fmt: skip
        self._database = database
        self._room = room
        self._jobs = jobs
        self._stored = stored
        self._twins = twins
        self._known = Figures()
        self._look = Look(self._read, "gauges", KEPT_S)

    def __call__(self) -> Iterator[Gauge]:
        """The gauges; what was never found out is left out."""
        figures = self._look.found(PATIENCE_S) or self._known
        yield Gauge("hrs_store_answers", "Whether the store answers", {(): not self._database.silent})
        yield from self._sizes()
        states = {(name,): count for name, count in self._twins.states(figures.twins).items()}
        yield Gauge("hrs_twins", "Twins of this server", states, ("state",))
        yield from twin_gauges(self._twins)
        if figures.found is None:
            return
        age = time.monotonic() - figures.found
        yield Gauge("hrs_store_figures_age_seconds", "Since the store gave its figures", {(): age})
        yield Gauge("hrs_jobs", "Jobs", figures.jobs, ("kind", "state"))
        yield Gauge("hrs_chunks_waiting", "Chunks of jobs nobody works on yet", {(): figures.waiting})

    def _sizes(self) -> Iterator[Gauge]:
        size = self._room.size()
        if size is not None:
            yield Gauge("hrs_store_bytes", "What the store takes", {(): size.used})
            if size.disk_free is not None:
                yield Gauge("hrs_store_disk_free_bytes", "What its disk has left", {(): size.disk_free})
        if self._room.used_max is not None:
            yield Gauge("hrs_store_bytes_max", "What it may take", {(): self._room.used_max})

    def _read(self) -> Figures:
        try:
            with patient(REQUEST_S):
                self._known = Figures(
                    self._jobs.counts(), self._jobs.waiting(), self._stored.states(), time.monotonic()
                )
        except StoreError as error:
            log.warning("metrics: %s", error)
        return self._known
