"""Limits under error: margins proved exactly, readings within their error, and no limit broken in the true plant."""

from __future__ import annotations

import json
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers import create
from station import Decision, InputError, load_scenario, load_station, parse_scenario, scenario, simulate
from station.limits import (
    buffer_temperature_margin,
    compressor_margin,
    flow_margin,
    gap_margin,
    hold_margin,
    state_limits,
    vehicle_temperature_margin,
)
from station.live import AtEnd, LiveRun, SlotState
from station.margins import Proof, certify
from station.plants.thesis import gas_pressure
from station.readings import readings
from station.tightening import tightened
from station.tube import TankInputs, TankInterval, next_interval, pressure_interval
from station.uncertainty import RELATIVE, Uncertainty, deviated
from station.valves import limits_at
from tests.samples import THESIS_PRESETS
from tests.station.disturbed import least_margins

USUAL = Uncertainty()
CORNERS = {"sensors": "corner", "plant": "corner"}
SIGNS = st.sampled_from([-1.0, 1.0])
SHARES = st.one_of(SIGNS, st.floats(-1, 1))
ROUNDING = 1e-11
"""What double arithmetic loses of a margin of some hundreds: what the proof's last decimal is there for."""


def disturbed(name="S1", preset="thesis-fit", *, communication=True, seed=0, **disturbance):
    base = load_scenario(name).on(load_station(preset)).model_dump()
    given = {"disturbance": {**CORNERS, "seed": seed, **disturbance}, "communication": communication}
    return parse_scenario({**base, **given})


def shortened(name, count, period, **others):
    base = disturbed(name, **others).model_dump()
    base["arrivals"] |= {"count": count, "period_s": period}
    return parse_scenario({**base, "time_limit_s": period + 3600.0})


# ---------------------------------------------------------------- the proof


@pytest.mark.parametrize("preset", THESIS_PRESETS)
@pytest.mark.parametrize("uncertainty", [USUAL, Uncertainty(parameters=0.2, pressure_bar=3, temperature_k=2)])
def test_the_margins_are_proved_exactly_and_are_the_least(preset, uncertainty):
    proof = certify(load_station(preset), uncertainty)
    assert proof.check() == sum(bound.corners for bound in proof.bounds) == 82
    for place, bound in enumerate(proof.bounds):
        assert 0 < bound.margin - bound.needed <= Fraction(2, 10**9)
        less = list(proof.bounds)
        less[place] = bound.__class__(**{**bound.__dict__, "margin": bound.needed - Fraction(1, 10**9)})
        with pytest.raises(ValueError, match=rf"^{bound.limit}: a margin of"):
            proof.__class__(proof.station, uncertainty, tuple(less)).check()
    document = json.loads(json.dumps(proof.as_document()))
    assert Proof.of_document(document).margins == proof.margins
    document["bounds"][0]["margin"] = "1/2"
    with pytest.raises(ValueError, match=r"flow: a margin of 0.5 g/s is broken by"):
        Proof.of_document(document)
    with pytest.raises(ValueError, match="not a document"):
        Proof.of_document({**document, "bounds": []})


def test_the_margins_are_those_of_a_calculation_by_hand():
    plant, margins = load_station("thesis-fit").constants(), certify(load_station("thesis-fit"), USUAL).margins
    assert margins["gap"] == pytest.approx(2, abs=3e-9)
    assert margins["compressor"] == pytest.approx(2, abs=3e-9)
    assert margins["hold"] == pytest.approx(1, abs=3e-9)
    assert margins["flow"] == pytest.approx(60 - 60 / 1.05 + 2 * plant.outlet_coefficient, abs=3e-9)
    hottest = (80 - 1.05 * plant.vehicle_heating - 0.95 * plant.heat_exchange * 25.5) / (1 - 0.95 * plant.heat_exchange)
    least = vehicle_temperature_margin(hottest - 0.5, plant, 1.0)
    assert margins["vehicle_temperature"] == pytest.approx(least, abs=1e-8)


