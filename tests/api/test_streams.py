"""Server-sent events as a browser reads them: in order, resumed behind the last id, gaps told."""

from __future__ import annotations

import json
import time
from contextlib import suppress

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from api.twins.stream import StreamCursor
from tests.api.conftest import RunningService

COUNTS = st.integers(-1, 10**12)


def heard(url, enough, last=None):
    """Messages (kind, document, id) of a stream until `enough` says so of them, or until it ends."""
    found, fields = [], {}
    headers = {"Last-Event-ID": last} if last else {}
    with httpx.stream("GET", url, headers=headers, timeout=30, trust_env=False) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        with suppress(httpx.RemoteProtocolError):  # the service was killed
            for line in answer.iter_lines():
                if line:
                    name, _, value = line.partition(": ")
                    fields[name] = value
                elif "data" in fields:
                    found.append((fields["event"], json.loads(fields["data"]), fields["id"]))
                    fields = {}
                    if enough(found):
                        break
    return found


def of(kind, found):
    return [document for told, document, _ in found if told == kind]


def numbers(kind, found):
    return [document["seq"] for document in of(kind, found)]


def start(http, name, **more):
    answer = http.post("/v1/twins", json={"id": name, "scenario": "S1", "at_end": "repeat", **more})
    assert answer.status_code == 201, answer.text
    return f"{http.base_url}/v1/twins/{name}/stream"


def many(samples, events=0):
    return lambda found: len(of("sample", found)) >= samples and len(of("event", found)) >= events


def unbroken(found):
    """Whether samples follow on each other but for the gaps that are told."""
    expected = None
    for kind, document, _ in found:
        if kind == "gap":
            assert document["first"] == expected
            expected = document["last"] + 1
        elif kind == "sample":
            assert expected in (None, document["seq"])
            expected = document["seq"] + 1
    return True


@pytest.mark.slow
def test_a_slow_twin_tells_every_second_and_every_event_in_order(http):
    found = heard(start(http, "slow", speed=10), many(30, 4))
    samples, events = numbers("sample", found), numbers("event", found)
    assert samples == list(range(samples[0], samples[0] + len(samples)))
    assert events == list(range(len(events)))
    assert "gap" not in {kind for kind, _, _ in found}
    places = [tuple(map(int, place.split("."))) for _, _, place in found]
    assert places == sorted(places)
    http.post("/v1/twins/slow/stop")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"), [("rests", {"paused": True}), ("walks", {"speed": 1}), ("runs", {"speed": "max"})]
)
def test_a_heartbeat_each_second_says_the_time_and_the_state(http, name, more):
    began = time.time()
    url = start(http, name, **more)
    found = heard(url, lambda found: len(of("heartbeat", found)) >= 3)
    beats = of("heartbeat", found)
    assert {beat["state"] for beat in beats} == {"paused" if "paused" in more else "running"}
    assert began - 1 < beats[0]["sent"] < beats[1]["sent"] < beats[2]["sent"] < began + 15
    sent = [document["sent"] for kind, document, _ in found if kind in {"sample", "heartbeat"}]
    assert sent == sorted(sent)  # what was told until a heartbeat stands before it
    http.post(url.replace("/stream", "/stop"))


def test_of_a_fast_twin_it_tells_the_newest_sample_and_every_event(http):
    found = heard(start(http, "fast", speed=200), many(10, 20))
    samples, events = numbers("sample", found), numbers("event", found)
    assert samples == sorted(set(samples))
    assert samples[-1] - samples[0] > len(samples)
    assert events == list(range(events[0], events[0] + len(events)))  # some had happened before anybody listened
    http.post("/v1/twins/fast/stop")


@pytest.mark.slow
@pytest.mark.parametrize("speed", [10, 100])
def test_who_comes_again_is_told_what_came_in_between_and_what_is_missing(http, speed):
    url = start(http, f"again{speed}", speed=speed)
    before = heard(url, many(5, 3))
    time.sleep(2.0)
    after = heard(url, many(3, 1), last=before[-1][2])
    events = numbers("event", before) + numbers("event", after)
    assert events == list(range(len(events)))
    gap = of("gap", after)[0]
    assert gap["first"] == numbers("sample", before)[-1] + 1
    assert gap["last"] == numbers("sample", after)[0] - 1
    query = {"from_s": gap["first"], "to_s": gap["last"], "columns": "time"}
    stored = http.get(f"/v1/twins/again{speed}/history", params=query).json()["columns"]["time"]
    assert stored == list(range(gap["first"], gap["last"] + 1))
    if speed == 10:
        assert unbroken(before + after)
    http.post(f"/v1/twins/again{speed}/stop")


@pytest.mark.slow
def test_through_a_killed_service_nothing_that_counts_is_missed(tmp_path):
    service = RunningService(tmp_path, "--workers", "0", HRS_CHECKPOINT_S="2")
    try:
        with httpx.Client(base_url=service.url, timeout=30, trust_env=False) as http:
            url = start(http, "killed", speed=10)
            first = heard(url, many(45, 3))
            service.kill()
            service.start()
            later = heard(url, many(10, 1), last=first[-1][2])
            document = http.get("/v1/twins/killed/events", params={"limit": 500}).json()["items"]
        assert {sample["epoch"] for sample in of("sample", later)} == {2}
        begin = of("event", later)[0]["seq"]
        known = {event["seq"]: event for event in of("event", first) if event["seq"] < begin}
        known |= {event["seq"]: event for event in of("event", later)}
        assert known == {event["seq"]: event for event in document if event["seq"] in known}
        assert sorted(known) == list(range(len(known)))
        assert "resumed" in {event["kind"] for event in of("event", later)}
        last = of("event", first)[-1]["seq"]
        assert begin <= last + 1
    finally:
        service.stop()


def test_a_twin_of_the_same_id_is_told_from_its_beginning(http):
    url = start(http, "twice", speed=100)
    last = heard(url, many(3, 10))[-1][2]
    assert http.post("/v1/twins/twice/stop").is_success
    assert http.delete("/v1/twins/twice").status_code == 204
    start(http, "twice", speed=100)
    found = heard(url, many(3, 3), last=last)
    assert numbers("event", found)[0] == 0
    assert "gap" not in {kind for kind, _, _ in found}
    http.post("/v1/twins/twice/stop")


def test_the_stream_ends_with_its_twin_and_tells_the_end(http):
    url = start(http, "ends", speed="max", at_end="stop")
    found = heard(url, lambda _: False)
    assert of("event", found)[-1]["kind"] == "finished"
    again = heard(url, lambda _: False, last=found[-1][2])
    assert again == []
    anew = heard(url, lambda _: False)
    assert of("event", anew)[-1]["kind"] == "finished"


@pytest.mark.parametrize(
    "last", ["", "nonsense", "1.2", "1.2.3.4", "-1.0.0", "9.9.9", "1.5.999999", "1." + "9" * 30 + ".1"]
)
def test_an_id_that_is_nobodys_begins_anew(http, last):
    url = start(http, f"odd{abs(hash(last))}"[:30], speed=50)
    assert numbers("event", heard(url, many(1, 1), last=last))[0] == 0


@given(COUNTS, COUNTS, COUNTS, COUNTS)
def test_a_place_is_read_as_it_was_written(born, epoch, sample, event):
    place = StreamCursor(born, epoch, sample, event)
    assert StreamCursor.parse(str(place)) == (None if min(born, epoch) < 0 else place)


@given(st.text())
def test_any_text_is_a_place_or_none(text):
    place = StreamCursor.parse(text)
    assert place is None or StreamCursor.parse(str(place)) == place
