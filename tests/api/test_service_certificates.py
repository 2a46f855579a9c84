"""Certificates of service over HTTP, and twins that start with one, or in spite of one."""

from __future__ import annotations

import time

import httpx
import pytest

from api.settings import Settings
from api.store.twins import TwinRepository
from api.twins.schemas import TwinChange, TwinRequest
from api.twins.service import Twins
from controllers.certified.service import verify
from station import InputError, load_scenario, load_station
from tests.api.conftest import RunningService
from tests.api.ear import Ear
from tests.generous import generous
from tests.pace import slowness
from tests.waiting import wait_until


@pytest.fixture
def twins(long_database):
    made = Twins(TwinRepository(long_database, "one"), Settings(checkpoint_s=0.2))
    ear = Ear()
    made.observers.append(ear)
    made.ear = ear
    yield made
    made.close()


def _request(**more):
    scenario = load_scenario("S1").on(generous()).model_dump()
    return TwinRequest.model_validate(
        {"id": "t", "scenario": scenario, "controller": "reserve", "speed": 100, "at_end": "repeat", **more}
    )


def _made(http, path):
    """What a path answers once it has been asked for and is there."""
    base, _, query = path.partition("?")
    of = "verification" if base.endswith("/verification") else "certificate"
    absent = http.get(path)
    assert absent.status_code in {200, 404, 503}
    if absent.status_code == 404:
        assert f"POST {'/v1/controllers/{name}/certificate'}" in absent.json()["detail"]
        state = http.get(f"{base.removesuffix('/verification')}/state?{query}&of={of}").json()
        assert state["state"] == "none"  # reading has begun nothing
        assert http.post(f"{base.removesuffix('/verification')}?{query}&of={of}").status_code == 202
    for _ in range(120):
        answer = http.get(path)
        if answer.status_code == 200:
            return answer.json()
        assert answer.status_code == 503
        assert int(answer.headers["retry-after"]) > 0
        time.sleep(0.5)
    raise AssertionError(path)


@pytest.mark.slow
@pytest.mark.timed
def test_a_certificate_is_made_once_and_given_to_who_comes_again(http):
    path = "/v1/controllers/minlp2/certificate?station=thesis-fit-a&options=liveness=false"
    document = _made(http, path)
    assert document["verdict"] == "not certified"
    assert verify(document) == document
    began = time.monotonic()
    assert http.get(path).json() == document
    assert time.monotonic() - began < 1.0 * slowness()
    checked = _made(http, path.replace("certificate?", "certificate/verification?"))
    assert checked == {"verified": True, "claim": f"not certified: {document['claim']}"}


def test_a_certificate_of_nobody_or_nowhere_is_refused(http):
    assert http.get("/v1/controllers/nobody/certificate").status_code == 404
    assert http.get("/v1/controllers/logic/certificate?station=nowhere").status_code == 404
    answer = http.get("/v1/controllers/logic/certificate?options=refill=sideways")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "options"


def test_a_twin_without_a_certificate_is_uncertified(twins):
    assert twins.start(_request()).service == "uncertified"
    wait_until(lambda: twins.state("t").samples > 5)
    assert twins.current("t").document()["service"] == "uncertified"


@pytest.mark.slow
def test_a_certified_twin_says_so_until_another_controller_decides(twins, proved):
    assert twins.start(_request(certificate=proved)).service == "certified"
    wait_until(lambda: twins.state("t").samples > 5)
    assert twins.current("t").document()["service"] == "certified"
    assert twins.change("t", TwinChange(controller="logic")).service == "uncertified"
    before = twins.state("t").samples
    wait_until(lambda: twins.state("t").samples > before + 5)
    assert twins.current("t").document()["service"] == "uncertified"


@pytest.mark.slow
def test_a_certified_twin_is_still_certified_after_a_restart(twins, proved, long_database):
    twins.start(_request(certificate=proved))
    wait_until(lambda: twins.state("t").samples > 5)
    twins.close()
    again = Twins(TwinRepository(long_database, "one"), Settings(checkpoint_s=0.2))
    again.resume_all()
    assert again.state("t").service == "certified"
    again.close()


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"controller": "logic"}, "certificate.controller"),
        ({"controller": "reserve:gap_bar=150"}, "certificate.controller"),
        ({"scenario": load_scenario("S1").on(load_station("thesis-fit")).model_dump()}, "certificate.station.sha256"),
        ({"controller": "remote"}, "certificate.controller"),
    ],
)
def test_a_certificate_of_something_else_keeps_a_twin_from_starting(twins, proved, changes, field):
    twins.create_remote = None
    with pytest.raises(InputError) as caught:
        twins.start(_request(certificate=proved, **changes))
    assert caught.value.problems[0][0] == field
    assert not twins.known("t")


@pytest.mark.slow
def test_a_changed_certificate_keeps_a_twin_from_starting_unless_told(twins, proved):
    wrong = {**proved, "within_s": proved["within_s"] - 1}
    with pytest.raises(InputError) as caught:
        twins.start(_request(certificate=wrong))
    assert caught.value.problems[0][0] == "certificate.within_s"
    assert twins.start(_request(certificate=wrong, allow_uncertified=True)).service == "uncertified"


def test_what_a_twin_keeps_of_a_certificate_cannot_be_posted_as_one(twins):
    with pytest.raises(InputError):
        twins.start(_request(certificate={"sha256": "0" * 64}))


@pytest.mark.slow
def test_a_refused_certificate_is_a_problem_that_names_the_field(http):
    twin = {"id": "refused", "scenario": "S1", "controller": "logic", "certificate": {"verdict": "certified"}}
    answer = http.post("/v1/twins", json=twin)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "certificate.controller"
    answer = http.post("/v1/twins", json={**twin, "allow_uncertified": True, "paused": True})
    assert answer.status_code == 201
    assert answer.json()["service"] == "uncertified"
    assert http.post("/v1/twins/refused/stop").status_code == 200


@pytest.mark.slow
def test_how_far_a_certificate_is(http):
    path = "/v1/controllers/minlp3/certificate/state"
    asked = {"station": "thesis-fit-a", "options": "liveness=false"}
    assert http.get(path, params=asked).json() == {"state": "none", "verdict": None, "claim": None}
    assert http.get(path, params={**asked, "options": "no=such"}).json()["state"] == "none"
    answer = http.post(path.removesuffix("/state"), params={**asked, "options": "no=such"})
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "options")
    assert http.get(path, params=asked).json()["state"] == "none"
    for _ in range(2):  # again, it changes nothing
        assert http.post(path.removesuffix("/state"), params=asked).json()["state"] in {"making", "made"}
    document = _made(http, "/v1/controllers/minlp3/certificate?station=thesis-fit-a&options=liveness=false")
    made = {"state": "made", "verdict": document["verdict"], "claim": document["claim"]}
    assert http.get(path, params=asked).json() == made
    assert http.get(path, params={**asked, "of": "verification"}).json()["state"] == "none"
    assert http.get("/v1/controllers/nobody/certificate/state").status_code == 404


@pytest.mark.slow
def test_a_certificate_in_the_making_does_not_keep_the_service_from_ending(tmp_path):
    service = RunningService(tmp_path, "--workers", "0")
    begun = httpx.post(f"{service.url}/v1/controllers/adaptive/certificate", timeout=30, trust_env=False)
    assert begun.json()["state"] == "making"
    service.stop()  # which waits 20 s; the certificate takes minutes
    assert service.process.returncode == 0


def test_the_format_that_chooses_the_checker_is_the_one_that_is_written(proved):
    from api.jobs.check import SERVICE_FORMAT

    assert proved["format"] == SERVICE_FORMAT
