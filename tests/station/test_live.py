"""A live run is the simulation, second by second, over restarts and for ever."""

from __future__ import annotations

import io
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import strategies as st

from controllers import create, create_from
from station import Decision, InputError, Scenario, load_scenario, simulate
from station.archives import pack, unpack
from station.columns import CODES, COUNTS, VALUES
from station.live import GONE_MAX, AtEnd, LiveRun, SlotState
from tests.samples import samples

COLUMNS = [*VALUES, *CODES, *COUNTS]
ARRIVED, VEHICLE = COLUMNS.index("queue_length"), COLUMNS.index("vehicle")


def _seat(controller, station):
    controller.start(station)
    fallback = create("logic")
    fallback.start(station)
    return SlotState(controller.decide, controller.obeys_hold, fallback=fallback.compiled())


def _rows(run, seat, seconds=None):
    rows = []
    while not run.over and (seconds is None or len(rows) < seconds):
        second = run.step(seat)
        assert second.seq == run.seq - 1
        rows.append(second.row)
    return np.array(rows)


def _expected(record):
    return np.array([record[name] for name in COLUMNS], float).T


@pytest.mark.parametrize("scenario", ["S1", "S2"])
@pytest.mark.parametrize("controller", ["logic", "minlp1", "minlp3:horizon=2"])
def test_the_rows_are_those_of_the_simulation(scenario, controller):
    chosen = load_scenario(scenario).model_copy(update={"idle_period_s": 1})
    record = simulate(chosen, create_from(controller), replication=2, seed=5)
    run = LiveRun(load_scenario(scenario), AtEnd.STOP, 2, 5)
    rows = _rows(run, _seat(create_from(controller), chosen.station))
    assert rows.tobytes() == _expected(record).tobytes()


@samples(
    2, 8, cuts=st.lists(st.integers(0, 1700), max_size=4),
    controller=st.sampled_from(["logic:dispense=cascade", "minlp2"]), at_end=st.sampled_from(list(AtEnd)),
)  # fmt: skip
def test_a_run_restored_anywhere_goes_on_as_if_nothing_had_happened(cuts, controller, at_end):
    scenario = load_scenario("S2")
    whole = _rows(LiveRun(scenario, at_end), _seat(create_from(controller), scenario.station), 2000)
    run, parts = LiveRun(scenario, at_end), []
    actor = create_from(controller)
    seat = _seat(actor, scenario.station)
    for before, after in pairwise([0, *sorted(cuts), 2000]):
        parts.append(_rows(run, seat, after - before).reshape(-1, len(COLUMNS)))
        snapshot = run.snapshot(controller=actor.memory, fallback=seat.fallback.memory)
        actor = create_from(controller)
        seat = _seat(actor, scenario.station)
        run = LiveRun(scenario, at_end)
        memories = run.restore(snapshot)
        actor.memory = memories["controller"]
        seat.fallback.memory[:] = memories["fallback"]
    assert np.vstack(parts).tobytes() == whole.tobytes()


@pytest.mark.slow
def test_a_run_that_repeats_meets_the_next_replications_and_keeps_its_size():
    scenario = load_scenario("S1")
    run = LiveRun(scenario, AtEnd.REPEAT, seed=3)
    seat = _seat(create("minlp1"), scenario.station)
    arrivals, left = {}, []
    for _ in range(30_000):
        second = run.step(seat)
        for vehicle in second.arrived:
            arrivals[vehicle] = second.row[0]
        if second.left >= 0:
            left.append((second.left, second.figures["start_pressure"], second.row[0]))
    expected = [
        1000 * replication + time for replication in range(60) for time in scenario.vehicles(replication, 3).arrival
    ]
    assert list(arrivals) == list(range(len(arrivals)))
    np.testing.assert_array_equal([arrivals[k] for k in range(140)], expected[:140])
    assert [vehicle for vehicle, _, _ in left] == list(range(len(left)))
    assert len(left) > GONE_MAX
    starts = np.concatenate([scenario.vehicles(k, 3).start_pressure for k in range(60)])
    np.testing.assert_array_equal([start for _, start, _ in left], starts[: len(left)])
    assert run._run.vehicles.shape[1] < 400


def test_an_idle_run_goes_on_and_takes_vehicles():
    scenario = load_scenario("S1")
    run = LiveRun(scenario, AtEnd.IDLE)
    seat = _seat(create("logic"), scenario.station)
    rows = _rows(run, seat, 6000)
    np.testing.assert_array_equal(rows[:, 0], np.arange(6000.0))
    assert rows[-1][VEHICLE] == -1
    assert run.add_vehicle(100.0) == 5
    assert run.add_vehicle(120.0, finish_pressure=300.0, volume=0.1, start_temperature=10.0) == 6
    seconds = [run.step(seat) for _ in range(1200)]
    assert list(seconds[0].arrived) == [5, 6]
    assert seconds[0].connected == 5
    done = [second for second in seconds if second.left >= 0]
    assert [second.left for second in done] == [5, 6]
    assert done[1].figures["arrival"] == 6000.0
    assert done[1].figures["final_pressure"] >= 300.0
    span = done[1].figures["finished"] - done[1].figures["connected"]
    assert sum(second.row[VEHICLE] == 6 for second in seconds) == span


