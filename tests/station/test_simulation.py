"""The closed loop: against the referee, compiled against called, and its options."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st

from controllers import create
from station import ControllerError, Decision, Limit, Valve, load_scenario, load_station, parse_scenario, simulate
from station.record import Record
from tests import referee
from tests.samples import samples

WEIGHTS = {"minlp1": (1, 1, 1), "minlp2": (0, 0, 1), "minlp3": (1, 0, 1)}


def judged(name, document):
    plant = referee.Plant(document["station"])
    known = document["station"]["controllers"]
    if name == "logic":
        return plant, referee.Logic(plant, known["logic"])
    return plant, referee.Minlp(plant, known["minlp"], *WEIGHTS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["logic", "minlp1", "minlp2", "minlp3"])
@pytest.mark.parametrize("scenario", ["S1", "S2"])
def test_short_runs_equal_the_referee(name, scenario):
    chosen = load_scenario(scenario)
    plant, controller = judged(name, chosen.model_dump())
    expected = referee.run(plant, controller, chosen.vehicles().arrival.tolist(), 20_000)
    found = simulate(chosen, create(name)).metrics()
    assert {key: found[key] for key in expected} == expected


def test_a_day_of_logic_equals_the_referee():
    chosen = load_scenario("S4")
    plant, controller = judged("logic", chosen.model_dump())
    expected = referee.run(plant, controller, chosen.vehicles().arrival.tolist(), 100_000)
    found = simulate(chosen, create("logic")).metrics()
    assert {key: found[key] for key in expected} == expected


class Called:
    """A controller that hides its compiled form, so that the loop calls it each second."""

    def __init__(self, inner):
        self.inner = inner
        self.name, self.obeys_hold, self.fallback = inner.name, inner.obeys_hold, inner.fallback

    def start(self, station):
        self.inner.start(station)
        self.wake_pressure = getattr(self.inner, "wake_pressure", (0.0, 0.0, 0.0))
        self.liveness_s = self.inner.liveness_s

    def decide(self, observation):
        return self.inner.decide(observation)


@samples(
    2,
    12,
    name=st.sampled_from(["logic", "minlp1", "minlp2", "minlp3", "switched"]),
    preset=st.sampled_from(["thesis-fit", "thesis-fit-cascade", "light-duty-700"]),
    compressors=st.integers(1, 3),
    communication=st.booleans(),
    idle=st.sampled_from([1, 7, 60]),
    replication=st.integers(0, 3),
)
def test_compiled_and_called_give_identical_bytes(name, preset, compressors, communication, idle, replication):
    document = load_scenario("S1").on(load_station(preset)).model_dump()
    document["station"]["compressor"]["count"] = compressors
    document |= {"communication": communication, "idle_period_s": idle, "time_limit_s": 4000.0}
    scenario = parse_scenario(document)
    compiled = simulate(scenario, create(name), replication=replication, seed=5)
    called = simulate(scenario, Called(create(name)), replication=replication, seed=5)
    assert compiled.to_bytes() == called.to_bytes()
    assert called.timing.decisions is not None
    assert compiled.timing.decisions is None


def test_a_record_grows_beyond_its_first_chunk():
    document = load_scenario("S3").model_dump()
    document["arrivals"]["period_s"] = 100_000.0
    scenario = parse_scenario({**document, "time_limit_s": 150_000.0})
    compiled = simulate(scenario, create("logic"))
    assert len(compiled) > 100_000
    assert np.array_equal(compiled["time"], np.arange(len(compiled)))


@pytest.mark.parametrize("idle", [10, 60])
@pytest.mark.parametrize("scenario", ["S1", "S2", "S3", "S4"])
def test_longer_idle_periods_give_the_same_metrics(scenario, idle):
    every = load_scenario(scenario)
    seldom = parse_scenario({**every.model_dump(), "idle_period_s": idle})
    for name in ("logic", "minlp1", "minlp2", "minlp3"):
        one, two = simulate(every, create(name)), simulate(seldom, create(name))
        for key in ("t_total", "t_comp", "t_comp_restored", "t_dis", "wait_max", "delivered"):
            assert two.metrics()[key] == pytest.approx(one.metrics()[key], rel=1e-9), (name, key)
        assert len(two) <= len(one)
    if scenario == "S3":
        assert len(simulate(seldom, create("minlp1"))) < 0.95 * len(simulate(every, create("minlp1")))


def quiet(**changes):
    return parse_scenario({**load_scenario("S1").model_dump(), "time_limit_s": 1500.0, **changes})


class Scripted:
    """Answers a fixed command; remembers what it saw."""

    name = "scripted"
    obeys_hold = True
    liveness_s = 0.0

    def __init__(self, command, fallback=None):
        self.command, self.fallback, self.seen = command, fallback, []

    def start(self, station):
        self.seen = []

    def decide(self, observation):
        self.seen.append(observation)
        return Decision(self.command)


def test_without_communication_only_the_first_reading_is_seen():
    actor = Scripted(Valve.OUTLET_HIGH)
    simulate(quiet(communication=False), actor)
    first = [o for o in actor.seen if o.vehicle == 0]
    assert {o.vehicle_pressure for o in first} == {first[0].vehicle_pressure}
    assert not any(o.communication for o in first)
    simulate(quiet(communication=True), actor)
    live = [o.vehicle_pressure for o in actor.seen if o.vehicle == 0]
    assert live[100] > live[0] + 50


def test_without_communication_controllers_carry_the_reading_forward():
    # With the usual tank the prediction is the plant itself, so nothing changes; with another tank it does.
    for name in ("logic", "minlp1"):
        with_, without = quiet(communication=True), quiet(communication=False)
        assert simulate(with_, create(name)).metrics() == simulate(without, create(name)).metrics()
    trace = {"kind": "trace", "vehicles": [{"time_s": 0, "start_pressure_bar": 100, "volume_m3": 0.25}]}
    with_, without = (quiet(arrivals=trace, communication=flag) for flag in (True, False))
    assert simulate(with_, create("minlp3")).metrics() != simulate(without, create("minlp3")).metrics()


def test_the_shield_names_the_limit_and_asks_logic():
    wrong = int(Valve.INLET_HIGH)  # above 800 bar at the start, so Eq. (7.16) forbids it
    alone = simulate(quiet(), Scripted(wrong))
    assert alone["refused_inlet_high"][0] == Limit.HOLD
    assert alone["inlet_high"][0] == 0
    logic = create("logic")
    backed = simulate(quiet(), Scripted(wrong, logic))
    first = simulate(quiet(), create("logic"))
    for valve in ("inlet_high", "inlet_medium", "inlet_low"):
        assert backed[valve][0] == first[valve][0]
    assert backed["outlet_high"].sum() == 0  # the side nobody refused is not logic's


def test_a_vehicle_nobody_serves_waits_to_the_time_limit():
    record = simulate(quiet(), Scripted(0))
    found = record.metrics()
    assert record["time"][-1] == 1500
    assert found.vehicles_not_finished == 5
    assert found.t_total == sum(1500 - t for t in (250, 500, 750, 1000))


@pytest.mark.parametrize("answer", [None, 3, "open", (1, 2), Decision(64), Decision(-1), Decision(1, 99)])
def test_an_answer_that_is_no_decision_is_an_error(answer):
    class Wrong(Scripted):
        def decide(self, observation):
            return answer

    with pytest.raises(ControllerError, match="scripted"):
        simulate(quiet(), Wrong(0))


def test_a_controller_that_fails_is_named_with_the_second():
    class Broken(Scripted):
        def decide(self, observation):
            if observation.time == 7:
                raise ZeroDivisionError("oops")
            return Decision(0)

    with pytest.raises(ControllerError, match=r"controller 'scripted' failed at 7 s: ZeroDivisionError\('oops'\)"):
        simulate(quiet(), Broken(0))


def test_parquet_keeps_every_figure(tmp_path):
    record = simulate(load_scenario("S2"), create("minlp3"), replication=1, seed=3)
    record.to_parquet(tmp_path / "run.parquet")
    again = Record.from_parquet(tmp_path / "run.parquet")
    assert again.to_bytes() == record.to_bytes()
    assert again.metrics() == record.metrics()
    assert again.scenario == record.scenario
    assert list(tmp_path.iterdir()) == [tmp_path / "run.parquet"]


def test_columns_have_units_and_one_entry_a_row():
    record = simulate(quiet(), Scripted(0))
    assert record.columns["pressure_high"] == "bar"
    assert all(len(record[name]) == len(record) for name in record.columns)
    with pytest.raises(KeyError, match="no column"):
        record["pressure"]
