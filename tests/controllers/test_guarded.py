"""The guarded controller: what its guard foresees happens, what it promises is kept, what it keeps is certified."""

from __future__ import annotations

import copy
import json
from typing import NamedTuple

import numpy as np
import pytest

from controllers import create
from controllers.certified.box import OperatingBox, observe_scenarios
from controllers.certified.claim import Asked, Claim, claim_of
from controllers.certified.falsify import Falsifier
from controllers.certified.proof import Enclosure, States, enclose
from controllers.certified.reduction import ReducedClaim, reduced_claim
from controllers.certified.service import CERTIFIED, TESTED, RefusedError, certify, check_belongs, verify
from controllers.certified.vehicles import vehicles_of
from controllers.guarded.controller import _ROOM_SHADOW, _TANKS
from controllers.guarded.future import TANKS_SIZE, keeps, note_tanks
from controllers.guarded.settings import Promise, ready_masses
from controllers.reserve.enclosures import COLDEST
from controllers.reserve.recovery import kelvin_of
from controllers.switched.settings import target_masses
from station import Decision, InputError, load_scenario, load_station, parse_scenario, simulate
from station.geometry import KELVIN
from station.kernels import CLOSED_CONTROLLER, apply, ask, begin, observe
from station.metrics import metrics
from station.parameters import Station
from station.run import CURRENT, ROW
from station.simulation import longer_run, start_run
from tests.generous import generous

VALVES = [f"{side}_{buffer}" for side in ("inlet", "outlet") for buffer in ("high", "medium", "low")]


class Proved(NamedTuple):
    """What is proved of the rule for the guard at a station."""

    station: Station
    seen: OperatingBox
    claim: Claim
    subject: ReducedClaim
    found: Enclosure


@pytest.fixture(scope="module")
def guard_proof():
    station, actor = generous(), create("guarded")
    actor.start(station)
    seen = observe_scenarios(station, "guarded", {})
    claim = claim_of(station, seen, Asked())
    subject = reduced_claim(actor, station, claim)
    found = enclose(subject.rule, station, seen, claim, ready=subject.ready)
    return Proved(station, seen, claim, subject, found)


def _commands(record):
    return np.array([record[valve] for valve in VALVES])


def _stepped(scenario, decide, until=np.inf):
    """A run of which each command is `decide(observation)`; the run when it is over or at second `until`."""
    run, rules = start_run(scenario)
    run = longer_run(run)
    while begin(run, rules):
        observation = observe(run, rules)
        if observation.time >= until:
            break
        command = decide(observation)
        apply(run, rules, observation, Decision(command), False, (0.0, 0.0, 0.0), CLOSED_CONTROLLER)
    return run


def _usual(station):
    return vehicles_of(station, None, None).widest


def _bench(station, name, within, spacing):
    return Falsifier(station, name, {}, Claim(vehicles_of(station, None, None), spacing, within))


def _drawn(station, random):
    """A scenario of one vehicle from buffers anywhere between two thirds and all of what they begin with."""
    tanks = station.buffers.all
    low, high = ([share * tank.initial_pressure_bar for tank in tanks] for share in (0.67, 1.0))
    state = np.concatenate((random.uniform(low, high), random.uniform(20.0, 55.0, 3)))
    return parse_scenario(_bench(station, "reserve", 900, 900).scenario(state, ((0.0, _usual(station)),)))


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["thesis-fit", "thesis-fit-a"])
@pytest.mark.parametrize("seed", range(4))
def test_what_the_guard_foresees_happens(preset, seed):
    """The rule takes over from `switched` in some second: the fill ends when foreseen, to the second."""
    random, station = np.random.default_rng(seed), load_station(preset)
    takeover = float(random.integers(1, 300))
    first, rule = create("switched"), create("reserve")
    for controller in (first, rule):
        controller.start(station)
    plan, safe = first.compiled(), rule.compiled()
    tanks, kept = np.zeros(TANKS_SIZE), {}

    def decide(observation):
        wanted, fallen = ask(plan, observation).command, ask(safe, observation).command
        if observation.time == takeover:
            vehicle = observation.vehicle_pressure, observation.vehicle_temperature
            note_tanks(observation, vehicle, safe.model, tanks)
            for within in range(300, 1500):
                promise = Promise(float(within), 1e6, 1e-6, 1e-6, 1e-6, -50.0, 2000.0)
                kept[within] = keeps(
                    wanted, 0.0, observation, promise, safe.model, safe.settings, safe.memory.copy(), tanks.copy()
                )
        return wanted if observation.time <= takeover else fallen

    run = _stepped(_drawn(station, random), decide)
    fill = run.vehicles[2, 0] - run.vehicles[1, 0]
    assert kept
    assert [within for within, done in kept.items() if done] == [within for within in kept if within >= fill]