def test_nothing_uncertain_needs_no_margin():
    none = certify(load_station("thesis-fit"), Uncertainty(parameters=0, pressure_bar=0, temperature_k=0))
    assert all(bound.needed == 0 for bound in none.bounds)
    assert max(none.margins.values()) == 1e-9


# ---------------------------------------------------------------- one second: a valve that may open breaks nothing


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(
    preset=st.sampled_from(THESIS_PRESETS),
    width=st.sampled_from([USUAL, Uncertainty(parameters=0.2, pressure_bar=5, temperature_k=3)]),
    pressure=st.tuples(*[st.floats(50, 960)] * 3),
    close=st.sampled_from(["", "flow", "gap", "compressor", "hold", "vehicle_temperature", "buffer_temperature"]),
    temperature=st.tuples(*[st.floats(-20, 90)] * 4),
    vehicle=st.floats(20, 800),
    errors=st.tuples(*[SHARES] * 8),
    shares=st.fixed_dictionaries(dict.fromkeys((*RELATIVE, "compressor_pressure", "ambient_temperature"), SHARES)),
    previous=st.integers(0, 7),
)
def test_what_may_open_at_the_readings_may_open_in_truth(
    preset, width, pressure, close, temperature, vehicle, errors, shares, previous
):
    """States drawn anywhere and, with `close`, put on the very edge of a limit as the shield sees it."""
    station = load_station(preset)
    told = tightened(station, certify(station, width)).constants()
    pressure, temperature = list(pressure), list(temperature)
    if close == "flow":
        pressure[0] = vehicle + told.limits.dispenser_flow_max / told.outlet_coefficient
    if close == "gap":
        pressure[0] = vehicle + told.limits.outlet_gap_min
    if close in {"compressor", "hold"}:
        pressure[0] = told.compressor_pressure if close == "compressor" else told.limits.hold_pressure
    if "temperature" in close:
        k, t_env = told.heat_exchange, told.ambient_temperature
        heat, most = told.vehicle_heating, told.limits.vehicle_temperature_max
        if close == "buffer_temperature":
            heat, most = told.inlet_heating[0], told.limits.buffer_temperature_max
        temperature[0 if close == "buffer_temperature" else 3] = (most - heat - k * t_env) / (1 - k)
    seen = limits_at((*pressure, vehicle), tuple(temperature), True, previous, True, told, 1.0)
    true_pressure = [p + width.pressure_bar * e for p, e in zip((*pressure, vehicle), errors[:4], strict=True)]
    true_temperature = [t + width.temperature_k * e for t, e in zip(temperature, errors[4:], strict=True)]
    plant = deviated(station.constants(), width, shares)
    for buffer in range(3):
        if seen.outlet[buffer] == 0:
            assert flow_margin(true_pressure[buffer], true_pressure[3], plant) >= 0
            assert gap_margin(true_pressure[buffer], true_pressure[3], plant) >= 0
            assert vehicle_temperature_margin(true_temperature[3], plant, 1.0) >= 0
        if seen.inlet[buffer] == 0:
            assert compressor_margin(buffer, true_pressure[buffer], plant) > 0
            assert buffer_temperature_margin(buffer, true_pressure[buffer], true_temperature[buffer], plant, 1.0) >= 0
            if not previous >> buffer & 1:
                assert hold_margin(true_pressure[buffer], plant) >= 0


def test_margins_are_not_larger_than_worst_errors_need():
    """At the edge of what the shield admits, some corner leaves nothing of the true margin."""
    for preset in THESIS_PRESETS:
        station = load_station(preset)
        told = tightened(station, certify(station, USUAL)).constants()
        gap = told.limits.dispenser_flow_max / told.outlet_coefficient
        worst = min(
            flow_margin(gap + one, two, deviated(station.constants(), USUAL, {"outlet_coefficient": share}))
            for one, two, share in product((-1, 1), repeat=3)
        )
        assert 0 <= worst < 1e-8


