"""Idempotency-Key: the same request again gives the same answer and makes nothing again, also after a kill."""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import httpx
import pytest

from api.http.in_flight import InFlightRequests
from api.http.problems import ProblemError
from api.store.idempotency import IdempotencyRepository
from api.store.jobs import JobRepository
from api.store.records import Checkpoint, Chunk, JobKind, KeyTaken, StoredResponse
from api.store.twins import TwinRepository
from tests.api.conftest import RunningService, ended
from tests.api.here import hrs

SYSTEM = {
    "ask": "stability", "modes": [{"A": [["0.5"]]}, {"A": [["0.4"]]}], "constraint": {"kind": "arbitrary"},
}  # fmt: skip

CREATING = {
    "/v1/runs": {"scenario": "S1"},
    "/v1/comparisons": {"scenarios": ["S1"], "controllers": ["logic"]},
    "/v1/certificates": SYSTEM,
    "/v1/twins": {"scenario": "S1", "at_end": "idle"},
}


def _post(service, path, json, key, **headers):
    headers = {"idempotency-key": key, **headers}
    return httpx.post(service.url + path, json=json, headers=headers, timeout=30, trust_env=False)


def _same(first, again):
    assert again.status_code == first.status_code, again.text
    assert again.content == first.content
    assert again.headers["location"] == first.headers["location"]
    assert "idempotency-replayed" not in first.headers
    assert again.headers["idempotency-replayed"] == "true"


def _listed(service, path):
    return httpx.get(service.url + path, trust_env=False).json()["items"]


@pytest.fixture(scope="module", params=["sqlite", "postgresql"])
def kept(request, tmp_path_factory):
    """A service with no workers, so that what is queued stays so."""
    options = ["--workers", "0"]
    data = tmp_path_factory.mktemp("kept")
    if request.param == "postgresql":
        options += ["--database", request.getfixturevalue("module_postgres_url")]
    running = RunningService(data, *options)
    yield running
    running.stop()


@pytest.mark.parametrize("path", CREATING)
def test_the_same_request_again_is_answered_the_same(kept, path):
    before = len(_listed(kept, path))
    first = _post(kept, path, CREATING[path], f"again-{path}")
    assert first.status_code in (201, 202), first.text
    _same(first, _post(kept, path, CREATING[path], f"again-{path}"))
    assert len(_listed(kept, path)) == before + 1
    assert httpx.get(kept.url + first.headers["location"], trust_env=False).json()["id"] == first.json()["id"]
    assert _post(kept, path, CREATING[path], f"other-{path}").json()["id"] != first.json()["id"]


def test_a_key_belongs_to_one_request(kept):
    assert _post(kept, "/v1/runs", {"scenario": "S1"}, "one").status_code == 202
    for path, body in (("/v1/runs", {"scenario": "S2"}), ("/v1/comparisons", {"scenarios": ["S1"]})):
        problem = _post(kept, path, body, "one")
        assert problem.status_code == 422
        assert problem.json()["type"] == "urn:hrs-twin:problem:key-reused"


def test_a_refused_request_leaves_its_key_free(kept):
    assert _post(kept, "/v1/runs", {"scenario": "S9"}, "free").status_code == 422
    assert _post(kept, "/v1/runs", {"scenario": "S1"}, "free").status_code == 202
    assert _post(kept, "/v1/twins", {"scenario": "S1", "id": "taken"}, "taken-1").status_code == 201
    assert _post(kept, "/v1/twins", {"scenario": "S1", "id": "taken"}, "taken-2").status_code == 409
    assert httpx.post(kept.url + "/v1/twins/taken/stop", trust_env=False).status_code == 200
    assert httpx.delete(kept.url + "/v1/twins/taken", trust_env=False).status_code == 204
    assert _post(kept, "/v1/twins", {"scenario": "S1", "id": "taken"}, "taken-2").status_code == 201


@pytest.mark.parametrize("key", ["", "x" * 256, "two words", "tab\there"])
def test_a_key_is_visible_ascii(kept, key):
    problem = _post(kept, "/v1/runs", {"scenario": "S1"}, key)
    assert problem.status_code == 422
    assert [error["field"] for error in problem.json()["errors"]] == ["Idempotency-Key"]


def test_many_at_once_make_one(kept):
    before = len(_listed(kept, "/v1/runs"))
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: _post(kept, "/v1/runs", {"scenario": "S1"}, "crowd"), range(24)))
    done = [answer for answer in answers if answer.status_code == 202]
    assert len({answer.content for answer in done}) == 1
    for answer in answers:
        if answer.status_code != 202:
            assert answer.status_code == 409
            assert int(answer.headers["retry-after"]) >= 1
    assert len(_listed(kept, "/v1/runs")) == before + 1


def test_one_is_in_flight_until_its_work_is_stored():
    flights = InFlightRequests()
    with flights.one("", "k") as flight:
        with pytest.raises(ProblemError) as refused, flights.one("", "k"):
            pass
        assert refused.value.problem.status == 409
        assert refused.value.retry_after_s == 1
        with flights.one("ann", "k"):
            pass
        flight.stored = Future()
    with pytest.raises(ProblemError), flights.one("", "k"):
        pass
    flight.stored.set_result(None)
    with flights.one("", "k"):
        pass


