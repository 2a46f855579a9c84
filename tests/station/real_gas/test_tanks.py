"""Tanks and flow: exact and converged references, ledgers, convergence in time and cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from station.plants.real_gas import leachman, wall
from station.plants.real_gas.flow import implicit_flow, orifice_flow
from station.plants.real_gas.gas import enthalpy
from station.plants.real_gas.tables import gas_tables
from station.plants.real_gas.tank import (
    ENERGY,
    MASS,
    SURFACE,
    Shape,
    add,
    draw,
    fill_state,
    look,
    look_closely,
    settle,
    state_length,
    stiffness,
    tank_of,
)
from station.plants.real_gas.wall import Layer, exchange
from tests.station.real_gas.referee import adiabatic, filled, measured, references

GAS = gas_tables()
COMPOSITE = [Layer("polyethylene", 0.005, 945.0, 1584.0, 0.385), Layer("fibre", 0.03, 1360.0, 1020.0, 0.5)]
STEEL = [Layer("steel", 0.02, 7800.0, 500.0, 45.0)]


def rise(state, tank, h):
    _, _, by_rho, by_u, _ = look_closely(state, 0, tank, GAS)
    return stiffness(state[MASS] / tank.volume, state[ENERGY] / state[MASS], by_rho, by_u, h, tank.volume)


def walled(layers=None, diameter=0.33, volume=0.1224, period=1.0, **more):
    length = volume / (math.pi / 4 * diameter**2)
    return tank_of(Shape(volume, diameter, length), layers or COMPOSITE, 8.0, period, 0.005, **more)


@measured
def test_adiabatic_fills():
    for row in references()["adiabatic_fill"]:
        tank = adiabatic(row["volume_m3"])
        state = filled(tank, row["start_MPa"] * 1e6, row["start_K"])
        assert state[MASS] == pytest.approx(row["start_kg"], abs=1e-6)
        h = enthalpy(row["inlet_MPa"] * 1e6, row["inlet_K"], GAS)
        end = row["end_MPa"] * 1e6
        while (missing := end - look(state, 0, tank, GAS)[0]) > 1.0:
            mass = min(0.03, missing / rise(state, tank, h))
            add(state, 0, mass, mass * h)
        assert look(state, 0, tank, GAS)[1] == pytest.approx(row["end_K"], abs=0.01)
        assert state[MASS] == pytest.approx(row["end_kg"], rel=5e-5)


@measured
@pytest.mark.parametrize("flow", [0.005, 0.02])
def test_adiabatic_discharges(flow):
    for row in references()["adiabatic_discharge"]:
        tank = adiabatic(row["volume_m3"])
        state = filled(tank, row["start_MPa"] * 1e6, row["start_K"])
        end, share = row["end_MPa"] * 1e6, flow * row["volume_m3"] / 0.35
        while (surplus := look(state, 0, tank, GAS)[0] - end) > 1.0:
            p, _ = look(state, 0, tank, GAS)
            h = state[ENERGY] / state[MASS] + p * tank.volume / state[MASS]
            draw(state, 0, tank, min(share, surplus / rise(state, tank, h)), GAS)
        assert look(state, 0, tank, GAS)[1] == pytest.approx(row["end_K"], abs=0.05)
        assert state[MASS] == pytest.approx(row["end_kg"], rel=1e-4)


LEVEL = 1e-6
"""Pressures that differ by less of themselves are equal: what goes to and fro there is rounding, machine by machine."""


def equalised(source, target, area, seconds):
    """Two tanks joined by an orifice for whole seconds: states, pressures and temperatures, reversals of the flow."""
    tanks = adiabatic(source[2]), adiabatic(target[2])
    states = [filled(tank, given[0] * 1e6, given[1]) for tank, given in zip(tanks, (source, target), strict=True)]
    reversals, last = 0, 0
    for _ in range(seconds):
        first = int(look(states[1], 0, tanks[1], GAS)[0] > look(states[0], 0, tanks[0], GAS)[0])
        state, other, tank = states[first], states[1 - first], tanks[first]
        p, kelvin, by_rho, by_u, _ = look_closely(state, 0, tank, GAS)
        back, *_ = look_closely(other, 0, tanks[1 - first], GAS)
        rho, u = state[MASS] / tank.volume, state[ENERGY] / state[MASS]
        h = u + p / rho
        both = stiffness(rho, u, by_rho, by_u, h, tank.volume) + rise(other, tanks[1 - first], h)
        mass = implicit_flow(orifice_flow(area, p, kelvin, back, GAS), p - back, both, 1.0)
        add(other, 0, mass, draw(state, 0, tank, mass, GAS))
        if p - back > LEVEL * p:
            reversals += first != last
            last = first
    return states, [look(state, 0, tank, GAS) for state, tank in zip(states, tanks, strict=True)], reversals


@measured
def test_tanks_that_equalise():
    for row in references()["equalisation"]:
        before = filled(adiabatic(row["target"][2]), row["target"][0] * 1e6, row["target"][1])[MASS]
        states, (source, target), _ = equalised(row["source"], row["target"], 3e-6, 1500)
        for pressure, _ in (source, target):
            assert pressure / 1e6 == pytest.approx(row["end_MPa"], abs=0.001)
        assert source[1] == pytest.approx(row["source_K"], abs=0.1)
        assert target[1] == pytest.approx(row["target_K"], abs=0.1)
        assert states[1][MASS] - before == pytest.approx(row["moved_kg"], abs=1e-3)


def test_a_huge_valve_settles():
    """Three hundred square centimetres at steps of a second: an explicit flow would reverse for ever."""
    _, (source, target), reversals = equalised((90.0, 293.15, 0.35), (2.0, 293.15, 0.1224), 3e-2, 60)
    assert source[0] == pytest.approx(target[0], rel=LEVEL)
    assert reversals <= 2
    assert 57e6 < source[0] < 60e6


@measured
def test_a_fill_with_a_given_coefficient():
    case = references()["fill_with_given_coefficient"]
    given = case["tank"]
    names = ("thickness_m", "density_kg_m3", "heat_capacity_J_kgK", "conductivity_W_mK")
    layers = [Layer("layer", *(layer[name] for name in names)) for layer in given["layers"]]
    tank = walled(layers, given["inner_diameter_m"], given["volume_m3"], coefficient=case["inner_coefficient_W_m2K"])
    assert tank.wall.area == pytest.approx(given["inner_area_m2"], rel=1e-9)
    state = filled(tank, case["start"]["MPa"] * 1e6, case["start"]["K"])
    inlet = case["inlet"]
    h = enthalpy(inlet["MPa"] * 1e6, inlet["K"], GAS)
    rows = {row[0]: row for row in case["rows"]}
    for second in range(int(max(rows)) + 1):
        if second in rows:
            _, pressure, kelvin, mass, surface, outer = rows[second]
            found = look(state, 0, tank, GAS)
            assert found[0] / 1e5 == pytest.approx(10 * pressure, abs=0.6)
            assert found[1] == pytest.approx(kelvin, abs=0.3)
            assert state[MASS] == pytest.approx(mass, abs=1e-5)
            assert state[SURFACE] == pytest.approx(surface, abs=0.3)
            assert state[-1] == pytest.approx(outer, abs=1.0)
        flows = second < inlet["seconds"]
        if flows:
            add(state, 0, inlet["kg_s"], inlet["kg_s"] * h)
        settle(state, 0, tank, inlet["kg_s"] if flows else 0.0, case["ambient_K"], 1.0, GAS)


def test_a_wall_at_rest_conducts_as_a_cylinder():
    """The steady heat loss through layers is that of concentric cylinders whose ends grow alike."""
    tank = walled(period=1e6)
    state = filled(tank, 20e6, 300.0)
    for _ in range(5):
        given, lost = exchange(state, SURFACE, tank.wall, 350.0, 1e18, 300.0, 290.0, 1e6)
    radius = np.array([0.165, 0.170, 0.200])
    growth = tank.wall.area / radius[0]
    layers = np.log(radius[1:] / radius[:-1]) / np.array([0.385, 0.5]) / growth
    resistance = 1 / 300.0 + layers.sum() + 1 / (8.0 * growth * radius[-1])
    assert given == pytest.approx(lost, rel=1e-9)
    assert given / 1e6 == pytest.approx(60 / resistance, rel=1e-9)
    assert state[SURFACE] == pytest.approx(350.0 - given / 1e6 / 300.0, abs=1e-9)


@given(
    st.floats(0.5e6, 90e6), st.floats(230, 400), st.floats(230, 400), st.floats(230, 330), st.floats(0, 0.06),
    st.sampled_from([COMPOSITE, STEEL]), st.sampled_from([0.1, 1.0, 10.0]),
)  # fmt: skip
def test_heat_is_kept(pressure, kelvin, wall_kelvin, air, inflow, layers, period):
    """Gas, wall and surroundings: what one loses the next has, whatever the step."""
    tank = walled(layers, period=period)
    state = np.zeros(state_length(tank))
    fill_state(state, 0, tank, pressure, kelvin, wall_kelvin, GAS)
    before, stored = state[ENERGY], tank.wall.capacity @ state[SURFACE + 1 :]
    given_heat, lost = settle(state, 0, tank, inflow, air, period, GAS)
    assert state[ENERGY] == before - given_heat
    gained = tank.wall.capacity @ state[SURFACE + 1 :] - stored
    assert gained == pytest.approx(given_heat - lost, abs=1e-11 * stored)
    assert given_heat * (kelvin - wall_kelvin) >= -1e-6 or abs(kelvin - air) > abs(kelvin - wall_kelvin)


@given(st.floats(1e-9, 10), st.floats(1e3, 1e8), st.floats(1e3, 1e12), st.floats(0.01, 10))
def test_implicit_flow_never_passes_the_end(explicit, gap, stiff, period):
    flow = implicit_flow(explicit, gap, stiff, period)
    assert 0 <= flow <= explicit
    assert flow * stiff * period <= gap * (1 + 1e-9)
    left = gap - stiff * period * flow
    assert (flow / explicit) ** 2 == pytest.approx(left / gap, rel=1e-6, abs=1e-9)


@given(st.floats(1e6, 100e6), st.floats(200, 400), st.floats(0, 1.2), st.floats(0, 1.2))
def test_more_back_pressure_is_less_flow(pressure, kelvin, one, other):
    low, high = sorted((one, other))
    assert orifice_flow(1e-6, pressure, kelvin, low * pressure, GAS) >= orifice_flow(
        1e-6, pressure, kelvin, high * pressure, GAS
    )
    assert orifice_flow(1e-6, pressure, kelvin, pressure, GAS) == 0.0


@pytest.mark.slow
def test_subsonic_flow_is_the_isentropic_one():
    """Within 1.5 % of the exact flux of Leachman's equation, at any pressure and ratio."""
    for pressure, kelvin in ((1e6, 293.15), (45e6, 240.0), (90e6, 240.0), (90e6, 330.0)):
        before = leachman.properties(leachman.density(pressure, kelvin), kelvin)
        for ratio in (0.55, 0.7, 0.85, 0.95, 0.99):
            after, cold = ratio * pressure, kelvin
            for _ in range(40):
                found = leachman.properties(leachman.density(after, cold), cold)
                cold *= float(np.exp((before.entropy - found.entropy) / found.heat_capacity_pressure))
            speed = math.sqrt(2 * (float(before.enthalpy) - float(found.enthalpy)))
            exact = float(leachman.density(after, cold)) * speed
            assert orifice_flow(1.0, pressure, kelvin, after, GAS) == pytest.approx(exact, rel=0.015)


def test_cells_that_grow_outward_are_enough(monkeypatch):
    """Four cells a layer are within 0.2 K of forty equal ones in a fill."""

    def end(cells, growth):
        monkeypatch.setattr(wall, "GROWTH", growth)
        tank = walled(cells_per_layer=cells)
        state = filled(tank, 5e6, 293.15)
        h = enthalpy(40e6, 240.15, GAS)
        for _ in range(180):
            add(state, 0, 0.021, 0.021 * h)
            settle(state, 0, tank, 0.021, 293.15, 1.0, GAS)
        return look(state, 0, tank, GAS)[1]

    assert end(4, wall.GROWTH) == pytest.approx(end(40, 1.0), abs=0.2)