@pytest.mark.parametrize(
    ("figures", "field"),
    [
        ({"start_pressure": 700.0}, "start_pressure_bar"),
        ({"start_pressure": 100.0, "finish_pressure": 900.0}, "finish_pressure_bar"),
        ({"start_pressure": 100.0, "volume": 1e-4}, "volume_m3"),
        ({"start_pressure": 100.0, "start_temperature": 90.0}, "start_temperature_c"),
    ],
)
def test_a_vehicle_that_nobody_could_fill_is_refused(figures, field):
    run = LiveRun(load_scenario("S1"), AtEnd.IDLE)
    with pytest.raises(InputError, match=field):
        run.add_vehicle(**figures)
    assert run._run.vehicles.shape[1] == 5


@pytest.mark.parametrize("snapshot", [b"", b"no", b"PK\x03\x04"])
def test_what_is_no_snapshot_is_refused(snapshot):
    with pytest.raises(InputError, match="cannot be read"):
        LiveRun(load_scenario("S1"), AtEnd.IDLE).restore(snapshot)


def _altered(**arrays):
    return pack({**unpack(LiveRun(load_scenario("S1"), AtEnd.IDLE).snapshot()), **arrays})


def _lone_array():
    stream = io.BytesIO()
    np.save(stream, np.zeros(3))
    return stream.getvalue()


@pytest.mark.parametrize(
    ("snapshot", "message"),
    [
        (_lone_array(), "cannot be read"),
        (_altered(numbers=np.array([3.0, 0, 0, 0, 0])), "version: must be 2; given 3"),
        (_altered(numbers=np.array([2.0, np.nan, 0, 0, 0])), "numbers"),
        (_altered(state=np.zeros(3)), "state"),
        (_altered(state=np.full(18, np.nan)), "state"),
        (_altered(counters=np.zeros(5)), "counters"),
        (_altered(counters=np.array([0, 9, 9, 7, 0])), "counters"),
        (_altered(vehicles=np.zeros((2, 5))), "vehicles"),
    ],
)
def test_a_snapshot_that_no_run_wrote_is_refused_and_changes_nothing(snapshot, message):
    run, seat = LiveRun(load_scenario("S1"), AtEnd.IDLE), _seat(create("logic"), load_scenario("S1").station)
    _rows(run, seat, 50)
    with pytest.raises(InputError, match=message):
        run.restore(snapshot)
    assert (run.time, run.seq) == (50.0, 50)


class ByNumber:
    """A plug-in whose commands follow from the vehicle's number."""

    name = "by number"
    obeys_hold = True

    def start(self, station):
        self.numbers = set()

    def decide(self, seen):
        self.numbers.add(seen.vehicle)
        filled = 1 << int(np.argmin(seen.pressure))
        return Decision(filled if seen.vehicle < 0 or seen.time % 9 < 3 else 8 << seen.vehicle % 3)


def _of_trace(*times):
    easy = {"start_pressure_bar": 200.0, "finish_pressure_bar": 240.0}
    arrivals = {"kind": "trace", "vehicles": [{"time_s": time, **easy} for time in times]}
    return Scenario.model_validate({**load_scenario("S1").model_dump(), "arrivals": arrivals, "idle_period_s": 1})


def test_a_plug_in_meets_the_same_numbers_as_in_the_simulation():
    scenario = _of_trace(*range(0, 9000, 60))
    record = simulate(scenario, ByNumber())
    assert record["vehicle"].max() > 2 * GONE_MAX
    plug_in = ByNumber()
    plug_in.start(scenario.station)
    run = LiveRun(scenario, AtEnd.STOP)
    rows = _rows(run, SlotState(plug_in.decide, plug_in.obeys_hold))
    assert rows.tobytes() == _expected(record).tobytes()
    assert plug_in.numbers == set(record["vehicle"].tolist())
    assert run._run.vehicles.shape[1] < 150


@pytest.mark.parametrize(
    ("trace", "expected"),
    [((0.0, 600.0), [0, 600, 600, 1200, 1200, 1800, 1800]), ((0.0,), list(range(2000))), ((5.0,), range(5, 2000, 5))],
)
def test_a_trace_repeats_on_time(trace, expected):
    scenario = _of_trace(*trace)
    run, seat = LiveRun(scenario, AtEnd.REPEAT), _seat(create("logic"), scenario.station)
    seconds = [run.step(seat) for _ in range(2000)]
    arrived = [(number, second.row[0]) for second in seconds for number in second.arrived]
    assert arrived == list(enumerate(expected))