@pytest.mark.parametrize("scenario", ["S1", "S2"])
def test_masses_are_known_to_the_last_bit(scenario):
    given = load_scenario(scenario).on(load_station("thesis-fit"))
    guarded = create("guarded")
    guarded.start(given.station)
    compiled, seen = guarded.compiled(), []

    def decide(observation):
        command = ask(compiled, observation).command
        seen.append(observation.vehicle)
        return command

    run = _stepped(given, decide, until=1500.0)
    tanks = compiled.memory[_TANKS:_ROOM_SHADOW]
    assert max(seen) > 0
    count = 4 if run.counters[CURRENT] == seen[-1] else 3
    for first in (0, 4, 8):
        assert (tanks[first : first + count] == run.state[first : first + count]).all()


def test_without_a_promise_it_is_switched_and_with_one_too_many_the_rule():
    scenario = load_scenario("S1").on(load_station("thesis-fit"))
    nothing = {"within_s": 86_400, "ready_high_bar": 1.0, "ready_medium_bar": 1.0, "ready_low_bar": 1.0}
    free = simulate(scenario, create("guarded", **nothing))
    assert (_commands(free) == _commands(simulate(scenario, create("switched")))).all()
    bound = simulate(scenario, create("guarded", ready_high_bar=2000.0))  # more than it can ever hold
    rule = create("guarded").rule(scenario.station)
    assert (_commands(bound) == _commands(simulate(scenario, rule))).all()
    both = simulate(scenario, create("guarded"))
    assert set(np.unique(both["decision_status"])) == {0, 2}


def test_it_goes_on_with_its_memory_in_another_process():
    scenario = load_scenario("S1").on(load_station("thesis-fit"))
    one, other = create("guarded"), create("guarded")
    one.start(scenario.station)
    other.start(scenario.station)

    def decide(observation):
        if observation.time == 500.0:
            other.memory = np.frombuffer(one.memory.tobytes())
        return (one if observation.time < 500.0 else other).decide(observation).command

    run = _stepped(scenario, decide)
    record = simulate(scenario, create("guarded"))
    rows = run.counters[ROW] + 1
    assert rows == len(record["time"])
    assert (run.codes[:6, : rows - 1] == _commands(record)[:, : rows - 1]).all()


@pytest.mark.slow
def test_a_proof_of_the_rule_holds_box_and_ready_states(guard_proof):
    seen, promise, states = guard_proof.seen, guard_proof.subject.promise, guard_proof.found.states
    assert guard_proof.found.complete
    assert guard_proof.subject.flaw == ""
    assert guard_proof.found.longest <= seen.within < seen.spacing
    assert promise.within <= seen.within
    assert promise.ready <= seen.spacing
    for buffer, tank in enumerate(guard_proof.station.buffers.all):
        for kelvin in (promise.cold, 25.0, guard_proof.station.thermal.buffer_temperature_max_c):
            bar = promise[2 + buffer] * 8.3145 / 0.002016 * 1e-8 / tank.volume_m3 * (kelvin + KELVIN)
            assert bar >= states.floors[buffer, kelvin_of(kelvin)]
        assert promise.top <= states.tops[buffer]
        assert 0.95 * seen.low[buffer] >= states.floors[buffer, kelvin_of(seen.low[3 + buffer])]


def _drawn_states(states, station, random):
    """Buffers anywhere in a proof's states: pressures [bar], temperatures [deg C]."""
    state, plant = np.empty(6), station.constants()
    for buffer in range(3):
        place = random.choice(np.flatnonzero(np.isfinite(states.floors[buffer])))
        warmth = min(COLDEST + place + random.random(), plant.limits.buffer_temperature_max)
        shrunk = min(1.0, (warmth + KELVIN) / (plant.ambient_temperature + KELVIN))
        floor, top = states.floors[buffer, place], min(states.tops[buffer] * shrunk, plant.compressor_pressure - 1e-6)
        state[buffer], state[3 + buffer] = floor + (top - floor) * random.random() ** 3, warmth
    return state


def _runs_keep_the_promise(states, station, within, spacing, runs, seed):
    """Vehicles s or more apart from random states of a proof: fill times, and the buffers whenever one connects."""
    random, bench = np.random.default_rng(seed), _bench(station, "guarded", within, spacing)
    followed = 0
    for _ in range(runs):
        gaps = np.ceil(spacing * random.choice([1.0, 1.0, 1.3, 4.0], 3))
        arrivals = (0.0, *map(float, np.cumsum(gaps)))
        comes = tuple((time, _usual(station)) for time in arrivals)
        scenario = parse_scenario(bench.scenario(_drawn_states(states, station, random), comes))
        record = simulate(scenario, create("guarded"))
        followed += int((record["decision_status"] == 2).sum())
        assert (record.vehicles["finished"] - record.vehicles["connected"]).max() <= within
        assert (record.vehicles["connected"] == record.vehicles["arrival"]).all()
        for row in np.searchsorted(record["time"], record.vehicles["connected"])[1:]:
            for buffer, name in enumerate(("high", "medium", "low")):
                pressure, temperature = record[f"pressure_{name}"][row], record[f"temperature_{name}"][row]
                assert states.floors[buffer, kelvin_of(temperature)] <= pressure <= states.tops[buffer]
    assert followed > 100 * runs


