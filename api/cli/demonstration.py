"""The demonstration of `hrs serve --demo`: a live twin, a station that is followed, and a first job.

Two stations are simulated: `demo`, with the thesis's parameters, and `field`, with others that nobody is told and with
faults. What the sensors of `field` would read is sent to `followed` as a real station's gateway sends it: in batches
with a source and a sequence, once each. The measurements' time is that of `field`, so both go on where they stood when
the service starts again.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from typing import Any

from api.cli.console import print_tables
from api.comparisons.job import comparison_spec
from api.comparisons.service import done_of
from api.comparisons.tables import tables, verdict
from api.http.problems import ProblemError
from api.server.services import Services
from api.store.database import StoreError
from api.store.records import JobKind
from api.twins.messages import Event, Sample
from api.twins.schemas import Source, TwinRequest
from api.twins.service import Twins
from controllers.registry import THESIS_CONTROLLERS, is_ready
from station import StationError, load_scenario, load_station, parse_scenario
from station.batches import Batch
from station.live import AtEnd
from station.measured_day import tags_of_day
from station.measured_second import measured_second
from station.scenario import Scenario

log = logging.getLogger(__name__)

SCENARIOS = ("S1", "S2", "S3", "S4")
"""Scenarios that the demonstration compares: the thesis's four."""

FIELD, FOLLOWED = "field", "followed"
"""The twins that stand for a real station, and for the one that follows it."""

WAITING_MAX = 600
"""Seconds of `field` that wait to be sent; older ones get lost, as with a gateway whose memory is full."""

AGAIN_S = 1.0
"""When measurements that could not be taken are sent again [s]."""

_HIDDEN = {"inlet_coefficient": 0.997, "outlet_coefficient": 1.003, "volume": 1.002}
"""Parameters of `field` by those of `followed` [1]."""


class Gateway:
    """Sends what the sensors of `field` read to `followed`; an observer of twins."""

    def __init__(self, twins: Twins) -> None:
        self._twins = twins
        self._tags = tags_of_day()
        self._waiting: queue.Queue[Sample] = queue.Queue(WAITING_MAX)
        self._thread = threading.Thread(target=self._send, name="gateway", daemon=True)
        self._thread.start()

    def opened(self, twin: str) -> None:
        """Take no notice of a twin that starts."""

    def closed(self, twin: str) -> None:
        """Take no notice of a twin that ends."""

    def event(self, event: Event) -> None:
        """Take no notice: sensors tell no events."""

    def sample(self, sample: Sample) -> None:
        """Let a second of `field` be sent."""
        if sample.twin != FIELD:
            return
        while True:
            try:
                self._waiting.put_nowait(sample)
            except queue.Full:
                self._waiting.get_nowait()
            else:
                return

    def _send(self) -> None:
        while True:
            sample = self._waiting.get()
            batch = self.batch(sample)
            while len(batch) and not self._is_taken(sample.seq, batch):
                time.sleep(AGAIN_S)

    def _is_taken(self, sequence: int, batch: Batch) -> bool:
        """Whether measurements need not be sent again."""
        try:
            self._twins.measure(FOLLOWED, FIELD, sequence, batch)
        except ProblemError as problem:
            return problem.retry_after_s is None
        except StoreError:
            return False
        except StationError as error:
            log.warning("measurements %d of %s: %s", sequence, FIELD, error)
        return True

    def batch(self, sample: Sample) -> Batch:
        """What the sensors read in a second, as it is sent."""
        row = dict(zip(sample.columns, sample.row, strict=True))
        read = measured_second(row, sample.seq, sensors=sample.sensors)
        times = [sample.sensors.stamp(name, row["time"]) for name in read]
        return Batch.named(self._tags, list(read), times, list(read.values()))


def field_scenario() -> Scenario:
    """A station much like the thesis's whose parameters differ a little, with a leak and a weak compressor."""
    station = load_station("thesis-fit").model_dump(mode="json", exclude_none=True)
    station["name"], station["about"] = "field", "Stands for a real station: `followed` knows its parameters nearly"
    for tank in station["buffers"].values():
        if isinstance(tank, dict):
            tank["volume_m3"] *= _HIDDEN["volume"]
    station["compressor"]["inlet_coefficient_g_per_s_bar"] *= _HIDDEN["inlet_coefficient"]
    station["dispenser"]["outlet_coefficient_g_per_s_bar"] *= _HIDDEN["outlet_coefficient"]
    faults: list[dict[str, Any]] = [
        {"kind": "leak", "buffer": "medium", "begin_s": 900.0, "end_s": 2700.0, "rate_g_per_s": 1.0},
        {"kind": "compressor_weak", "begin_s": 5400.0, "end_s": 9000.0, "loss_percent": 25.0},
    ]
    return parse_scenario(
        {
            "name": FIELD,
            "about": "A station with hidden parameters and faults, measured second by second",
            "station": station,
            "arrivals": {"kind": "uniform", "count": 48, "period_s": 14_400.0},
            "faults": faults,
        }
    )


def demonstrate(services: Services) -> None:
    """Let twins live, compare the thesis's controllers on its scenarios as a job, and print the table when done."""
    try:
        while not all(is_ready(name) for name in THESIS_CONTROLLERS):
            time.sleep(0.2)
        if not services.twins.every():
            _start(services.twins)
        live = services.twins.ids()
        say(f"  live twins     {', '.join(live)}: `hrs watch {live[0]}`" if live else "  live twins     none")
        spec = comparison_spec([load_scenario(name) for name in SCENARIOS], THESIS_CONTROLLERS, 1, 0)
        job = services.job_queue.submit(JobKind.COMPARISON, spec)
        say(f"  first job      {job.id}: S1-S4, {', '.join(THESIS_CONTROLLERS)}")
        while not job.state.final:
            time.sleep(0.1)
            job = services.jobs.get(job.id) or job
        done = done_of(job, services.jobs)
        print_tables(tables(*done), verdict(*done))
    except StationError as error:
        log.warning("the first job: %s", error)


def _start(twins: Twins) -> None:
    twins.start(TwinRequest(id="demo", scenario=load_scenario("S1"), controller="minlp1", at_end=AtEnd.REPEAT))
    twins.start(TwinRequest(id=FOLLOWED, scenario=load_scenario("S1"), source=Source.MEASURED, tags=tags_of_day()))
    twins.start(TwinRequest(id=FIELD, scenario=field_scenario(), controller="minlp1", at_end=AtEnd.REPEAT))


def say(line: Any) -> None:
    """Print one line to who started the service, at once."""
    print(line, flush=True)
