"""What stands behind every face: the store, the jobs, the settings; opened and closed together."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import Depends, Request

from api.certificates.questions import Question
from api.comparisons.schemas import FOUR
from api.controllers.certificates import ServiceCertificates
from api.jobs.compiler import Compiler
from api.jobs.executor import make_executor
from api.jobs.work import about, certificate_spec, comparison_spec, pieces, run_spec
from api.settings import Settings
from api.store.database import Database, StoreError
from api.store.jobs import JobRepository
from api.store.keys import KeyRepository
from api.store.records import Job, JobKind
from api.store.twins import TwinRepository
from api.telemetry.publisher import Telemetry
from api.telemetry.remote import RemoteController
from api.telemetry.session import open_session
from api.twins.service import Twins
from controllers.slot import DEADLINE_MAX
from station import Scenario

log = logging.getLogger(__name__)

PRUNE_EVERY_S = 600.0
"""How often what is past its retention is forgotten [s]."""


class Services:
    """One open service."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.database = Database(settings.database_url)
        self.jobs = JobRepository(self.database)
        self.keys = KeyRepository(self.database)
        self._twin_store = TwinRepository(self.database, settings.instance)
        self.twins = Twins(self._twin_store, settings)
        self.service_certificates = ServiceCertificates()
        self.compiler = Compiler()
        self.executor = make_executor(settings, self.jobs)
        self._session: Any = None
        self._telemetry: Telemetry | None = None
        self.ending = threading.Event()  # set when open streams must end
        self._pruner = threading.Thread(target=self._prune, name="retention", daemon=True)

    def prepare(self) -> None:
        """Bring the database up to date and open telemetry: what can fail, before anything runs."""
        self.database.migrate()
        if self._session is None:
            self._session = open_session(self.settings)

    def open(self) -> None:
        """Start working."""
        self.prepare()
        self._telemetry = Telemetry(self._session, self.twins)
        self.twins.listeners.append(self._telemetry)
        self.twins.create_remote = self._remote
        self.twins.resume_all()  # compiles here what these need: nothing else is worth more at a start
        self.compiler.start(first=FOUR)
        self.executor.start()
        self._pruner.start()

    def _remote(self, twin: str) -> RemoteController:
        return RemoteController(self._session, twin, DEADLINE_MAX)

    @property
    def telemetry_endpoint(self) -> str:
        """Where zenoh sessions connect to."""
        return self.settings.zenoh_connect or self.settings.zenoh_listen

    def end_streams(self) -> None:
        """Let open event streams end: the server is about to wait for them."""
        self.ending.set()

    def close(self) -> None:
        """Stop working; what was being done is given back."""
        self.ending.set()
        self.twins.close()
        if self._telemetry is not None:
            self._telemetry.close()
        if self._session is not None:
            self._session.close()  # one that stays open keeps the process
        self.service_certificates.close()
        self.compiler.close()
        self.executor.close()
        self.database.close()

    def submit_run(self, scenario: Scenario, controller: str, replication: int, seed: int) -> Job:
        """Queue a run. Raises Full if there are too many jobs."""
        return self._submit(JobKind.RUN, run_spec(scenario, controller, replication, seed))

    def submit_comparison(
        self, scenarios: Sequence[Scenario], controllers: Sequence[str], replications: int, seed: int
    ) -> Job:
        """Queue a comparison. Raises Full if there are too many jobs."""
        return self._submit(JobKind.COMPARISON, comparison_spec(scenarios, controllers, replications, seed))

    def submit_certificate(self, question: Question) -> Job:
        """Queue a question. Raises Full if there are too many jobs."""
        return self._submit(JobKind.CERTIFICATE, certificate_spec(question))

    def _submit(self, kind: JobKind, spec: dict[str, object]) -> Job:
        job = self.jobs.add(kind, spec, about(kind, spec), pieces(kind, spec), self.settings.jobs_max)
        self.executor.wake()
        return job

    def _prune(self) -> None:
        days = self.settings.retention_days
        while days is not None and not self.ending.wait(PRUNE_EVERY_S):
            try:
                before = time.time() - 86_400 * days
                self.jobs.prune(before)
                self._twin_store.prune(before)
            except StoreError as error:
                log.warning("retention: %s", error)


async def services(request: Request) -> Services:
    """The open service of the application that a request came to; async, so that no thread is taken for it."""
    found: Services = request.app.state.services
    return found


Opened = Annotated[Services, Depends(services)]
"""Type of a route's argument that wants the service."""