@pytest.mark.slow
def test_runs_from_the_states_of_a_proof_keep_the_promise(guard_proof):
    _runs_keep_the_promise(
        guard_proof.found.states, guard_proof.station, guard_proof.seen.within, guard_proof.seen.spacing, 25, 5
    )


@pytest.mark.full
def test_guarded_is_certified_at_thesis_fit():
    station = load_station("thesis-fit")
    document = certify("guarded", station)
    assert document["verdict"] == CERTIFIED
    assert document["proof"]["longest_fill_s"] <= document["within_s"] <= 1.5 * document["seen"]["worst_fill_s"]
    assert document["spacing_s"] <= 2 * document["seen"]["mean_fill_s"]
    states = States.of_document(document["proof"]["states"])
    _runs_keep_the_promise(states, station, document["within_s"], document["spacing_s"], 40, 3)
    assert verify(json.loads(json.dumps(document))) == document
    with pytest.raises(RefusedError, match="controller"):
        check_belongs(document, "guarded:ready_s=300", station)
    for path, value in (("ready_s", 1.0), ("top_bar", 1.0)):
        changed = copy.deepcopy(document)
        changed["proof"]["guard"][path] = value
        with pytest.raises(RefusedError, match="guard"):
            verify(changed)


@pytest.mark.full
def test_guarded_is_certified_for_vehicles_806_s_apart_within_618_s():
    """Bounds that held with a rule that fills high further; vehicles 760 s apart are served as soon."""
    station = load_station("thesis-fit")
    for spacing in (806, 760):
        document = certify("guarded", station, Asked(spacing=spacing, within=618))
        assert document["verdict"] == CERTIFIED
        assert (document["spacing_s"], document["within_s"]) == (spacing, 618)


@pytest.mark.slow
def test_a_promise_that_is_no_proof_is_only_tested():
    document = certify("guarded:ready_s=5000", generous())
    assert document["verdict"] == TESTED
    assert not document["proof"]["complete"]
    assert "later than s" in document["proof"]["open"]


@pytest.mark.parametrize(
    "preset", ["thesis-fit", "thesis-fit-a", "thesis-fit-b", "thesis-fit-cascade", "light-duty-700"]
)
def test_a_promise_that_can_be_kept_compresses_no_more_than_logic(preset):
    law = {"kind": "uniform", "count": 40, "period_s": 30_000.0}
    day = parse_scenario({"name": "day", "station": preset, "arrivals": law, "time_limit_s": 200_000.0})
    logic, guarded = (metrics(simulate(day, create(name))) for name in ("logic", "guarded"))
    assert guarded.vehicles_not_finished == 0
    assert guarded.t_comp_restored < logic.t_comp_restored


def test_a_certified_promise_compresses_no_more_than_logic_where_vehicles_come_all_day():
    scenario = load_scenario("S3").on(load_station("thesis-fit"))
    logic, guarded = (metrics(simulate(scenario, create(name))) for name in ("logic", "guarded"))
    assert guarded.t_comp_restored <= logic.t_comp_restored
    assert guarded.t_avg <= logic.t_avg
    assert guarded.vehicles_not_finished == 0


def test_the_rule_that_guards_may_fill_less():
    station = load_station("thesis-fit-a")
    own, less = create("guarded"), create("guarded", stop_share=0.8, open_bar=150.0)
    assert own.rule(station).settings_for(station) == create("reserve").settings_for(station)
    rule = less.rule(station).settings_for(station)
    assert (rule.stop_share, rule.open_bar) == (0.8, 150.0)


def test_no_more_is_promised_than_a_plan_keeps():
    station = load_station("light-duty-700")
    settings = create("guarded").settings_for(station)
    kept = target_masses(settings, station)
    assert ready_masses(settings, station)[0] == pytest.approx(0.9 * kept[0])
    assert all(ready < full for ready, full in zip(ready_masses(settings, station), kept, strict=True))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"within_s": 5000}, "longer than T"),
        ({"ready_s": 5000}, "later than s"),
    ],
)
def test_a_promise_that_would_not_do_is_no_proof(options, message):
    station = load_station("thesis-fit")
    actor = create("guarded", **options)
    actor.start(station)
    claim = Claim(vehicles_of(station, None, None), 770, 660)
    assert message in reduced_claim(actor, station, claim).flaw


def test_wrong_settings_are_named():
    with pytest.raises(InputError, match="ready_low_bar"):
        create("guarded", ready_low_bar=-1.0)
    station = load_station("thesis-fit")
    assert create("guarded").settings_for(station).patience == station.controllers["switched"]["patience"]