# ---------------------------------------------------------------- the interval of a vehicle that reports nothing


@settings(max_examples=150, deadline=None)
@given(
    start=st.tuples(st.floats(20, 300), st.floats(-10, 40)),
    shares=st.fixed_dictionaries(dict.fromkeys(("outlet_coefficient", "vehicle_heating", "heat_exchange"), SHARES)),
    volume=SHARES,
    sources=st.lists(st.one_of(st.none(), st.floats(100, 950)), min_size=1, max_size=80),
    errors=st.lists(SIGNS, min_size=80, max_size=80),
)
def test_the_tube_holds_the_tank(start, shares, volume, sources, errors):
    station = load_station("thesis-fit")
    plant = deviated(station.constants(), USUAL, shares)
    tank = station.vehicle.volume_m3 * (1 + 0.05 * volume)
    nominal = station.constants()
    per_volume = nominal.outlet_coefficient / station.vehicle.volume_m3
    pressure, temperature = start
    from station.plants.thesis import gas_mass, outlet_flow, vehicle_temperature
    from station.tube import interval_at

    ends = interval_at(pressure + errors[0], temperature + 0.5 * errors[1], 1.0, 0.5)
    mass = gas_mass(pressure, temperature, tank)
    for source, error in zip(sources, errors, strict=False):
        opened = source is not None
        flow = outlet_flow(source, pressure, plant) if opened else 0.0
        read = source + error if opened else 0.0
        drive = TankInputs(
            (read - 1.0, read + 1.0),
            (per_volume * 0.95 / 1.05, per_volume * 1.05 / 0.95) if opened else (0.0, 0.0),
            (0.95 * nominal.vehicle_heating, 1.05 * nominal.vehicle_heating) if opened else (0.0, 0.0),
            (0.95 * nominal.heat_exchange, 1.05 * nominal.heat_exchange),
            (nominal.ambient_temperature - 0.5, nominal.ambient_temperature + 0.5),
        )
        ends = next_interval(ends, drive)
        mass += flow
        temperature = vehicle_temperature(temperature, float(opened), plant, 1.0)
        pressure = gas_pressure(mass, temperature, tank)
        low, high = pressure_interval(ends)
        assert ends.low <= mass / tank <= ends.high
        assert ends.cold <= temperature <= ends.warm
        assert low <= pressure <= high


def test_ends_of_a_tank_have_the_order_they_say():
    ends = next_interval(
        TankInterval(1.0, 2.0, 20.0, 21.0), TankInputs((5.0, 6.0), (0.1, 0.2), (0.0, 0.1), (0.001, 0.002), (24.0, 25.0))
    )
    assert ends.low < ends.high
    assert ends.cold < ends.warm


# ---------------------------------------------------------------- readings


@pytest.mark.parametrize("communication", [True, False])
@pytest.mark.parametrize("sensors", ["exact", "uniform", "corner"])
def test_readings_lie_within_their_error_and_are_what_the_controller_saw(sensors, communication):
    class Seeing(create("logic").__class__):
        def compiled(self):
            return None

        def decide(self, observation):
            self.seen.append(observation)
            return Decision(0)

    plain = disturbed(sensors=sensors, communication=communication).model_dump()
    run = parse_scenario({**plain, "time_limit_s": 1200.0})
    actor = Seeing()
    actor.seen = []
    record = simulate(run, actor)
    pressure, temperature = readings(record)
    for found, what, width in ((pressure, "pressure", 1.0), (temperature, "temperature", 0.5)):
        true = np.array([record[f"{what}_{tank}"] for tank in ("high", "medium", "low", "vehicle")])
        error = np.abs(found - true)
        assert np.nanmax(error) <= width + ROUNDING
        if sensors == "exact":
            assert np.nanmax(error) == 0
        elif sensors == "corner":
            assert np.nanmin(error) >= width - ROUNDING
        else:
            assert 0.45 * width < np.nanmean(error[:3]) < 0.55 * width
    for row, seen in enumerate(actor.seen):
        assert seen.pressure == tuple(pressure[:3, row])
        assert seen.temperature == tuple(temperature[:3, row])
        if not np.isnan(pressure[3, row]):
            assert (seen.vehicle_pressure, seen.vehicle_temperature) == (pressure[3, row], temperature[3, row])
    assert len(np.unique(np.round(pressure[0] - record["pressure_high"], 6))) == {"exact": 1, "corner": 2}.get(
        sensors, len(record)
    )


