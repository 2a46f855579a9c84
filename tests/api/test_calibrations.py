"""Calibrations of measured twins: from their own seconds, as jobs; what cannot be calibrated or used is named."""

from __future__ import annotations

import numpy as np
import pytest

from api.calibrations.record import decoded_frames
from api.calibrations.schemas import CalibrationRequest
from api.calibrations.service import accepted_station, calibration_spec, check_shape
from api.http.problems import ProblemError
from api.jobs.progress import report, reporting
from api.jobs.work import encoded_rows
from api.jobs.worker import Worker
from api.server.job_kinds import JOB_TYPES
from api.settings import Settings
from api.store.database import Database
from api.store.jobs import JobRepository
from api.store.records import ChunkResult, JobKind, JobState, Superseded
from api.twins.schemas import TwinRequest
from station import InputError, load_scenario
from station.estimation.calibration import SHORTEST
from station.frames import frames_of
from station.measurement import Samples
from tests.api.calibrating import HIDDEN, ORDER, SECONDS, TAGS, readings
from tests.api.reopened import opening, request
from tests.waiting import wait_until

SETTINGS = Settings()
KNOWN = load_scenario("S1").station


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def database(request, tmp_path_factory):
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path_factory.mktemp('calibrated') / 'hrs.db'}"
    else:
        url = request.getfixturevalue("module_postgres_url")
    store = Database(url)
    store.migrate()
    yield store
    store.close()


@pytest.fixture(scope="module")
def twins(database):
    """A twin `m` that has followed all readings, and `t`, which is simulated."""
    with opening(database, checkpoint_s=0.5) as make:
        made = make()
        made.start(TwinRequest.model_validate({"id": "m", **ORDER}))
        made.start(request(speed=1))
        for number, batch in enumerate(readings()):
            made.measure("m", "plc", number, batch)
        wait_until(lambda: made.measured("m").taken == len(readings()))
        yield made


def spec(twins, **stretch):
    return calibration_spec(twins, CalibrationRequest(twin="m", **stretch), SETTINGS)


def submitted(jobs, made):
    of = JOB_TYPES[JobKind.CALIBRATION]
    return jobs.add(JobKind.CALIBRATION, made, of.summarize(made), of.initial_chunks(made), open_max=10)


def test_a_calibration_is_made_of_the_very_seconds_that_were_measured(twins):
    made = spec(twins, from_s=100, to_s=SHORTEST + 99)
    found = decoded_frames(made["record"])
    parts = [batch.samples(TAGS) for batch in readings()]

    def joined(place, name):
        return np.concatenate([getattr(part[place], name) for part in parts])

    whole = [
        Samples(tag, joined(place, "time"), joined(place, "value"), joined(place, "noise"))
        for place, tag in enumerate(TAGS.tags)
    ]
    wanted = frames_of(whole).part(100, 100 + SHORTEST)
    assert (found.start, found.measured) == (wanted.start, wanted.measured)
    assert found.values.tobytes() == wanted.values.tobytes()
    read = np.isfinite(wanted.values[:, : wanted.noise.shape[1]])
    assert np.array_equal(found.noise[read], wanted.noise[read])
    assert np.array_equal(found.relative, wanted.relative)


@pytest.mark.slow
def test_a_twin_is_calibrated_and_moved(twins, database):
    jobs = JobRepository(database)
    job = submitted(jobs, spec(twins))
    told = []
    advance = jobs.advance
    jobs.advance = lambda lease, part: (told.append(part), advance(lease, part))
    assert Worker(jobs, SETTINGS, "here", JOB_TYPES).step()
    ended, (row,) = jobs.get_with_result(job.id)
    assert ended.state is JobState.SUCCEEDED, ended.error
    assert row["verdict"] == "accepted", row["refused"]
    assert told == sorted(told)
    assert (len(told) > 1, told[-1] <= 1) == (True, True)
    known = {name: each for name, each in row["parameters"].items() if each["known"]}
    pressure = known["compressor.pressure_bar"]
    assert pressure["low"] < HIDDEN.compressor.pressure_bar < pressure["high"]
    assert not set(known) & set(row["unknown"])
    station, parameters = accepted_station(jobs, job.id)
    assert station.name == "thesis-fit-calibrated"
    assert "s of twin m from second 0 on" in station.source
    assert "not known: " in station.source
    check_shape(KNOWN, station, parameters)
    assert twins.move("m", station, job.id).calibration == job.id
    again = spec(twins, from_s=0, to_s=SHORTEST)
    assert again["station"]["name"] == "thesis-fit-calibrated"


def test_a_station_of_another_shape_is_refused():
    other = KNOWN.model_copy(update={"compressor": KNOWN.compressor.model_copy(update={"count": 3})})
    with pytest.raises(ProblemError, match=r"another than the twin's: compressor.count differ"):
        check_shape(KNOWN, other, ["compressor.pressure_bar"])
    check_shape(KNOWN, KNOWN.model_copy(update={"name": "x", "source": "y"}), [])


@pytest.mark.parametrize(
    ("stretch", "message"),
    [
        ({"to_s": SECONDS + 5}, "to_s: must be at most"),
        ({"from_s": 9, "to_s": 8}, "from_s: must not lie behind second 8; given 9"),
        ({"from_s": 0, "to_s": SHORTEST - 2}, f"from_s: must be {SHORTEST} to 86400 seconds"),
        ({"to_s": 100}, f"from_s: must be {SHORTEST} to 86400 seconds with to_s .*; given 101"),
    ],
)
def test_a_stretch_that_cannot_be_calibrated_is_named(twins, stretch, message):
    with pytest.raises(InputError, match=message):
        spec(twins, **stretch)


def test_only_a_measured_twin_is_calibrated(twins):
    with pytest.raises(ProblemError, match="twin 't' is simulated: it measures nothing"):
        calibration_spec(twins, CalibrationRequest(twin="t"), SETTINGS)
    with pytest.raises(InputError, match="twin: no twin is called 'x'"):
        calibration_spec(twins, CalibrationRequest(twin="x"), SETTINGS)


def test_what_has_no_station_is_not_used(twins, database):
    jobs = JobRepository(database)
    job = submitted(jobs, spec(twins))
    with pytest.raises(InputError, match="no calibration is called 'calibration-x'"):
        accepted_station(jobs, "calibration-x")
    with pytest.raises(ProblemError, match="is queued: it has no station"):
        accepted_station(jobs, job.id)
    lease = jobs.claim("here", 60.0, 3)
    jobs.advance(lease, 0.25)
    assert jobs.get(job.id).progress == 0.25
    found = {"verdict": "refused", "refused": ["pressure_high: innovations 3"], "parameters": {}, "station": None}
    jobs.complete(lease, ChunkResult(encoded_rows([found]), 1))
    with pytest.raises(ProblemError, match=r"refused the model, and has no station: pressure_high: innovations 3"):
        accepted_station(jobs, job.id)
    with pytest.raises(Superseded):
        jobs.advance(lease, 0.5)


def test_progress_is_told_now_and_then_and_to_nobody_else(monkeypatch):
    report(1, 2)  # nobody hears it
    heard = []
    with reporting(heard.append):
        for done in range(1, 101):
            report(done, 100)
    assert heard[0] == 0.01
    assert len(heard) < 5
    report(1, 2)
    assert len(heard) < 5
