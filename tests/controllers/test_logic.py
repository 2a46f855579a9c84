"""The rule-based controller: each rule on states made for it."""

from __future__ import annotations

import pytest

from controllers import create
from station import Observation, Valve, load_scenario, load_station, simulate

STATION = load_station("thesis-fit")  # stops 938 / 820 / 644 bar, hysteresis 30 bar, cascade gap 177 bar


def seen(pressure, vehicle_pressure=200.0, vehicle=0, time=0.0, previous=0):
    return Observation(time, 1.0, pressure, (25.0,) * 3, vehicle, vehicle_pressure, 25.0, 0.14, True, 0, previous)


def logic(**options):
    actor = create("logic", **options)
    actor.start(STATION)
    return actor


OUTLETS = Valve.OUTLET_HIGH | Valve.OUTLET_MEDIUM | Valve.OUTLET_LOW


def outlet(actor, *arguments, **more):
    return Valve(actor.decide(seen(*arguments, **more)).command) & OUTLETS


def test_largest_gap_opens_the_fullest_buffer_that_may():
    assert outlet(logic(), (700.0, 750.0, 600.0)) == Valve.OUTLET_MEDIUM
    assert outlet(logic(), (280.0, 250.0, 299.0)) == Valve(0)


def test_valves_within_their_minimum_times_are_left_as_they_are():
    high, medium, low = (int(v) for v in (Valve.OUTLET_HIGH, Valve.OUTLET_MEDIUM, Valve.OUTLET_LOW))
    full = seen((900.0, 850.0, 800.0))
    for timed, expected in (
        ((0, 0), high),
        ((0, high), medium),
        ((low, 0), low),
        ((0, high | medium | low), 0),
        ((int(Valve.INLET_HIGH), 0), medium),
        ((low, high), low),
    ):
        assert logic().decide(full._replace(timed=timed)).command & OUTLETS == expected

    empty = seen((200.0, 200.0, 200.0), vehicle=-1)
    for timed, expected in (
        ((0, 0), Valve.INLET_LOW),
        ((0, int(Valve.INLET_LOW)), Valve.INLET_MEDIUM),
        ((int(Valve.INLET_HIGH), 0), Valve.INLET_HIGH),
        ((0, low), Valve.INLET_LOW),
    ):
        assert logic().decide(empty._replace(timed=timed)).command == expected


def test_cascade_goes_low_medium_high_and_never_back_within_a_vehicle():
    actor = logic(dispense="cascade")
    assert outlet(actor, (900.0, 700.0, 500.0)) == Valve.OUTLET_LOW
    assert outlet(actor, (900.0, 700.0, 370.0), time=1.0) == Valve.OUTLET_MEDIUM
    assert outlet(actor, (900.0, 700.0, 600.0), time=2.0) == Valve.OUTLET_MEDIUM
    assert outlet(actor, (900.0, 370.0, 600.0), time=3.0) == Valve.OUTLET_HIGH
    assert outlet(actor, (290.0, 370.0, 600.0), time=4.0) == Valve.OUTLET_LOW  # high is out: the largest gap
    assert outlet(actor, (900.0, 700.0, 500.0), vehicle=1, time=5.0) == Valve.OUTLET_LOW


def test_lowest_label_begins_anew_each_second():
    actor = logic(dispense="lowest_label")
    assert outlet(actor, (900.0, 700.0, 370.0)) == Valve.OUTLET_MEDIUM
    assert outlet(actor, (900.0, 700.0, 500.0), time=1.0) == Valve.OUTLET_LOW


@pytest.mark.parametrize(
    ("refill", "expected"), [("low_first", Valve.INLET_LOW), ("lowest_pressure", Valve.INLET_MEDIUM)]
)
def test_refill_orders(refill, expected):
    assert Valve(logic(refill=refill).decide(seen((900.0, 500.0, 600.0), vehicle=-1)).command) == expected


def test_refill_has_hysteresis_and_spares_the_dispensing_buffer():
    actor = logic()

    def inlets(low, time):
        return Valve(actor.decide(seen((938.0, 820.0, low), vehicle=-1, time=time)).command)

    assert inlets(620.0, 0.0) == Valve(0)  # below the stop, not yet needy
    assert inlets(613.0, 1.0) == Valve.INLET_LOW
    assert inlets(640.0, 2.0) == Valve.INLET_LOW
    assert inlets(644.0, 3.0) == Valve(0)
    dispensing = Valve(logic().decide(seen((600.0, 790.0, 600.0))).command)
    assert dispensing == Valve.OUTLET_MEDIUM | Valve.INLET_LOW


def test_logic_is_exempt_from_the_800_bar_rule():
    record = simulate(load_scenario("S1"), create("logic"))
    opened = record["inlet_high"][1:] > record["inlet_high"][:-1]
    assert (record["pressure_high"][1:][opened] > 800).any()
    assert record.metrics().refused_valves == 0
