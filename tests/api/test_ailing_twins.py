"""Forecasts of twins whose station ails: faults last, as they were found or put in, or are mended."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from api.forecasts.job import FORECAST, forecast_spec
from api.twins import estimates
from api.twins.durable import ask
from api.twins.messages import EventKind
from api.twins.schemas import TwinRequest
from benchmarks.ailing_forecasts import ailing_day
from station.batches import batches_of
from station.measured_day import measured_day, tags_of_day
from tests.api.conftest import ended
from tests.api.measured import measured
from tests.waiting import wait_until

HRS = Path(sys.executable).with_name("hrs")
OWN = {"kind": "leak", "buffer": "low", "rate_g_per_s": 5.0, "begin_s": 0.0}


def test_what_a_measured_twin_has_found_goes_on_in_its_futures(opened, monkeypatch):
    """And not what its scenario says, which nobody who follows a station knows."""
    known, record = ailing_day("thesis-fit", 6.0, 1, {"kind": "compressor_tripped"})
    given = {**known.model_dump(mode="json"), "faults": [OWN], "idle_period_s": 1}
    tags = tags_of_day()
    order = {"id": "m", "scenario": given, "source": "measured", "tags": tags.model_dump(mode="json")}
    twins = opened()
    twins.start(TwinRequest.model_validate(order))
    sent = [batch for batch in batches_of(measured_day(record, 1), tags, 60.0) if batch.time[0] < 7200.0]

    def send(some):
        for batch in some:
            number = int(batch.time[0])
            twins.measure("m", "plc", number, batch)

    before = [batch for batch in sent if batch.time[0] < 3000.0]
    send(before)
    wait_until(lambda: twins.live("m").taken == len(before))
    assert twins.fork("m").scenario.faults == []
    send(sent[len(before) :])
    wait_until(lambda: twins.live("m").taken == len(sent), 60)
    (found,) = twins.fork("m").scenario.faults
    assert found.event == "compressor_weak"
    assert 3600.0 <= found.begin_s < 7200.0  # it shows with the next use
    assert found.size[0] > 95.0
    assert twins.fork("m").doubt == ""
    with monkeypatch.context() as refusing:
        refusing.setattr(estimates, "_refused", lambda *_: ["pressure_high: does not fit"])
        fork = twins.fork("m")
        assert fork.scenario.faults == []
        assert fork.doubt.startswith("the model is refused")
        arrays = (fork.fork, ["logic"], None, fork.seen, fork.events, fork.spread)
        asked = {"horizon_s": 60, "futures": 1, "arrivals": "law", "prices": {}, "mended": False, "doubt": fork.doubt}
        assert FORECAST.summarize(forecast_spec("m", fork.scenario, 0, *arrays, asked))["doubt"] == fork.doubt
    twins.stop("m")


def test_a_fault_lasts_however_much_else_is_told_behind_it(opened, monkeypatch):
    """Alarms of a station that was never silent hid one that was found long ago."""
    monkeypatch.setattr(estimates, "EVENTS_MAX", 10)
    twins = opened()
    twins.start(measured())
    twin = twins.live("m")
    leak = {"name": "leak_high", "begin_s": 10.0, "found_s": 60.0, "size": 0.5, "unit": "g/s"}
    ask(twin, lambda: twin._tell(0.0, EventKind.DETECTED, leak))
    for _ in range(20):
        ask(twin, lambda: twin._tell(0.0, EventKind.ALARM, {}))
    assert [each.name for each in estimates.detected(twins, "m")] == ["leak_high"]
    wait_until(lambda: not twin.journal.events_in_memory())
    assert [each.name for each in estimates.detected(twins, "m")] == ["leak_high"]
    twins.stop("m")


@pytest.fixture
def drilled(http):
    """A live simulated twin that stands still, whose buffer leaks."""
    order = {"id": "ails", "scenario": "S3", "controller": "logic", "speed": 1000, "at_end": "repeat"}
    http.post("/v1/twins", json=order).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/ails").json()["samples"] > 900)
    http.patch("/v1/twins/ails", json={"paused": True}).raise_for_status()
    begin = http.get("/v1/twins/ails").json()["samples"] + 60
    fault = {"kind": "leak", "buffer": "high", "rate_g_per_s": 3.0, "begin_s": begin}
    http.post("/v1/twins/ails/drills", json=fault).raise_for_status()
    http.post("/v1/twins/ails/drills", json={"kind": "sensor_absent", "sensor": "flow_dispenser", "begin_s": begin})
    yield "ails", float(begin)
    http.post("/v1/twins/ails/stop")
    http.delete("/v1/twins/ails")


def test_drills_last_in_futures_or_are_mended(http, drilled):
    twin, begin = drilled
    found = {}
    for faults in ("last", "mended"):
        asked = {"controllers": ["logic"], "futures": 3, "arrivals": "announced", "faults": faults}
        made = http.post(f"/v1/twins/{twin}/forecasts", json=asked)
        assert made.status_code in (200, 202), made.text
        found[faults] = ended(http, made.headers["location"])
    last, mended = found["last"], found["mended"]
    assert last["faults"] == [{"event": "leak_high", "begin_s": begin, "end_s": None, "size": 3.0, "unit": "g/s"}]
    assert (last["mended"], mended["faults"], mended["mended"]) == (False, [], True)
    assert last["doubt"] == mended["doubt"] == ""
    kept, lost = (each["answer"]["controllers"][0]["figures"]["cost"]["median"] for each in (mended, last))
    assert lost > kept
    http.patch(f"/v1/twins/{twin}", json={"paused": False}).raise_for_status()
    wait_until(lambda: http.get(f"/v1/twins/{twin}").json()["samples"] > begin + 120)
    came = [http.get(f"/v1/forecasts/{each['id']}").json()["came"] for each in (last, mended)]
    assert came[0] is not None
    assert came[1] is None, "nothing comes of a station that nobody mended"


def test_faults_are_last_or_mended(http, drilled):
    asked = {"controllers": ["logic"], "faults": "forgotten"}
    refused = http.post(f"/v1/twins/{drilled[0]}/forecasts", json=asked)
    assert refused.status_code == 422
    assert [each["field"] for each in refused.json()["errors"]] == ["faults"]


@pytest.mark.slow
@pytest.mark.parametrize(("how", "said"), [("last", "leak_high 3 g/s, since"), ("mended", "as if the faults")])
def test_hrs_forecast_says_what_becomes_of_faults(service, drilled, how, said):
    command = [HRS, "forecast", drilled[0], "--controllers", "logic", "--futures", "3", "--faults", how]
    done = subprocess.run(
        [*command, "--url", service.url], capture_output=True, text=True, check=False, timeout=120
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert said in done.stdout
