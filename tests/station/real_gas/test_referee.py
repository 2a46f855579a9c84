"""A fill computed twice: the model, and CoolProp with forty equal cells under an adaptive integrator."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from station.plants.real_gas.catalog import tank_kind, vehicle_tank
from station.plants.real_gas.gas import enthalpy
from station.plants.real_gas.hydrogen import load_data
from station.plants.real_gas.tables import gas_tables
from station.plants.real_gas.tank import MASS, SURFACE, add, fill_state, look, look_closely, settle, state_length
from tests.station.real_gas.referee import coolprop

GAS = gas_tables()
CELLS = 40
VOLUME, DIAMETER, INLET, AIR, COLD, FLOW = 0.1224, 0.33, 0.005, 293.15, 240.15, 0.025
FACTORS = load_data("heat_transfer.toml")["inner_side"]


@cache
def referee():
    """CoolProp's equation of state of hydrogen."""
    return coolprop().AbstractState("HEOS", "Hydrogen")


def wall():
    """Capacities and conductances of equal cells of 5 mm of polyethylene and 30 mm of fibre [J/K], [W/K]."""
    width = np.repeat([0.005 / CELLS * 2, 0.03 / CELLS * 2], CELLS // 2)
    heat = np.repeat([945.0 * 1584.0, 1360.0 * 1020.0], CELLS // 2)
    conductivity = np.repeat([0.385, 0.5], CELLS // 2)
    length = VOLUME / (math.pi / 4 * DIAMETER**2)
    inner = math.pi * DIAMETER * length + math.pi * DIAMETER**2 / 2
    face = DIAMETER / 2 + np.concatenate([[0.0], np.cumsum(width)])
    middle = (face[1:] + face[:-1]) / 2
    area = inner * face / (DIAMETER / 2)
    half = width / 2 / conductivity
    between = area[1:-1] / (half[:-1] + half[1:])
    outer = area[-1] / (1 / 8.0 + half[-1])
    return heat * width * inner * middle / (DIAMETER / 2), between, outer, inner / half[0], inner


CAPACITY, BETWEEN, OUTER, SKIN, AREA = wall()


def coefficient(pressure, kelvin, surface):
    """Nu_D = a Re_d^0.67 + b Ra_D^0.352 with CoolProp's properties of the film [W/(m2 K)]."""
    referee().update(coolprop().PT_INPUTS, pressure, (kelvin + surface) / 2)
    viscosity, conductivity = referee().viscosity(), referee().conductivity()
    reynolds = 4 * FLOW / (math.pi * INLET * viscosity)
    spread = 9.80665 * referee().isobaric_expansion_coefficient() * abs(kelvin - surface) * DIAMETER**3
    rayleigh = spread * referee().rhomass() ** 2 * referee().cpmass() / (viscosity * conductivity)
    nusselt = FACTORS["forced"] * reynolds**0.67 + FACTORS["free"] * rayleigh**0.352
    return nusselt * conductivity / DIAMETER


def slopes(_, state):
    mass, energy, cells = state[0], state[1], state[2:]
    referee().update(coolprop().DmassUmass_INPUTS, mass / VOLUME, energy / mass)
    pressure, kelvin = referee().p(), referee().T()
    surface = (kelvin + cells[0]) / 2
    for _ in range(20):
        inner = coefficient(pressure, kelvin, surface) * AREA
        surface = (inner * kelvin + SKIN * cells[0]) / (inner + SKIN)
    heat = inner * (kelvin - surface)
    through = np.concatenate([[heat], BETWEEN * (cells[:-1] - cells[1:]), [OUTER * (cells[-1] - AIR)]])
    referee().update(coolprop().PT_INPUTS, pressure, COLD)
    return np.concatenate([[FLOW, FLOW * referee().hmass() - heat], (through[:-1] - through[1:]) / CAPACITY])


def test_a_precooled_fill_is_coolprops():
    referee().update(coolprop().PT_INPUTS, 5e6, AIR)
    start = [referee().rhomass() * VOLUME, referee().rhomass() * VOLUME * referee().umass(), *[AIR] * CELLS]
    found = solve_ivp(slopes, (0, 150), start, method="LSODA", rtol=1e-6, t_eval=[30.0, 150.0], max_step=5.0)
    tank = vehicle_tank(tank_kind("type4-122.4"), 1.0)
    state = np.zeros(state_length(tank))
    fill_state(state, 0, tank, 5e6, AIR, AIR, GAS)
    for second in range(150):
        p, *_ = look_closely(state, 0, tank, GAS)
        after = state.copy()
        add(after, 0, FLOW, FLOW * enthalpy(p, COLD, GAS))
        nozzle = (p + look(after, 0, tank, GAS)[0]) / 2
        add(state, 0, FLOW, FLOW * enthalpy(nozzle, COLD, GAS))
        settle(state, 0, tank, FLOW, AIR, 1.0, GAS)
        if second + 1 in {30, 150}:
            mass, energy, *cells = found.y[:, 0 if second < 100 else 1]
            referee().update(coolprop().DmassUmass_INPUTS, mass / VOLUME, energy / mass)
            pressure, kelvin = look(state, 0, tank, GAS)
            assert state[MASS] == pytest.approx(mass, rel=1e-6)
            assert kelvin == pytest.approx(referee().T(), abs=0.3)
            assert pressure == pytest.approx(referee().p(), rel=1e-3)
            assert state[SURFACE] == pytest.approx(cells[0], abs=1.5)
