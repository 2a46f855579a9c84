"""The services behind REST, zenoh and the page: store, jobs, twins, telemetry; opened and closed together."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from typing import Annotated, Any

from fastapi import Depends, Request

from api.controllers.certificates import ServiceCertificates
from api.http.dependencies import Shutdown
from api.http.in_flight import InFlightRequests
from api.http.threads import Threads
from api.jobs.checks import Checks
from api.jobs.compiler import Compiler
from api.jobs.executor import make_executor
from api.jobs.job_queue import JobQueue
from api.metrics import Gauge, ServiceMetrics
from api.scenarios.service import Scenarios
from api.server.gauges import StoreGauges
from api.server.job_kinds import JOB_TYPES
from api.server.readiness import Readiness
from api.settings import Settings
from api.shadows.submitter import ShadowSubmitter
from api.store.database import Database, StoreError
from api.store.idempotency import IdempotencyRepository
from api.store.jobs import JobRepository
from api.store.keys import KeyRepository
from api.store.notes import NoteRepository
from api.store.patience import LONG_S, patient
from api.store.scenarios import ScenarioRepository
from api.store.size import StoreRoom
from api.store.twins import TwinRepository
from api.telemetry.publisher import Telemetry
from api.telemetry.remote import RemoteController
from api.telemetry.session_manager import SessionManager
from api.twins.broadcast import Broadcast
from api.twins.minutes import thin, thin_events
from api.twins.service import Twins
from controllers.registry import THESIS_CONTROLLERS
from controllers.slot import DEADLINE_MAX

log = logging.getLogger(__name__)

PRUNE_EVERY_S = 600.0
"""Period at which what is past its retention is deleted [s]."""


CLOSE_S = 3.0
"""A store that does not answer holds a closing service up no longer [s]; twins go on from their last checkpoints."""


class Services:
    """One open service."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.database = Database(settings.database_url)
        keep_s = 3600 * settings.idempotency_retention_h
        self.jobs = JobRepository(self.database, keep_s)
        self.idempotency = IdempotencyRepository(self.database)
        self.in_flight = InFlightRequests()
        self.keys = KeyRepository(self.database)
        self._twin_store = TwinRepository(self.database, settings.instance, keep_s)
        self.notes = NoteRepository(self.database, keep_s)
        self.room = StoreRoom(self.database, settings.store_bytes_max, settings.disk_free_min_bytes)
        self.scenarios = Scenarios(ScenarioRepository(self.database), settings, self.room.check)
        self.twins = Twins(self._twin_store, settings, self.room.check)
        self.broadcast = Broadcast()
        self.twins.observers.append(self.broadcast)
        self.checks = Checks(settings)
        self.service_certificates = ServiceCertificates(self.checks)
        self.compiler = Compiler()
        self.threads = Threads()
        self.metrics = ServiceMetrics()
        self._store_gauges = StoreGauges(self.database, self.room, self.jobs, self._twin_store, self.twins)
        self.metrics.show(self._gauges)
        self.database.on_error = self.metrics.database_errors.inc
        self.twins.on_late = self.metrics.late_ticks.inc
        self._sessions = SessionManager(settings, self.keys.all)
        self.executor = make_executor(settings, self.jobs, JOB_TYPES, self.metrics)
        self.job_queue = JobQueue(self.jobs, JOB_TYPES, settings.jobs_max, self.room.check, self.executor.wake)
        self.readiness = Readiness(
            {
                "database": self.database.check, "migrations": self._migrations, "zenoh": self._sessions.fails,
                "workers": self._workers,
            }
        )  # fmt: skip
        self._telemetry: Telemetry | None = None
        self.shutdown = Shutdown()  # set when open streams must end
        self._shadows = ShadowSubmitter(self.twins, self.jobs, self.job_queue, self.shutdown)
        self.twins.on_removed = self._shadows.forget
        self._pruner = threading.Thread(target=self._prune, name="retention", daemon=True)

    def parts(self) -> dict[type[Any], Any]:
        """The parts that routes may use, by type."""
        found = (
            self.settings, self.jobs, self.idempotency, self.in_flight, self.keys, self.notes, self.room,
            self.scenarios, self.twins, self.broadcast, self.checks, self.service_certificates, self.threads,
            self.job_queue, self.shutdown,
        )  # fmt: skip
        return {type(part): part for part in found}

    def prepare(self) -> None:
        """Bring the database up to date and open telemetry: what can fail, before anything runs."""
        self.database.migrate()
        self.database.claim(self.settings.instance)
        self._sessions.open()

    def open(self) -> None:
        """Start working."""
        self.prepare()
        self._telemetry = Telemetry(self._sessions.session, self.twins, self.metrics.samples_dropped.inc)
        self.twins.observers.append(self._telemetry)
        self._sessions.watch(self._telemetry.rebind)
        self.twins.create_remote = self._remote
        self.twins.resume_all()  # compiles here what these need: nothing else is worth more at a start
        self.compiler.start(first=THESIS_CONTROLLERS)
        self.executor.start()
        self.checks.open()
        self._shadows.open()
        self._pruner.start()

    def _remote(self, twin: str) -> RemoteController:
        return RemoteController(lambda: self._sessions.session, twin, DEADLINE_MAX)

    @property
    def telemetry_endpoint(self) -> str:
        """The endpoint that zenoh sessions connect to."""
        return self.settings.zenoh_connect or self.settings.zenoh_listen

    def end_streams(self) -> None:
        """Let open event streams and checks end: the server is about to wait for them."""
        self.shutdown.set()
        self.checks.close()  # whose requests it would wait for, too

    def close(self) -> None:
        """Stop working; what was being done is given back."""
        self.shutdown.set()
        self.database.end_waiting(CLOSE_S)
        self.twins.close()
        self._sessions.stop_watching()
        if self._telemetry is not None:
            self._telemetry.close()
        self._sessions.close()
        self.checks.close()
        self.service_certificates.close()
        self.compiler.close()
        self.executor.close()
        self.database.close()

    def _migrations(self) -> str:
        return "are not those of this version" if self.database.outdated() else ""

    def _workers(self) -> str:
        alive, wanted = self.executor.alive, self.executor.wanted
        return "" if alive >= wanted else f"{alive} of {wanted} run"

    def _gauges(self) -> Iterator[Gauge]:
        """Gauges of the service, for Prometheus."""
        yield Gauge("hrs_workers", "Worker processes", {(): self.executor.alive})
        subscribed = self._telemetry.subscribed() if self._telemetry else 0
        yield Gauge("hrs_twins_subscribed", "Live twins whose samples somebody subscribes to", {(): subscribed})
        yield Gauge("hrs_event_streams", "Event streams that are open", {(): self.broadcast.readers})
        yield from self._store_gauges()

    def _prune(self) -> None:
        days = self.settings.retention_days
        while not self.shutdown.wait(PRUNE_EVERY_S):
            try:
                with patient(LONG_S):
                    self.idempotency.prune(time.time() - 3600 * self.settings.idempotency_retention_h)
                    if days is not None:
                        before = time.time() - 86_400 * days
                        self.jobs.prune(before)
                        self._twin_store.prune(before)
                    if self.settings.thin_days is not None:
                        old = time.time() - 86_400 * self.settings.thin_days
                        thin(self._twin_store, old)
                        thin_events(self._twin_store, old)
                    self.database.shrink()
            except StoreError as error:
                log.warning("retention: %s", error)


async def services(request: Request) -> Services:
    """The open service of the application that a request came to; async, so that no thread is taken for it."""
    found: Services = request.app.state.services
    return found


ServicesDep = Annotated[Services, Depends(services)]
"""Type of a route's argument that wants the service."""
