"""The station of the demonstration is followed: its faults are told, and nothing that it has not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from pydantic import TypeAdapter

from api.cli.demonstration import FIELD, Gateway, field_scenario
from api.twins.estimates import JUDGED_S
from api.twins.messages import Sample
from benchmarks.following import told
from benchmarks.measured_forecasts import measured
from controllers import create
from station import load_scenario, load_station, parse_scenario, simulate
from station.batches import Batch
from station.estimation.detection import latest
from station.estimation.filter import ROBUST, Followed
from station.estimation.followed import FollowedRun, FollowedSeconds
from station.estimation.verdict import judged
from station.faults.kinds import Fault
from station.measured_day import tags_of_day
from station.measured_second import LiveSensors
from station.sensor_names import DETECTABLE
from tests.waiting import wait_until


@cache
def samples():
    """Seconds of the field station, as its twin tells them."""
    record = simulate(field_scenario().model_copy(update={"time_limit_s": 10_000.0}), create("minlp1"))
    columns = list(Sample(FIELD, 1, 0, None, ()).columns)
    rows = zip(*(record[name].tolist() for name in columns), strict=True)
    return [Sample(FIELD, 1, seq, None, row) for seq, row in enumerate(rows)][:-1]


class Store:
    """What a gateway sends to."""

    def __init__(self) -> None:
        self.sent = []

    def measure(self, twin, source, sequence, batch):
        self.sent.append((twin, source, sequence, batch))


def test_every_second_is_sent_once_and_in_order():
    store = Store()
    gateway = Gateway(store)
    for sample in samples()[:300]:
        gateway.sample(sample)
    gateway.sample(Sample("demo", 1, 0, None, samples()[0].row))
    wait_until(lambda: len(store.sent) == 300)
    assert [(twin, source, sequence) for twin, source, sequence, _ in store.sent] == [
        ("followed", FIELD, sequence) for sequence in range(300)
    ]
    again = Gateway(Store())
    for (*_, batch), sample in zip(store.sent, samples(), strict=False):
        same = again.batch(sample)
        assert same.value.tobytes() == batch.value.tobytes()  # what is simulated anew after a kill is no other reading


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "event"),
    [
        ({"kind": "sensor_offset", "sensor": "pressure_high", "offset_bar": 15.0}, "offset_pressure_high"),
        ({"kind": "sensor_noisy", "sensor": "temperature_low", "noise_k": 3.0}, "noisy_temperature_low"),
        ({"kind": "sensor_frozen", "sensor": "temperature_medium"}, "frozen_temperature_medium"),
        ({"kind": "sensor_absent", "sensor": "temperature_high"}, "absent_temperature_high"),
    ],
)
def test_a_sensor_that_is_drilled_is_told(fault, event):
    gateway, run = Gateway(Store()), FollowedRun(load_scenario("S1").station, tags_of_day())
    sensors = LiveSensors([TypeAdapter(Fault).validate_python({**fault, "begin_s": 400.0})])
    batches = [gateway.batch(replace(each, sensors=sensors.second(each.row, each.seq))) for each in samples()[:800]]
    found = [run.push(Batch.joined(batches)), run.finish()]
    told = {each.name: each for part in found for each in part.events}
    assert set(told) == {event}
    assert 400 < told[event].found_s < 700


@pytest.mark.slow
def test_its_faults_are_told_and_no_others():
    gateway, run = Gateway(Store()), FollowedRun(load_scenario("S1").station, tags_of_day())
    batches = [gateway.batch(sample) for sample in samples()]
    found = [run.push(Batch.joined(batches[begin : begin + 500])) for begin in range(0, len(batches), 500)]
    found.append(run.finish())
    told = {each.name: each for each in latest([event for part in found for event in part.events])}
    assert set(told) == {"leak_medium", "compressor_weak"}
    assert 900 < told["leak_medium"].found_s < 1200
    assert 0.7 < told["leak_medium"].size < 1.3
    assert 5400 < told["compressor_weak"].found_s < 6600


def test_an_inlet_of_the_field_that_is_stuck_open_is_told():
    """Seven vehicles back to back, by `minlp1`, followed by a file that is half a percent off."""
    given = field_scenario().model_dump(mode="json", exclude_none=True)
    stuck = {"kind": "valve_stuck", "valve": "inlet_low", "position": "open", "begin_s": 300.0, "end_s": 5300.0}
    scenario = parse_scenario({**given, "faults": [stuck], "time_limit_s": 16_000.0})
    record = simulate(scenario, create("minlp1"), replication=1, seed=1)
    events = told(measured(record, 1), load_station("thesis-fit"))
    (found,) = (event for event in events if event.name.startswith("stuck"))
    assert found.name == "stuck_inlet_low"
    assert found.found_s <= 3000.0


@pytest.mark.slow
def test_a_leak_that_comes_and_goes_is_no_reason_to_refuse_the_model():
    """Its end is a step as its beginning was; one that was found before the last hour may end in it."""
    gateway, run = Gateway(Store()), FollowedRun(load_scenario("S1").station, tags_of_day())
    batches = [gateway.batch(each) for each in samples()[:9900]]
    whole = FollowedSeconds.joined([run.push(Batch.joined(batches[k : k + 100])) for k in range(0, 9900, 100)])
    events = latest(whole.events)
    assert [event.name for event in events] == ["leak_medium", "compressor_weak"]
    for now in range(2700, 9800, 60):
        first = max(0, now - int(JUDGED_S))
        unread = np.zeros((now - first, 0))
        last = Followed(whole.states[first:now], unread, whole.innovations[first:now], unread, ROBUST.gate)
        start = float(whole.time[first])
        lasting = {DETECTABLE[k] for k in np.flatnonzero(whole.lasting[now - 1])}
        told = [each for each in events if each.found_s < now and (each.found_s >= start or each.name in lasting)]
        earlier = [each for each in events if each.found_s < start and each.name not in lasting]
        assert judged(last, start, told, (), earlier)[1] == [], now