@pytest.mark.slow
def test_an_answer_that_a_kill_took_is_given_again(database_url, tmp_path):
    """Whenever the server dies: a request sent again until it is answered makes one thing."""
    service = RunningService(tmp_path, "--workers", "0", "--database", database_url)
    posted = {path: _post(service, path, body, "survives") for path, body in list(CREATING.items())[:1]}
    service.kill()
    service.start()
    for path, first in posted.items():
        _same(first, _post(service, path, CREATING[path], "survives"))
    twin = _post(service, "/v1/twins", {"id": "killed", "scenario": "S1", "at_end": "idle"}, "twin")
    for number in range(3):
        key = f"torn-{number}"
        stop = threading.Event()

        def insist(key=key, stop=stop):
            """As a client does whose connection breaks."""
            while not stop.is_set():
                try:
                    answer = _post(service, "/v1/twins/killed/vehicles", {"start_pressure_bar": 100}, key)
                    if answer.status_code == 201:
                        return answer
                except httpx.HTTPError:
                    pass
                time.sleep(0.01)
            return None

        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(insist)
            time.sleep(0.003 * number)
            service.kill()
            service.start()
            answer = asked.result(60)
        _stored(service, answer, key)
    service.kill()
    service.start()
    _same(twin, _post(service, "/v1/twins", {"id": "killed", "scenario": "S1", "at_end": "idle"}, "twin"))
    events = httpx.get(service.url + "/v1/twins/killed/events?limit=1000", trust_env=False).json()["items"]
    added = [event["details"]["vehicle"] for event in events if event["kind"] == "vehicle_added"]
    service.stop()
    assert len(added) == len(set(added)) == 3, events


def _stored(service, answer, key):
    again = _post(service, "/v1/twins/killed/vehicles", {"start_pressure_bar": 100}, key)
    assert (again.status_code, again.content) == (201, answer.content)
    assert again.headers["idempotency-replayed"] == "true"


@pytest.mark.slow
def test_keys_of_others_are_others(tmp_path):
    ann = hrs("keys", "create", "ann", "--data", tmp_path).stdout.strip()
    bob = hrs("keys", "create", "bob", "--data", tmp_path).stdout.strip()
    service = RunningService(
        tmp_path,
        "--workers",
        "0",
        "--host",
        "0.0.0.0",  # noqa: S104  # what needs the keys
        HRS_IDEMPOTENCY_KEYS_MAX="2",
    )
    try:
        ids = [
            _post(service, "/v1/runs", {"scenario": "S1"}, "same", authorization=f"Bearer {key}").json()["id"]
            for key in (ann, bob, ann)
        ]
        assert ids[0] == ids[2] != ids[1]
        full = _post(service, "/v1/runs", {"scenario": "S1"}, "third", authorization=f"Bearer {ann}")
        assert full.status_code == 429
        assert "idempotency_keys_max" in full.json()["detail"]
    finally:
        service.stop()


def test_every_post_that_creates_takes_a_key(http):
    paths = http.get("/openapi.json").json()["paths"]
    taking = {
        path
        for path, operations in paths.items()
        for parameter in operations.get("post", {}).get("parameters", [])
        if parameter["name"] == "Idempotency-Key"
    }
    creating = {
        path
        for path, operations in paths.items()
        if {"201", "202"} & set(operations.get("post", {}).get("responses", {}))
    }
    creating.remove("/v1/keys")  # its answer is a secret, which nothing may keep; the name makes it once
    creating.remove("/v1/controllers/{name}/certificate")  # begun twice, a certificate is made once
    creating.remove("/v1/twins/{twin_id}/measurements")  # source and sequence let them count once
    created = {"/v1/calibrations", *(f"/v1/twins/{{twin_id}}/{each}" for each in ("vehicles", "forecasts", "notes"))}
    assert taking == creating == {*CREATING, *created}


def test_a_job_of_a_key_runs_once(http):
    headers = {"idempotency-key": "run-me"}
    first = http.post("/v1/runs", json={"scenario": "S1"}, headers=headers)
    ended(http, first.headers["location"])
    assert http.post("/v1/runs", json={"scenario": "S1"}, headers=headers).json()["state"] == "queued"


# The store.


def _answer(key="k", created=None, owner=""):
    return StoredResponse(owner, key, b"d" * 32, time.time() if created is None else created, 202, "/v1/x", b"{}")


def test_an_answer_is_kept_with_its_job_or_not_at_all(database):
    repository, answers = JobRepository(database, keep_s=100.0), IdempotencyRepository(database)

    def add(answer):
        return repository.add(JobKind.RUN, {}, {}, [Chunk(0, {}, 1)], 100, lambda _: answer)

    first = _answer()
    add(first)
    assert answers.get("", "k", 0.0) == first
    with pytest.raises(KeyTaken):
        add(_answer())
    assert len(repository.newest(JobKind.RUN)) == 1
    assert answers.get("ann", "k", 0.0) is None
    assert answers.get("", "k", time.time() + 1) is None


def test_answers_are_forgotten_and_their_keys_free_again(database):
    repository, answers = JobRepository(database, keep_s=100.0), IdempotencyRepository(database)
    for _ in range(2):
        repository.add(JobKind.RUN, {}, {}, [Chunk(0, {}, 1)], 100, lambda _: _answer(created=5.0))
    assert answers.count() == 1
    assert answers.prune(4.0) == 0
    assert answers.prune(6.0) == 1
    assert answers.count() == 0


def test_a_checkpoint_keeps_answers_and_is_never_stopped_by_them(database):
    twins, answers = TwinRepository(database, "one"), IdempotencyRepository(database)
    twins.add("demo", {}, _answer("made"))
    epoch, _ = twins.open("demo")
    first, other = _answer("v1"), _answer("v2")
    for given in ((first,), (first, other)):
        twins.save("demo", epoch, Checkpoint("running", {}, b"", 0, 0, None, (), given))
    assert answers.get("", "v2", 0.0) == other
    twins.remove("demo", _answer("made"))
    assert answers.get("", "made", 0.0) is None
