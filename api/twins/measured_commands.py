"""Commands to measured twins: measurements, and another station to follow with."""

from __future__ import annotations

from concurrent.futures import Future

from pydantic import ValidationError

from api.http.problems import conflict
from api.measurements.formats import read_measurements
from api.store.records import StoredMeasurements
from api.twins.durable import CheckState, DurableCommands, ask
from api.twins.measured import MeasuredTwin
from api.twins.measurement_schemas import MeasurementSource, MeasurementSources, StoredBatch
from api.twins.schemas import Source
from api.twins.state_schemas import TwinState
from station import InputError, Scenario, Station
from station.batches import Batch


class MeasuredCommands(DurableCommands):
    """Commands to measured twins."""

    def measured(self, twin_id: str) -> MeasuredTwin:
        """The live twin of that id, which follows measurements; a conflict where it is no such."""
        twin = self._alive(twin_id)
        if not isinstance(twin, MeasuredTwin):
            kind = "a replay" if twin.request.source is Source.REPLAY else "simulated"
            raise conflict(f"twin {twin_id!r} is {kind}: it takes no measurements")
        return twin

    def measure(self, twin_id: str, source: str, sequence: int, batch: Batch) -> StoredMeasurements:
        """Store measurements of a live twin, once, and let it follow them soon.

        Raises
        ------
        ProblemError
            503 `behind` while too much waits; 409 where it is simulated, has ended or runs elsewhere.
        Conflict
            if the sequence was stored with other content, or is too old.
        """
        return self.measured(twin_id).measure(source, sequence, batch)

    def read_batch(self, twin_id: str, body: bytes, media: str) -> Batch:
        """The batch that a body of a media type holds, by the tags of a live measured twin.

        Raises
        ------
        ProblemError
            413 where it is too large, 415 or 422 where it cannot be read; 409 where the twin is simulated or has ended.
        """
        return read_measurements(body, media, self.measured(twin_id).tags, self._settings)

    def store_batch(self, twin_id: str, source: str, sequence: int, batch: Batch) -> StoredBatch:
        """Store measurements as `measure` does, and say where they stand."""
        stored = self.measure(twin_id, source, sequence, batch)
        return StoredBatch(number=stored.number, samples=len(batch), repeated=stored.repeated)

    def sources(self, twin_id: str) -> MeasurementSources:
        """Who has sent measurements to a live measured twin, and up to where."""
        newest = self._store.measurements.newest(self.measured(twin_id).id)
        found = [MeasurementSource(source=source, sequence=sequence) for source, sequence in sorted(newest.items())]
        return MeasurementSources(sources=found)

    def move(self, twin_id: str, station: Station, calibration: str, check_state: CheckState = None) -> TwinState:
        """Follow with another station, which a calibration found, from the next second on.

        `check_state` may raise what refuses it; nobody else's command comes between. Moved to the same calibration
        again, the twin stays as it is.

        Raises
        ------
        InputError
            if the twin's scenario cannot have the station, or its plant is not followed.
        ProblemError
            409 where it is simulated, has ended or runs elsewhere.
        NotYet
            if that is not stored within 2 s.
        """
        twin = self.measured(twin_id)
        try:
            Scenario.model_validate({**twin.request.scenario.model_dump(), "station": station.model_dump()})
        except ValidationError as error:
            raise InputError.of("station", error) from None
        checked = self._checked(twin, check_state)

        def move() -> Future[None]:
            checked()
            twin.move(station, calibration)
            return twin.store_with()

        self._wait_for(ask(twin, move))
        return self.state(twin_id)
