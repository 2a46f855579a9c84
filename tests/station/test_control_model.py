"""The control model: the thesis's equations to the bit without a covolume, and what a real gas adds."""

from __future__ import annotations

import numpy as np
import pytest

from station.control_model import (
    ControlModel,
    advance,
    as_thesis,
    effort,
    gas_mass,
    gas_pressure,
    is_thesis,
    most_dispensed,
    stiffness,
    thesis_model,
    vehicle_temperature,
)
from station.geometry import KELVIN, VEHICLE
from station.parameters import Station
from station.plants import thesis
from station.plants.interface import M, P, T, plant_named
from station.plants.real_gas.compressor import compressor_work
from station.plants.real_gas.hydrogen import BAR
from station.preset_files import load_station, presets

THESIS = [name for name in presets() if load_station(name).real_gas is None]
REAL = thesis_model(load_station("h70-light").constants())._replace(
    covolume=8e-6, nozzle_flow=60.0, ramp=3.667, delivered_temperature=349.0, wall_conductance=10.0,
    driving_pressure=20_000.0, inlet_coefficient=4e-4, outlet_coefficient=1.4, compressor_pressure=950.0,
)  # fmt: skip


def begun(model, volume: float, random: np.random.Generator) -> np.ndarray:
    state = np.zeros(12)
    for tank in range(4):
        size = volume if tank == VEHICLE else model.buffer_volume[tank]
        state[P + tank], state[T + tank] = random.uniform(50, 900), random.uniform(-20, 60)
        state[M + tank] = gas_mass(state[P + tank], state[T + tank], size, model)
    return state


@pytest.mark.parametrize("name", THESIS)
def test_without_what_a_real_gas_adds_it_is_the_thesis_to_the_bit(name):
    plant = load_station(name).constants()
    model = thesis_model(plant)
    random = np.random.default_rng(1)
    for _ in range(50):
        mine = begun(model, 0.14, random)
        its = mine.copy()
        for command in random.integers(0, 64, 20):
            spent = advance(mine, 0.14, int(command), 1.0, model), thesis.advance(its, 0.14, int(command), 1.0, plant)
            assert mine.tobytes() == its.tobytes()
            assert spent[0] == spent[1]


@pytest.mark.parametrize("name", THESIS)
def test_it_begins_with_the_constants_of_the_thesis(name):
    """Either is made of the other by place."""
    plant = load_station(name).constants()
    assert ControlModel._fields[: len(plant._fields)] == plant._fields
    assert as_thesis(thesis_model(plant)) == plant


def test_mass_and_pressure_are_each_others_inverse():
    for pressure in (5.0, 350.0, 900.0):
        mass = gas_mass(pressure, 20.0, 0.14, REAL)
        assert gas_pressure(mass, 20.0, 0.14, REAL) == pytest.approx(pressure, rel=1e-12)
        slope = (gas_pressure(mass + 1e-3, 20.0, 0.14, REAL) - gas_pressure(mass - 1e-3, 20.0, 0.14, REAL)) / 2e-3
        assert stiffness(pressure, mass, 0.14, REAL) == pytest.approx(slope, rel=1e-6)


def test_a_covolume_takes_gas_away():
    """70 MPa and 15 degC: 40.17 g/L (SAE J2601); an ideal gas would be 58.9."""
    assert gas_mass(700.0, 15.0, 1e-3, REAL._replace(covolume=7.69e-6)) == pytest.approx(40.17, rel=0.02)
    assert gas_mass(700.0, 15.0, 1e-3, REAL._replace(covolume=0.0)) == pytest.approx(58.9, rel=0.01)


