"""Drills: a fault put into a live plant is there, survives a kill, ends, and is scored by the twin that follows."""

from __future__ import annotations

import pytest
from pydantic import TypeAdapter

from api.cli.demonstration import Gateway
from api.twins.messages import EventKind
from api.twins.schemas import TwinChange, TwinRequest
from controllers import create_from
from station import InputError, load_scenario, parse_scenario, simulate
from station.batches import Batch
from station.faults.kinds import Fault
from station.faults.plant import CompressorWeak, Leak, PrecoolerWeak
from station.measured_day import tags_of_day
from station.measured_second import measured_second
from tests.api.reopened import kill, opening, request
from tests.waiting import wait_until

LEAK = {"kind": "leak", "buffer": "medium", "rate_g_per_s": 2.0}
TAGS = tags_of_day()
FAULT = TypeAdapter(Fault)
OF_SENSORS = (
    {"kind": "sensor_offset", "sensor": "pressure_high", "offset_bar": 5.0},
    {"kind": "sensor_drift", "sensor": "pressure_medium", "drift_bar_per_h": 36.0},
    {"kind": "sensor_frozen", "sensor": "temperature_low"},
    {"kind": "sensor_frozen", "sensor": "pressure_vehicle"},
    {"kind": "sensor_noisy", "sensor": "flow_compressor", "noise_g_per_s": 2.0},
    {"kind": "sensor_absent", "sensor": "temperature_high"},
    {"kind": "clock_skew", "skew_s": 3},
)


class Read:
    """What is read of twins, as the demonstration's gateway sends it; `others` were told anew as something else."""

    def __init__(self):
        self.sent = {}
        self.rows = {}
        self.others = []

    def opened(self, twin):
        pass

    closed = event = opened

    def sample(self, sample):
        batch = Gateway.batch(self, sample)
        self.rows[sample.seq] = sample.row
        told = (batch.tag.tobytes(), batch.time.tobytes(), batch.value.tobytes())
        if self.sent.setdefault(sample.seq, told) != told:
            self.others.append(sample.seq)

    _tags = TAGS


def leak(begin, end=None):
    return Leak.model_validate({**LEAK, "begin_s": begin, "end_s": end})


@pytest.fixture
def twin(http):
    """A live twin that stands still."""
    http.post("/v1/twins", json={"id": "drilled", "scenario": "S1", "speed": 1000}).raise_for_status()
    wait_until(lambda: http.get("/v1/twins/drilled").json()["samples"] > 50)
    http.patch("/v1/twins/drilled", json={"paused": True}).raise_for_status()
    yield "/v1/twins/drilled"
    http.post("/v1/twins/drilled/stop")
    http.delete("/v1/twins/drilled")


def test_a_drill_is_put_in_and_ended(http, twin):
    now = http.get(twin).json()["samples"]
    past = http.post(f"{twin}/drills", json={**LEAK, "begin_s": 0.0})
    assert (past.status_code, past.json()["errors"][0]["field"]) == (422, "begin_s")
    for wrong, said in (
        ({**LEAK, "buffer": "big", "begin_s": now}, '"field":"leak.buffer"'),
        ({**LEAK, "begin_s": now + 10.0, "end_s": now}, "end_s"),
        ({"kind": "valve_leaks", "begin_s": now}, "kind"),
        ({"kind": "sensor_offset", "sensor": "pressure_high", "offset_k": 3.0, "begin_s": now}, "offset_bar"),
        ({"kind": "precooler_weak", "warmer_k": 5.0, "begin_s": now}, "has no precooler"),
    ):
        answer = http.post(f"{twin}/drills", json=wrong)
        assert answer.status_code == 422
        assert said in answer.text
        assert len(answer.json().get("errors", [])) <= 1
    assert http.get(f"{twin}/drills").json()["items"] == []
    told = http.get(twin).json()["events"]
    (drill,) = http.post(f"{twin}/drills", json={**LEAK, "begin_s": now}).json()["items"]
    assert (drill["event"], drill["begin_s"], drill["end_s"], drill["size"], drill["unit"], drill["found"]) == (
        "leak_medium", now, None, 2.0, "g/s", None,
    )  # fmt: skip
    assert len(http.post(f"{twin}/drills", json={**LEAK, "begin_s": now}).json()["items"]) == 1, "sent again"
    assert http.get(f"{twin}/scenario").json()["faults"][0]["buffer"] == "medium"
    http.patch(twin, json={"paused": False}).raise_for_status()
    wait_until(lambda: http.get(twin).json()["samples"] > now + 200)
    (ended,) = http.delete(f"{twin}/drills").json()["items"]
    assert ended["end_s"] > now + 200
    after, before = (
        [
            each["details"]
            for each in http.get(f"{twin}/events?{where}&limit=1000").json()["items"]
            if each["kind"] == "drill"
        ]
        for where in (f"after={told - 1}", "before=100000")
    )
    assert after[0]["event"] == "leak_medium"
    assert before[-1]["ended_s"] == ended["end_s"]
    assert http.get(f"{twin}/drills?followed_by=nobody").status_code == 404
    assert http.get(f"{twin}/drills?followed_by=drilled").status_code == 409


