"""A service that is killed twenty times during drills and acknowledgements loses none of them, and forecasts end."""

from __future__ import annotations

import random
import time

import httpx
import pytest

from tests.api.conftest import RunningService
from tests.api.test_alarms import with_rules
from tests.api.told import events
from tests.waiting import wait_until

KILLS = 20
OPEN = ("unacknowledged", "returned_unacknowledged")
TWIN = "/v1/twins/t"


def raised(http, path, until):
    """When which alarm was raised, up to a time [s]."""
    return [
        (each["time"], each["details"]["alarm"])
        for each in events(http, path)
        if each["kind"] == "alarm" and each["details"]["state"] == OPEN[0] and each["time"] <= until
    ]


class Operator:
    """Puts in drills and acknowledges alarms, and remembers what was answered."""

    def __init__(self, http):
        self.http = http
        self.drills = []
        self.forecasts = []
        self.acknowledged = {}
        self.count = 0

    @property
    def alarms(self):
        return {each["name"]: each for each in self.http.get(f"{TWIN}/alarms", params={"all": "true"}).json()["items"]}

    def drill(self):
        begin = self.http.get(TWIN).json()["samples"] + 60.0
        fault = {"kind": "compressor_weak", "loss_percent": 30.0, "begin_s": begin, "end_s": begin + 120.0}
        answer = self.http.post(f"{TWIN}/drills", json=fault)
        assert answer.is_success, answer.text
        self.drills.append(fault)

    def forecast(self):
        asked = {"controllers": ["minlp1"], "futures": 50}
        self.forecasts.append(self.http.post(f"{TWIN}/forecasts", json=asked).json()["id"])

    def acknowledge(self):
        for name, alarm in self.alarms.items():
            if alarm["state"] in OPEN:
                asked = {"action": "acknowledge", "raised_s": alarm["raised_s"]}
                if self.http.post(f"{TWIN}/alarms/{name}", json=asked).status_code == httpx.codes.OK:
                    self.acknowledged[name] = alarm["raised_s"]
                    self.count += 1

    def check(self):
        """What was answered is still so."""
        items = self.http.get(f"{TWIN}/drills").json()["items"]
        assert [each["begin_s"] for each in items] == [each["begin_s"] for each in self.drills]
        now = self.alarms
        for name, when in self.acknowledged.items():
            assert now[name]["raised_s"] > when or now[name]["state"] not in OPEN, now[name]


@pytest.mark.slow
def test_twenty_kills_during_drills_and_acknowledgements_lose_nothing(tmp_path):
    chance = random.Random(20)
    service = RunningService(tmp_path, "--workers", "1", HRS_CHECKPOINT_S="0.2")
    with httpx.Client(base_url=service.url, trust_env=False, timeout=30) as http:
        order = {
            "id": "t", "scenario": with_rules(scenario="S3"), "controller": "logic", "speed": 100, "at_end": "repeat",
        }  # fmt: skip
        http.post("/v1/twins", json=order).raise_for_status()
        operator = Operator(http)
        for number in range(KILLS):
            operator.drill()
            if number % 5 == 0:
                operator.forecast()
            time.sleep(chance.uniform(0.0, 2.0))
            operator.acknowledge()
            service.kill()
            service.start()
            operator.check()
        http.patch(TWIN, json={"paused": True}).raise_for_status()
        end = http.get(TWIN).json()["samples"] - 1.0
        begins = raised(http, TWIN, end)
        assert len(set(begins)) == len(begins) > KILLS / 4
        assert operator.count > KILLS / 4
        for each in operator.forecasts:
            wait_until(lambda each=each: http.get(f"/v1/forecasts/{each}").json()["state"] == "succeeded")
        scenario = {**with_rules(scenario="S3"), "faults": operator.drills}
        whole = {**order, "id": "whole", "scenario": scenario, "speed": "max"}
        http.post("/v1/twins", json=whole).raise_for_status()
        wait_until(lambda: http.get("/v1/twins/whole").json()["samples"] > end)
        http.post("/v1/twins/whole/stop").raise_for_status()
        assert begins == raised(http, "/v1/twins/whole", end)
    service.stop()
