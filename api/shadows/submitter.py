"""The thread that makes jobs of stretches that are over: a twin never waits for the store or a worker."""

from __future__ import annotations

import logging
import threading

from api.http.problems import ProblemError
from api.http.timeseries import Selection
from api.jobs.job_queue import JobQueue
from api.shadows.job import shadow_spec
from api.shadows.service import KEPT_MAX
from api.store.database import StoreError
from api.store.jobs import JobRepository
from api.store.records import CapacityError, JobKind, JobState, StoreFull
from api.twins.estimates import ailing
from api.twins.fork import fork_of_sample
from api.twins.live import LiveTwin
from api.twins.measured import MeasuredTwin
from api.twins.messages import Sample
from api.twins.service import Twins
from api.twins.shadow_log import Stretch
from station import Scenario, StationError
from station.archives import pack, unpack
from station.forecasting.demand import FIGURES, seen_of
from station.forecasting.fork import fork_arrays
from station.run import ARRIVAL

log = logging.getLogger(__name__)

LOOK_S = 0.5
"""How often it is looked for stretches that are over [s]."""

WAITING_MAX = 8
"""Stretches of all twins that may wait for a worker; the others wait at their twins."""


class ShadowSubmitter:
    """Takes stretches that are over from live twins, and has them run."""

    def __init__(self, twins: Twins, jobs: JobRepository, queue: JobQueue, ending: threading.Event) -> None:
        self._twins = twins
        self._jobs = jobs
        self._queue = queue
        self._ending = ending
        self._thread = threading.Thread(target=self._run, name="shadows", daemon=True)

    def open(self) -> None:
        """Begin; what twins go on with is looked at, too."""
        self._thread.start()

    def forget(self, twin_id: str) -> None:
        """Forget what was found of a twin that is gone; the store does so later where it does not answer."""
        try:
            self._jobs.forget_of_twin(JobKind.SHADOW, twin_id)
        except StoreError as error:
            log.warning("shadows of twin %s are kept until their retention: %s", twin_id, error)

    def _run(self) -> None:
        while not self._ending.wait(LOOK_S):
            try:
                self.look()
            except (StoreError, CapacityError, StoreFull) as error:
                log.warning("shadows wait: %s", error)
            except Exception:
                log.exception("shadows")

    def look(self) -> None:
        """Have run what is over, the oldest of each twin first, as far as workers are not behind.

        Raises
        ------
        StoreError, CapacityError, StoreFull
            if jobs are not taken now.
        """
        for live in self._twins.shadowed():
            for stretch in live.shadow.due:
                if len(self._jobs.newest(JobKind.SHADOW, state=JobState.QUEUED, limit=WAITING_MAX)) == WAITING_MAX:
                    return
                self._take(live, stretch)

    def _take(self, live: LiveTwin, stretch: Stretch) -> None:
        """Submit a stretch; what cannot be run is left out. After a kill between the two it is run twice."""
        settings, request = live.request.shadow, live.request
        if settings is not None:
            try:
                measured = isinstance(live, MeasuredTwin)
                scenario = ailing(self._twins, live.id).scenario if measured else self._twins.scenario(live.id)
                known = self._of_measured(live, scenario, stretch) if measured else stretch
                spec = shadow_spec(live.id, scenario, request.replication, known, settings)
            except (StationError, ProblemError) as error:
                log.warning("a stretch of twin %s from second %d on is left out: %s", live.id, stretch.begin, error)
            else:
                self._queue.submit(JobKind.SHADOW, spec)
                self._jobs.forget_of_twin(JobKind.SHADOW, live.id, but=KEPT_MAX)
        live.shadow_taken(stretch.begin)

    def _of_measured(self, live: LiveTwin, scenario: Scenario, stretch: Stretch) -> Stretch:
        """A stretch of a twin that follows measurements: from its estimates, with the vehicles seen to connect."""
        row = tuple(unpack(stretch.state)["row"].tolist())
        sample = Sample(live.id, live.epoch, stretch.begin, None, row, layout=live.request.layout)
        fork = fork_of_sample(scenario, sample)
        names = ("measured_vehicle", "measured_pressure_vehicle")
        found = self._twins.columns(live.id, Selection(names, float(stretch.begin), float(stretch.end)))
        seen = seen_of(found["time"], found[names[0]], found[names[1]], scenario.station, 0.0).vehicles
        there = fork.vehicles.shape[1] > 0
        came = seen[:, seen[ARRIVAL] > stretch.begin] if there else seen
        figures = [tuple(each) for each in came[FIGURES].T.tolist()]
        return Stretch(stretch.begin, stretch.end, "", pack(fork_arrays(fork)), figures)