def test_a_disturbance_repeats_and_its_seeds_differ():
    records = [simulate(disturbed(seed=seed), create("minlp1")).to_bytes() for seed in (4, 4, 5)]
    assert records[0] == records[1] != records[2]
    plants = {disturbed().plant(k) for k in range(5)} | {disturbed(seed=1).plant(0)}
    assert len(plants) > 4


def test_a_given_share_is_the_parameter():
    plant, nominal = disturbed(shares={"outlet_coefficient": -1, "ambient_temperature": 0.5}).plant(), None
    nominal = load_station("thesis-fit").constants()
    assert plant.outlet_coefficient == pytest.approx(0.95 * nominal.outlet_coefficient)
    assert plant.ambient_temperature == pytest.approx(25.25)
    assert plant.buffer_volume == nominal.buffer_volume
    assert plant.limits.outlet_gap_min == nominal.limits.outlet_gap_min


# ---------------------------------------------------------------- the closed loop


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["logic", "minlp1"])
@pytest.mark.parametrize("name", ["S1", pytest.param("S3", marks=pytest.mark.slow)])
@pytest.mark.parametrize("communication", [True, False])
def test_two_hundred_seeds_break_no_limit(name, controller, communication):
    count, period = (3, 500.0) if name == "S1" else (4, 1350.0)
    least = {}
    for seed in range(200):
        run = shortened(name, count, period, communication=communication, seed=seed)
        record = simulate(run, create(controller), replication=seed % 3)
        margins = least_margins(record, obeys_hold=controller != "logic")
        for limit, margin in margins.items():
            assert margin >= 0, (seed, limit, margin)
            least[limit] = min(least.get(limit, np.inf), margin)
        assert record.metrics().vehicles_not_finished == 0
    assert {"flow", "gap", "vehicle_temperature", "compressor", "buffer_temperature"} <= set(least)


def test_without_margins_limits_are_broken(monkeypatch):
    """The same runs with every margin 0: what the margins are for."""
    monkeypatch.setattr(
        scenario, "tightened", lambda station, proof: tightened(station, _WithoutMargins(station, proof.uncertainty))
    )
    broken = set()
    for preset, seed in product(["thesis-fit", "thesis-fit-cascade"], range(12)):
        for communication in (True, False):
            run = disturbed(preset=preset, seed=seed, communication=communication)
            record = simulate(run, create("minlp1"), replication=seed % 2)
            broken |= {limit for limit, margin in least_margins(record).items() if margin < 0}
    assert {"gap", "hold"} <= broken


class _WithoutMargins:
    def __init__(self, station, uncertainty):
        self.station, self.uncertainty = station, uncertainty
        self.margins = dict.fromkeys((limit.name for limit in state_limits()), 0.0)


@pytest.mark.parametrize("preset", THESIS_PRESETS)
@pytest.mark.parametrize("communication", [True, False])
def test_every_preset_still_serves_its_vehicles(preset, communication):
    """In every replication, but for minlp1 at light-duty-700: docs/certified.md says what Eq. (7.11) bars there."""
    for controller, seed in product(["logic", "minlp1"], range(4)):
        replication = 0 if (preset, controller) == ("light-duty-700", "minlp1") else seed
        given = disturbed(preset=preset, communication=communication, seed=seed)
        record = simulate(given, create(controller), replication=replication)
        assert record.metrics().vehicles_not_finished == 0, (controller, seed)
        assert min(least_margins(record, obeys_hold=controller != "logic").values()) >= 0


