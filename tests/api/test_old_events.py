"""Frequent events that are old are forgotten; whoever reads goes on behind their numbers, on every channel."""

from __future__ import annotations

import json
import time

import pytest

from api.store.database import Database
from api.store.twins import TwinRepository
from api.telemetry.session import connect
from api.twins.minutes import FREQUENT, thin_events
from tests.api.test_streams import heard, numbers, of
from tests.waiting import wait_until

WORKERS = 0


def _told(http, name):
    """Every event there is, of at most 2000."""
    path = f"/v1/twins/{name}/events"
    first = http.get(path, params={"limit": 1000}).json()
    return [*first["items"], *http.get(path, params={"after": first["after"], "limit": 1000}).json()["items"]]


def _thin(service, http, name):
    """Numbers of the events that are left of those told until now."""
    told = _told(http, name)
    database = Database(service.database)
    wait_until(
        lambda: TwinRepository(database, "hrs").get(name).events > told[-1]["seq"]
    )  # that it has ended is told first
    assert thin_events(TwinRepository(database, "hrs"), time.time() + 60) > 10
    database.close()
    return [event["seq"] for event in told if event["kind"] not in FREQUENT]


@pytest.mark.parametrize("alive", [False, True])
def test_every_channel_goes_on_behind_the_gap(service, http, alive):
    name = "paused" if alive else "ended"
    start = {"id": name, "scenario": "S1", "controller": "minlp1", "speed": "max", "at_end": "stop"}
    http.post("/v1/twins", json={**start, "speed": 100} if alive else start).raise_for_status()
    path = f"/v1/twins/{name}"
    if alive:
        wait_until(lambda: http.get(path).json()["events"] > 30)
        http.patch(path, json={"paused": True}).raise_for_status()
    else:
        wait_until(lambda: http.get(path).json()["state"] == "finished")
        wait_until(lambda: _told(http, name)[-1]["kind"] == "finished")
    left = _thin(service, http, name)
    gap = next(number for number in left if number + 1 not in left and number != left[-1])
    assert [event["seq"] for event in _told(http, name)] == left
    paged, url = [], f"{path}/events?limit=3"
    while url:
        answer = http.get(url)
        paged += [event["seq"] for event in answer.json()["items"]]
        url = answer.links.get("next", {}).get("url")
    assert paged == left
    back, before = [], 10**6
    while page := http.get(f"{path}/events", params={"before": before, "limit": 3}).json()["items"]:
        back, before = [event["seq"] for event in page] + back, page[0]["seq"]
    assert back == left
    both = http.get(f"{path}/events", params={"before": left[-1], "after": left[1]}).json()
    assert ([event["seq"] for event in both["items"]], both["next"]) == (left[2:-1], None)

    def over(found):
        return bool(of("heartbeat", found))

    whole = heard(f"{service.url}{path}/stream", over)
    place = whole[-1][2].split(".")
    place[3] = str(gap + 1)  # forgotten meanwhile
    again = heard(f"{service.url}{path}/stream", over, ".".join(place))
    assert numbers("event", again) == [number for number in left if number > gap]
    with connect(service.zenoh) as session:

        def asked(query):
            (reply,) = session.get(f"hrs/v1/{name}/event?{query}", timeout=10)
            return [event["seq"] for event in json.loads(reply.ok.payload.to_bytes())["events"]]

        assert asked("limit=5") == left[-5:]
        assert asked(f"after={gap + 1};limit=2") == [number for number in left if number > gap][:2]
    if alive:
        http.patch(path, json={"paused": False}).raise_for_status()
        more = heard(f"{service.url}{path}/stream", lambda found: len(of("event", found)) > 5, whole[-1][2])
        first = left[-1] + 1
        assert numbers("event", more) == list(range(first, first + len(numbers("event", more))))
        http.post(f"{path}/stop").raise_for_status()