def test_the_ramp_brings_the_pressure_up_as_it_says():
    state = begun(REAL, 0.14, np.random.default_rng(0))
    state[P : P + 4] = 900.0, 700.0, 500.0, 100.0
    state[T : T + 4] = 25.0
    for tank in range(4):
        size = 0.14 if tank == VEHICLE else REAL.buffer_volume[tank]
        state[M + tank] = gas_mass(state[P + tank], 25.0, size, REAL)
    before = state.copy()
    spent = advance(state, 0.14, 8, 1.0, REAL)
    assert spent.dispensed < REAL.nozzle_flow
    assert state[P + VEHICLE] - before[P + VEHICLE] == pytest.approx(REAL.ramp, rel=1e-3)
    assert state[M : M + 4].sum() == pytest.approx(before[M : M + 4].sum(), rel=1e-14)


def test_the_nozzle_caps_what_several_outlets_give():
    model = REAL._replace(ramp=60.0)
    state = begun(model, 1.0, np.random.default_rng(0))
    state[P : P + 4] = 900.0, 700.0, 500.0, 100.0
    assert advance(state, 1.0, 8 + 16 + 32, 1.0, model).dispensed == pytest.approx(60.0)


def test_a_closed_vehicle_cools_to_the_air():
    warm = 70.0
    mass = gas_mass(700.0, warm, 0.14, REAL)
    for _ in range(100_000):
        warm = vehicle_temperature(warm, 0.0, mass, 0.0, 0.14, REAL, 1.0)
    assert warm == pytest.approx(REAL.ambient_temperature, abs=0.01)


def test_gas_alone_warms_an_empty_tank_to_what_is_delivered():
    model = REAL._replace(wall_conductance=0.0)
    kelvin = vehicle_temperature(20.0, 1.0, 0.0, 10.0, 0.14, model, 1.0) + KELVIN
    assert kelvin == pytest.approx(model.delivered_temperature)


def test_without_caps_nothing_holds_a_flow_back():
    model = thesis_model(load_station("thesis-fit").constants())
    assert most_dispensed(1000.0, 20.0, 100.0, 0.14, model, 1.0) == np.inf


def test_a_section_for_a_station_without_a_ramp_is_refused():
    given = load_station("thesis-fit").model_dump()
    given["control_model"] = {
        "driving_pressure_bar": 1000.0, "inlet_coefficient_g_per_s_bar": 0.1, "outlet_coefficient_g_per_s_bar": 0.1,
        "inlet_heating_k_per_s": [0.1] * 3, "outlet_cooling_k_per_s": [0.1] * 3, "heat_exchange_per_s": 0.001,
        "covolume_l_per_kg": 8.0, "delivered_k": 350.0, "wall_conductance_g_per_s_m3": 10.0,
    }  # fmt: skip
    with pytest.raises(ValueError, match="control_model must be given with plant = 'real-gas' alone"):
        Station.model_validate(given)


@pytest.mark.parametrize("name", ["h70-light", "h70-equal"])
def test_a_second_of_compressor_counts_what_it_works(name):
    station = load_station(name)
    model = station.control_constants()
    unit = plant_named(station.plant).constants_of(station, communication=True).station.compressor
    top = model.compressor_pressure
    pressures = np.linspace(0.5 * top, top, 9)
    work = np.array([compressor_work(bar * BAR, unit) for bar in pressures])
    counted = np.array([effort(bar, model) for bar in pressures])
    assert counted[[0, -1]].mean() == pytest.approx(1.0)
    assert counted / counted[0] == pytest.approx(work / work[0], rel=0.05)  # a line through a curve
    assert counted[-1] > 1.5 * counted[0]


@pytest.mark.parametrize("name", THESIS)
def test_every_second_counts_alike_in_the_thesis(name):
    model = load_station(name).control_constants()
    assert {effort(bar, model) for bar in (0.0, 345.6, model.compressor_pressure)} == {1.0}


@pytest.mark.parametrize("field", ["covolume", "nozzle_flow", "ramp", "delivered_temperature", "driving_pressure"])
def test_any_of_what_a_real_gas_adds_makes_it_another_model(field):
    model = thesis_model(load_station("thesis-fit").constants())
    assert is_thesis(model)
    assert not is_thesis(model._replace(**{field: getattr(REAL, field)}))