@pytest.mark.slow
def test_a_drilled_run_through_kills_is_the_run_of_a_scenario_with_that_fault(database):
    fault, weak = leak(400.0, 900.0), CompressorWeak(kind="compressor_weak", begin_s=500.0, loss_percent=50.0)
    with opening(database, checkpoint_s=0.1) as make:
        twins = make()
        twins.start(request(controller="logic", at_end="stop", speed=1, paused=True))
        twins.drill("t", fault)
        kill(twins)
        twins = make()
        twins.resume_all()
        twins.drill("t", weak)
        assert [each.event for each in twins.drills("t").items] == ["leak_medium", "compressor_weak"]
        kill(twins)
        twins = make()
        twins.resume_all()
        twins.change("t", TwinChange(speed="max", paused=False))
        wait_until(lambda: twins.state("t").state == "finished")
        scenario = load_scenario("S1")
        faults = [fault.model_dump(), weak.model_dump()]
        record = simulate(parse_scenario({**scenario.model_dump(), "faults": faults}), create_from("logic"))
        rows = [sample.row[0:9] for sample in twins.history("t", 0, 10_000)]
        assert len(rows) == len(record)
        assert [row[2] for row in rows] == record["pressure_medium"].tolist()
        twins.start(request(id="u", controller="logic"))
        with pytest.raises(InputError, match="has no precooler"):
            twins.drill("u", PrecoolerWeak(kind="precooler_weak", begin_s=1e6, warmer_k=5.0))


@pytest.mark.slow
def test_the_twin_that_follows_finds_it_and_raises_its_alarm(database):
    with opening(database, checkpoint_s=0.2) as make:
        twins = make()
        order = {"scenario": "S3", "controller": "logic", "speed": 1, "paused": True, "at_end": "repeat", "id": "field"}
        twins.start(TwinRequest.model_validate(order))
        twins.drill("field", leak(900.0, 1500.0))
        twins.change("field", TwinChange(speed="max", paused=False))
        wait_until(lambda: twins.samples("field") > 1700)
        twins.change("field", TwinChange(paused=True))
        follower = {"id": "m", "scenario": "S3", "source": "measured", "tags": TAGS.model_dump(mode="json")}
        twins.start(TwinRequest.model_validate(follower))
        for first in range(0, 1700, 100):
            names, times, values = [], [], []
            for sample in twins.history("field", first, 100):
                read = measured_second(dict(zip(sample.columns, sample.row, strict=True)), sample.seq)
                names += list(read)
                times += [sample.row[0]] * len(read)
                values += list(read.values())
            twins.measure("m", "gateway", first, Batch.named(TAGS, names, times, values))
        wait_until(lambda: twins.drills("field", "m").items[0].found)
        scored = twins.drills("field", "m")
        assert scored.false_events == []
        assert 0 < scored.items[0].delay_s < 250
        alarms = [each["details"] for each in twins.events("m", -1, 1000) if each["kind"] == EventKind.ALARM]
        assert [each["alarm"] for each in alarms if each["priority"] == "high"] == ["leak_medium"]


def read_through(database, kills):
    """What is read of a twin whose sensors fail, killed so often while they do."""
    read = Read()
    faults = [FAULT.validate_python({**each, "begin_s": 400.0, "end_s": 900.0}) for each in OF_SENSORS]
    asked = request(id=f"t{kills}", controller="logic", at_end="stop", speed=1, paused=True)
    with opening(database, checkpoint_s=0.1) as make:
        twins = make()
        twins.observers.append(read)
        twins.start(asked)
        for fault in faults:
            twins.drill(asked.id, fault)
        twins.change(asked.id, TwinChange(speed=200 if kills else "max", paused=False))
        for wanted in (450, 650)[:kills]:
            wait_until(lambda wanted=wanted, twins=twins: twins._store.get(asked.id).samples > wanted)
            assert twins._store.get(asked.id).samples < 900
            kill(twins)
            twins = make()
            twins.observers.append(read)
            twins.resume_all()
        twins.change(asked.id, TwinChange(speed="max"))
        wait_until(lambda: twins.state(asked.id).state == "finished")
        assert len(twins.drills(asked.id).items) == len(faults)
    assert read.others == []
    return read


@pytest.mark.slow
def test_sensors_of_a_twin_that_is_killed_fail_as_those_of_one_that_is_not(database):
    whole, killed = read_through(database, 0), read_through(database, 2)
    assert whole.sent == killed.sent
    healthy = simulate(load_scenario("S1"), create_from("logic"))
    assert [whole.rows[seq][2] for seq in range(len(healthy))] == healthy["pressure_medium"].tolist()
