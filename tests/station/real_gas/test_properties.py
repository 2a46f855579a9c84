"""Hydrogen's properties: the equation against CoolProp, the tables against the equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from station.errors import StationError
from station.plants.real_gas import gas, leachman, transport
from station.plants.real_gas.tables import (
    PRESSURE_MAX,
    TEMPERATURE_MAX,
    TEMPERATURE_MIN,
    gas_tables,
    spline_coefficients,
)
from tests.station.real_gas.referee import coolprop, measured, references

GAS = gas_tables()
_RNG = np.random.default_rng(5)
PRESSURE = np.exp(_RNG.uniform(np.log(0.1e6), np.log(100e6), 800))
KELVIN = _RNG.uniform(190, 430, 800)
DENSITY = leachman.density(PRESSURE, KELVIN)
FOUND = leachman.properties(DENSITY, KELVIN)


def referee(key, pressure=PRESSURE, kelvin=KELVIN):
    return coolprop().PropsSI(key, "P", pressure, "T", kelvin, "Hydrogen")


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("D", DENSITY),
        ("C", FOUND.heat_capacity_pressure),
        ("O", FOUND.heat_capacity_volume),
        ("A", FOUND.speed_of_sound),
        ("ISOBARIC_EXPANSION_COEFFICIENT", FOUND.expansion),
        ("V", transport.viscosity(DENSITY, KELVIN)),
    ],
)
def test_the_equation_is_coolprops(key, values):
    assert np.abs(values / referee(key) - 1).max() < 1e-7


@pytest.mark.parametrize(
    ("key", "values", "size"),
    [("H", FOUND.enthalpy, 1e6), ("U", FOUND.internal_energy, 1e6), ("S", FOUND.entropy, 1e4)],
)
def test_energy_and_entropy_differ_by_a_constant_at_most(key, values, size):
    assert np.ptp(values - referee(key)) < 1e-8 * size


def test_conductivity_lacks_the_critical_enhancement_alone():
    assert np.abs(transport.conductivity(DENSITY, KELVIN) / referee("L") - 1).max() < 2e-3


def test_choked_flux_is_the_largest_flux_along_coolprops_isentrope():
    for pressure, kelvin in zip(PRESSURE[:12], KELVIN[:12], strict=True):
        flux, ratio = leachman.choked_flux(pressure, kelvin)
        entropy, enthalpy = referee("S", pressure, kelvin), referee("H", pressure, kelvin)

        def negative(share, pressure=pressure, entropy=entropy, enthalpy=enthalpy):
            density, after = (coolprop().PropsSI(key, "P", share * pressure, "S", entropy, "Hydrogen") for key in "DH")
            return -density * np.sqrt(2 * (enthalpy - after))

        largest = minimize_scalar(negative, bounds=(0.3, 0.7), method="bounded", options={"xatol": 1e-6})
        assert flux == pytest.approx(-largest.fun, rel=1e-6)
        assert ratio == pytest.approx(largest.x, abs=1e-3)


@measured
def test_choked_flux_of_the_references():
    for row in references()["choked_flux_kg_m2_s"]:
        flux, ratio = leachman.choked_flux(row["MPa"] * 1e6, row["K"])
        assert flux == pytest.approx(row["flux"], rel=1e-5)
        assert ratio == pytest.approx(row["critical_ratio"], abs=1e-4)
        assert gas.choked(row["MPa"] * 1e6, row["K"], GAS)[0] == pytest.approx(row["flux"], rel=1e-3)


@measured
def test_throttling_of_the_references():
    for row in references()["throttling"]:
        h = gas.enthalpy(row["before_MPa"] * 1e6, row["before_K"], GAS)
        after = gas.temperature_of_enthalpy(row["after_MPa"] * 1e6, h, row["before_K"], GAS)
        assert after == pytest.approx(row["after_K"], abs=2e-3)


def _looked_up(pressure, kelvin):
    density = leachman.density(pressure, kelvin)
    energy = leachman.properties(density, kelvin).internal_energy
    return np.array([gas.state(rho, u, GAS) for rho, u in zip(density, energy, strict=True)]).T


def test_tables_meet_coolprop():
    """The bar: pressure 1e-5, temperature 1e-3 K, choked flux 0.1 % over 190-430 K and 0.1-100 MPa."""
    density = referee("D")
    shift = np.median(FOUND.internal_energy - referee("U"))
    energy = referee("U") + shift
    found = np.array([gas.state(rho, u, GAS) for rho, u in zip(density, energy, strict=True)]).T
    assert np.abs(found[0] / PRESSURE - 1).max() < 1e-5
    assert np.abs(found[1] - KELVIN).max() < 1e-3
    flux = np.array([gas.choked(p, kelvin, GAS)[0] for p, kelvin in zip(PRESSURE, KELVIN, strict=True)])
    assert np.abs(flux / leachman.choked_flux(PRESSURE, KELVIN)[0] - 1).max() < 1e-5


def test_tables_reach_as_far_as_they_say():
    pressure = np.exp(_RNG.uniform(np.log(0.01e6), np.log(PRESSURE_MAX), 800))
    kelvin = _RNG.uniform(TEMPERATURE_MIN, TEMPERATURE_MAX, 800)
    found = _looked_up(pressure, kelvin)
    assert TEMPERATURE_MIN <= 140
    assert TEMPERATURE_MAX >= 490
    assert np.abs(found[0] / pressure - 1).max() < 5e-6
    assert np.abs(found[1] - kelvin).max() < 5e-4
    exact = leachman.properties(leachman.density(pressure, kelvin), kelvin)
    h = np.array([gas.enthalpy(p, t, GAS) for p, t in zip(pressure, kelvin, strict=True)])
    assert np.abs((h - exact.enthalpy) / exact.heat_capacity_pressure).max() < 2e-3


def test_slopes_are_those_of_the_equation():
    energy = FOUND.internal_energy
    found = np.array([gas.state_and_slopes(rho, u, GAS) for rho, u in zip(DENSITY, energy, strict=True)]).T
    sound = np.sqrt(found[2] + found[3] * PRESSURE / DENSITY**2)
    assert np.abs(sound / FOUND.speed_of_sound - 1).max() < 1e-5
    assert np.abs(found[4] / FOUND.heat_capacity_volume - 1).max() < 1e-5


states = st.tuples(st.floats(0.05e6, 109e6), st.floats(142, 488))


@given(states)
def test_a_tank_set_to_a_state_is_in_it(state):
    pressure, kelvin = state
    mass, energy = gas.energy_of(pressure, kelvin, 0.1, GAS)
    found = gas.state(mass / 0.1, energy / mass, GAS)
    assert found[0] == pytest.approx(pressure, rel=1e-9)
    assert found[1] == pytest.approx(kelvin, abs=1e-7)


@given(states, st.floats(1e-3, 0.2))
def test_more_energy_is_hotter_and_more_mass_is_denser(state, share):
    pressure, kelvin = state
    mass, energy = gas.energy_of(pressure, kelvin, 1.0, GAS)
    u = energy / mass
    warmer = gas.state(mass, u + share * 1e5, GAS)
    fuller = gas.state(mass * (1 + 0.1 * share), u, GAS)
    assert warmer[0] > pressure * (1 - 1e-9)
    assert warmer[1] > kelvin
    assert fuller[0] > pressure


@given(states, st.floats(0.01, 0.99))
def test_throttling_keeps_enthalpy(state, share):
    pressure, kelvin = state
    after = gas.temperature_of_enthalpy(share * pressure, gas.enthalpy(pressure, kelvin, GAS), kelvin, GAS)
    if TEMPERATURE_MIN <= after <= TEMPERATURE_MAX:
        exact = [
            leachman.properties(leachman.density(p, t), t).enthalpy
            for p, t in ((pressure, kelvin), (share * pressure, after))
        ]
        assert exact[0] == pytest.approx(exact[1], abs=50)


def test_splines_give_cubics_back():
    x = np.linspace(-1, 2, 9)
    coefficients = spline_coefficients(x**3 - x, 0)
    assert coefficients.shape == (11,)
    middle = (
        coefficients[:-3] / 48 + coefficients[1:-2] * 23 / 48 + coefficients[2:-1] * 23 / 48 + coefficients[3:] / 48
    )
    between = (x[1:] + x[:-1]) / 2
    assert middle == pytest.approx(between**3 - between, abs=1e-12)


@pytest.mark.parametrize(
    "ask",
    [
        lambda: leachman.density(np.nan, 300.0),
        lambda: leachman.temperature_of_energy(10.0, np.nan),
        lambda: leachman.temperature_of_entropy(10.0, np.nan, 300.0),
        lambda: leachman.isentropic_enthalpy(1e7, np.nan),
        lambda: leachman.choked_flux(1e7, np.nan),
    ],
)
def test_what_is_no_gas_is_an_error(ask):
    with pytest.raises(StationError, match="must be those of a gas"):
        ask()


@given(states, st.floats(-100.0, 100.0))
def test_a_temperature_is_found_from_its_enthalpy_wherever_the_search_begins(state, off):
    pressure, kelvin = state
    guess = min(max(kelvin + off, TEMPERATURE_MIN), TEMPERATURE_MAX)
    found = gas.temperature_of_enthalpy(pressure, gas.enthalpy(pressure, kelvin, GAS), guess, GAS)
    assert found == pytest.approx(kelvin, abs=1e-9)
