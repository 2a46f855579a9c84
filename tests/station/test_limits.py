"""The admissible commands and the shield, Eqs (7.11)-(7.19)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from station import Limit, Valve, load_station
from station.valves import ValveLimits, commands, limits_at, refused_limit, shield

PLANT = load_station("thesis-fit").constants()


@pytest.mark.parametrize(("compressors", "count"), [(1, 13), (2, 19), (3, 20), (4, 20)])
def test_number_of_commands(compressors, count):
    assert len(commands(compressors)) == count


def at(
    pressure=(700.0, 600.0, 500.0), vehicle=200.0, temperature=30.0, vehicle_temperature=30.0, previous=0, *, hold=True
):
    state = (*pressure, vehicle), (temperature,) * 3 + (vehicle_temperature,)
    return limits_at(*state, True, previous, hold, PLANT, 1.0)


def test_each_limit_is_named():
    assert at() == ValveLimits((0, 0, 0), (0, 0, 0))
    assert at(vehicle=450.0).outlet == (0, 0, Limit.GAP)
    assert at(vehicle=400.0).outlet == (0, 0, 0)  # a gap of exactly 100 bar suffices
    assert at(vehicle_temperature=79.99).outlet == (Limit.VEHICLE_TEMPERATURE,) * 3
    assert at(temperature=63.3).inlet == (Limit.BUFFER_TEMPERATURE,) * 3
    assert at(pressure=(801.0, 800.0, 799.0)).inlet == (Limit.HOLD, 0, 0)
    assert at(pressure=(801.0, 800.0, 799.0), previous=int(Valve.INLET_HIGH)).inlet == (0, 0, 0)
    assert at(pressure=(801.0, 800.0, 799.0), hold=False).inlet == (0, 0, 0)
    assert at(pressure=(958.0, 957.5, 500.0), hold=False).inlet == (Limit.COMPRESSOR_PRESSURE,) * 2 + (0,)
    strong = PLANT._replace(outlet_coefficient=0.13)
    limits = limits_at((700.0, 600.0, 500.0, 200.0), (30.0,) * 4, True, 0, True, strong, 1.0)
    assert limits.outlet == (Limit.FLOW, 0, 0)
    absent = limits_at((700.0, 600.0, 500.0, 0.0), (30.0,) * 4, False, 0, True, PLANT, 1.0)
    assert absent.outlet == (Limit.NO_VEHICLE,) * 3


codes = st.sampled_from([0, 0, 0, int(Limit.GAP), int(Limit.HOLD)])
triples = st.tuples(codes, codes, codes)


@given(st.integers(0, 63), triples, triples, st.integers(1, 4))
def test_the_shield_keeps_an_admissible_part_and_names_the_rest(command, inlets, outlets, compressors):
    kept, refusals = shield(command, 0, ValveLimits(inlets, outlets), compressors)
    assert kept & ~command == 0
    assert kept in commands(compressors)
    limits = (*inlets, *outlets)
    for valve in range(6):
        bit = 1 << valve
        if kept & bit:
            assert limits[valve] == 0
        limit = refused_limit(refusals, valve)
        assert (limit != 0) == bool(command & bit and not kept & bit)
        if limit and limits[valve]:
            assert limit == limits[valve]
        elif limit:  # nothing on the state forbids it, so it must clash with what was kept
            assert (kept | bit) not in commands(compressors)


def test_refused_structural_limits_are_named():
    everything = ValveLimits((0, 0, 0), (0, 0, 0))
    kept, refusals = shield(63, 0, everything, 1)
    assert Valve(kept) == Valve.OUTLET_HIGH | Valve.INLET_MEDIUM
    names = [Limit(refused_limit(refusals, valve)) for valve in range(6)]
    assert names == [Limit.BOTH_SIDES, Limit.NONE, Limit.COMPRESSORS, Limit.NONE, Limit.DISPENSER, Limit.DISPENSER]