class Stubborn:
    """Opens everything, every second: the shield alone keeps the limits."""

    name, obeys_hold = "stubborn", True

    def start(self, station):
        self.random = np.random.default_rng(0)

    def decide(self, observation):
        return Decision(int(self.random.integers(64)))


@pytest.mark.parametrize("communication", [True, False])
@pytest.mark.parametrize("preset", ["thesis-fit-a", pytest.param("light-duty-700", marks=pytest.mark.slow)])
def test_the_shield_alone_keeps_every_limit(preset, communication):
    for seed in range(3):
        record = simulate(shortened("S1", 2, 400.0, preset=preset, communication=communication, seed=seed), Stubborn())
        assert min(least_margins(record).values()) >= 0


@pytest.mark.parametrize("communication", [True, False])
def test_a_live_run_is_the_simulation_and_survives_a_restart(communication):
    given = disturbed(communication=communication)
    record = simulate(given, create("minlp1"))
    actor, fallback = create("minlp1"), create("logic")
    actor.start(given.known_station)
    fallback.start(given.known_station)
    seat = SlotState(actor.decide, actor.obeys_hold, fallback=fallback.compiled())
    run = LiveRun(given, AtEnd.STOP)
    rows = [run.step(seat).row for _ in range(400)]
    after = LiveRun(given, AtEnd.STOP)
    after.restore(run.snapshot())
    while not after.over:
        rows.append(after.step(seat).row)
    expected = np.array([record[name] for name in record.columns], float).T
    assert np.array(rows).tobytes() == expected.tobytes()
    with pytest.raises(InputError, match="snapshot"):
        LiveRun(load_scenario("S1"), AtEnd.STOP).restore(run.snapshot())


# ---------------------------------------------------------------- what cannot be


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"disturbance": {"uncertainty": {"pressure_bar": 20.0}}, "finish": 790.0}, "no vehicle is sure to reach"),
        ({"disturbance": {"uncertainty": {"temperature_k": 10.0}}, "ambient": 55.0}, "valves stay closed at ambient"),
        ({"disturbance": {}, "idle_period_s": 5}, "idle_period_s must be 1"),
        ({"disturbance": {"uncertainty": {"parameters": 0.9}}}, "less than or equal to 0.3"),
        ({"disturbance": {"shares": {"outlet_coefficient": 1.5}}}, "less than or equal to 1"),
        ({"disturbance": {"uncertainty": {"pressure_bar": 15.0}}, "flow": 7.0}, "no outlet is sure to open"),
    ],
)
def test_a_disturbance_that_a_station_cannot_bear_is_refused(change, message):
    document = load_scenario("S1").model_dump()
    if "finish" in change:
        document["station"]["vehicle"]["finish_pressure_bar"] = change.pop("finish")
    if "ambient" in change:
        document["station"]["thermal"]["ambient_temperature_c"] = change.pop("ambient")
    if "flow" in change:
        document["station"]["dispenser"]["flow_max_g_per_s"] = change.pop("flow")
    with pytest.raises(InputError, match=message):
        parse_scenario({**document, **change})


def test_a_tank_nobody_could_know_is_refused():
    trace = {"kind": "trace", "vehicles": [{"time_s": 0, "start_pressure_bar": 100, "volume_m3": 0.2}]}
    parse_scenario({"name": "x", "arrivals": trace, "disturbance": {}})
    with pytest.raises(InputError, match=r"vehicles.0.volume_m3 must be the station's usual"):
        parse_scenario({"name": "x", "arrivals": trace, "disturbance": {}, "communication": False})
    live = LiveRun(disturbed(communication=False), AtEnd.IDLE)
    with pytest.raises(InputError, match="volume_m3 must be"):
        live.add_vehicle(100.0, volume=0.2)
    with pytest.raises(InputError, match="finish_pressure_bar"):
        live.add_vehicle(100.0, finish_pressure=720.0)
