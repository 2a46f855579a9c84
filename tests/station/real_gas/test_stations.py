"""The station's kernels: ledgers to rounding, a day of fills, compressor, precooler."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.plants.real_gas import leachman
from station.plants.real_gas import station as plant
from station.plants.real_gas.catalog import TEMPERATURE_LIMIT, tank_kind, vehicle_tank
from station.plants.real_gas.compressor import compressor_flow, compressor_work
from station.plants.real_gas.fill import End, ends_of
from station.plants.real_gas.layout import (
    BANKS,
    BLOCK,
    CAME,
    COMPRESSED,
    CONNECTED,
    DELIVERY,
    TAIL,
    VENTED,
    WENT,
    WORK,
    Visit,
    station_of,
)
from station.plants.real_gas.machines import bank_of, compressor_with, line_with, precooler_with
from station.plants.real_gas.options import CompressorOptions, DispensingOptions, PrecoolerOptions
from station.plants.real_gas.precooler import block_after
from station.plants.real_gas.tables import gas_tables
from station.plants.real_gas.tank import MASS, fill_state, look

GAS = gas_tables()
AIR = 293.15
KINDS = [tank_kind("type4-140"), tank_kind("type4-60"), tank_kind("type4-122")]
TANKS = [vehicle_tank(kind, 1.0) for kind in KINDS]
LOWEST = (95e6, 75e6, 50e6)


COMPRESSOR = compressor_with(CompressorOptions(), AIR)
PRECOOLER = precooler_with(PrecoolerOptions())
LINE = line_with(DispensingOptions(ramp_mpa_per_min=20.0))


def station(volume=0.5):
    banks = bank_of(volume, 1.0), bank_of(volume, 1.0), bank_of(volume, 1.0)
    cells = len(TANKS[0].wall.capacity)
    return station_of(banks, cells, COMPRESSOR, PRECOOLER, LINE, AIR)


def visits(ramp=20e6 / 60, share=0.95):
    ends = [ends_of(kind, share, None) for kind in KINDS]
    return [
        Visit(5e6 + 1e6 * place, AIR, ramp, each.mass, each.pressure, each.temperature)
        for place, each in enumerate(ends)
    ]


def state_of(of, pressures, kelvin):
    """Banks at pressures [Pa] and a temperature [K], an empty line, and a cold precooler."""
    state = np.zeros(of.rest_at + TAIL)
    for place, (bank, pressure) in enumerate(zip((of.high, of.medium, of.low), pressures, strict=True)):
        fill_state(state, place * of.stride, bank, pressure, kelvin, kelvin, GAS)
    plant.start(state, of, GAS)
    return state


def assert_accounted(start, end, of, index):
    """What came and went explains what is there, to rounding."""
    before, after = (plant.accounts(state, TANKS[index], of) for state in (start, end))
    assert abs(after[0] - before[0]) < 1e-12 * plant.total_mass(end, of)
    assert abs(after[1] - before[1]) < 1e-10 * plant.total_energy(end, TANKS[index], of)


def pressures(state, of):
    return [look(state, place * of.stride, bank, GAS)[0] for place, bank in enumerate((of.high, of.medium, of.low))]


def command(state, index, of):
    """A cascade: the lowest bank that has 1 MPa more than the vehicle gives, the highest that is short is filled."""
    found, bits = pressures(state, of), 0
    if state[of.rest_at + CONNECTED]:
        back = look(state, of.vehicle_at, TANKS[index], GAS)[0]
        giving = next((place for place in (2, 1) if found[place] > 1.05 * back + 1e6), 0)
        bits |= 1 << BANKS + giving
    short = [place for place in range(BANKS) if found[place] < LOWEST[place] and not bits >> BANKS + place & 1]
    return bits | (1 << short[0] if short else 0)


def run(seconds, every, of, fleet, watch=None):
    """A day: a vehicle every so many seconds. Gives the states at the start and the end, and what ended the fills."""
    state = state_of(of, LOWEST, AIR)
    start, ends, index = state.copy(), [], 0
    for second in range(seconds):
        if second % every == 0 and not state[of.rest_at + CONNECTED]:
            index = (second // every) % len(KINDS)
            plant.connect(state, TANKS[index], fleet[index], of, GAS)
        bits = command(state, index, of)
        flows = plant.advance(state, TANKS[index], fleet[index], bits, of, 1.0, GAS)
        if watch:
            watch(state, index, bits, flows)
        if (
            state[of.rest_at + CONNECTED]
            and (end := plant.fill_ends(state, TANKS[index], fleet[index], of, 1.0, GAS)) >= 0
        ):
            plant.disconnect(state, TANKS[index], of, GAS)
            ends.append(End(end))
    return start, state, ends, index


def test_banks_have_as_many_cells():
    with pytest.raises(ValueError, match="as many cells"):
        station_of((bank_of(0.5, 1.0), TANKS[0], bank_of(0.5, 1.0)), 8, None, None, None, AIR)


def test_fills_from_a_cascade():
    """Half an hour with three vehicles: every fill ends by its state of charge, within every limit, and it balances."""
    of, fleet = station(), visits()
    seen = {"kelvin": 0.0, "flow": 0.0, "charge": 0.0, "delivery": []}

    def watch(state, index, bits, flows):
        if state[of.rest_at + CONNECTED]:
            _, kelvin = look(state, of.vehicle_at, TANKS[index], GAS)
            seen["kelvin"] = max(seen["kelvin"], kelvin)
            seen["charge"] = max(seen["charge"], state[of.vehicle_at + MASS] / KINDS[index].full_mass)
            if bits >> BANKS and flows[1] > 1e-3:
                seen["delivery"].append(state[of.rest_at + DELIVERY])
        seen["flow"] = max(seen["flow"], flows[1])

    start, end, ends, index = run(1800, 600, of, fleet, watch)
    assert ends == [End.STATE_OF_CHARGE] * 3
    assert 320 < seen["kelvin"] < TEMPERATURE_LIMIT
    assert 0.03 < seen["flow"] <= 0.06
    assert 0.949 < seen["charge"] <= 0.95 + 1e-12
    assert 233 < np.mean(seen["delivery"]) < 243
    assert_accounted(start, end, of, index)
    tail = end[of.rest_at :]
    given = tail[WENT] - tail[CAME]
    full = [0.95 * kind.full_mass for kind in KINDS]
    assert tail[WENT] == pytest.approx(sum(full), rel=2e-4)
    assert 8 < given < tail[WENT]
    assert 0 < tail[VENTED] < 0.05
    assert 0.6 < tail[WORK] / 3.6e6 / tail[COMPRESSED] < 1.3


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 63), st.integers(1, 40)), max_size=8), st.integers(0, 2), st.booleans())
def test_whatever_is_commanded_the_ledger_closes(commands, index, leaves):
    of, fleet = station(0.05), visits(ramp=60e6 / 60, share=1.0)
    state = state_of(of, (80e6, 40e6, 4e6), AIR)
    start = state.copy()
    plant.connect(state, TANKS[index], fleet[index], of, GAS)
    for bits, seconds in commands:
        for _ in range(seconds):
            compressed, dispensed = plant.advance(state, TANKS[index], fleet[index], bits, of, 1.0, GAS)
            assert compressed >= 0
            assert 0 <= dispensed <= of.line.flow_max * (1 + 1e-12)
    if leaves:
        plant.disconnect(state, TANKS[index], of, GAS)
    else:
        assert state[of.vehicle_at + MASS] <= KINDS[index].full_mass * (1 + 1e-12)
    assert_accounted(start, state, of, index)


@pytest.mark.slow
def test_the_ledger_of_twelve_hours():
    of, fleet = station(), visits()
    start, end, ends, index = run(43_200, 1080, of, fleet)
    assert len(ends) == 40
    assert_accounted(start, end, of, index)


def test_a_station_at_rest_cools_down_to_the_air():
    of, fleet = station(), visits()
    state = state_of(of, LOWEST, AIR + 20)
    start = state.copy()
    for _ in range(3600):
        plant.advance(state, TANKS[0], fleet[0], 0, of, 1.0, GAS)
    for place, bank in enumerate((of.high, of.medium, of.low)):
        before, after = (look(given, place * of.stride, bank, GAS)[1] for given in (start, state))
        assert AIR < after < before
        assert state[place * of.stride + MASS] == start[place * of.stride + MASS]
    assert_accounted(start, state, of, 0)
    assert plant.total_mass(state, of) == plant.total_mass(start, of)
    assert state[of.rest_at + BLOCK] == pytest.approx(of.precooler.set_point, abs=1e-6)
    assert len(state) == of.rest_at + TAIL


def test_a_closed_valve_gives_nothing():
    of, fleet = station(), visits()
    state = state_of(of, LOWEST, AIR)
    plant.connect(state, TANKS[1], fleet[1], of, GAS)
    before = state[of.vehicle_at + MASS]
    assert plant.advance(state, TANKS[1], fleet[1], 0, of, 1.0, GAS) == (0.0, 0.0)
    assert state[of.vehicle_at + MASS] == before
    assert plant.fill_ends(state, TANKS[1], fleet[1], of, 1.0, GAS) == -1
    assert math.isnan(state[of.rest_at + DELIVERY])


def test_the_ramp_waits_for_a_controller_that_pauses():
    of, fleet = station(), visits()
    state = state_of(of, LOWEST, AIR)
    plant.connect(state, TANKS[0], fleet[0], of, GAS)

    def pressure():
        return look(state, of.vehicle_at, TANKS[0], GAS)[0]

    for second in range(120):
        before = pressure()
        plant.advance(state, TANKS[0], fleet[0], 0b100000 if not 30 <= second < 90 else 0, of, 1.0, GAS)
        assert pressure() - before < 6 * fleet[0].ramp
    assert pressure() == pytest.approx(5e6 + 65 * fleet[0].ramp, abs=1e6)


def test_no_gas_flows_back_into_a_bank():
    of, fleet = station(), visits()
    state = state_of(of, (3e6, 3e6, 3e6), AIR)
    plant.connect(state, TANKS[2], fleet[2], of, GAS)
    assert plant.advance(state, TANKS[2], fleet[2], 0b111000, of, 1.0, GAS) == (0.0, 0.0)


def test_the_compressor_stops_at_its_pressure_and_works_by_the_isentropic_enthalpy():
    unit = COMPRESSOR
    assert compressor_flow(unit.pressure_max, unit) == 0.0
    assert 24 < compressor_flow(90e6, unit) * 3600 < 28
    assert compressor_flow(50e6, unit) > compressor_flow(90e6, unit)
    before = leachman.properties(leachman.density(20e6, 293.15), 293.15)
    middle = (20e6 * 90e6) ** 0.5
    second = leachman.properties(leachman.density(middle, 293.15), 293.15)
    work = leachman.isentropic_enthalpy(middle, before.entropy) - before.enthalpy
    work += leachman.isentropic_enthalpy(90e6, second.entropy) - second.enthalpy
    assert compressor_work(90e6, unit) == pytest.approx(float(work) / unit.efficiency, rel=1e-4)
    assert compressor_work(90e6, unit) * unit.efficiency / 3.6e6 == pytest.approx(0.707, abs=0.02)
    assert compressor_work(10e6, unit) == 0.0


def test_the_refrigerator_takes_no_more_than_it_can():
    unit = PRECOOLER
    block, leaked, taken = block_after(unit.set_point, 50e3, AIR, 1.0, unit)
    assert taken == unit.refrigeration
    assert (block - unit.set_point) * unit.capacity == pytest.approx(50e3 + leaked - taken)
    block, leaked, taken = block_after(unit.set_point - 1, 0.0, AIR, 1.0, unit)
    assert taken == 0.0
    assert block > unit.set_point - 1
