"""What least squares find of a control model: its own figures again, where the days are its own."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create_from
from station import simulate
from station.control_model import advance, gas_mass, thesis_model
from station.estimation.identification import Form, identify
from station.estimation.prediction import day_of, prediction_errors, replay, vehicle_begins
from station.geometry import VEHICLE
from station.plants.interface import M, P, T
from station.preset_files import load_station
from station.scenario_files import load_scenario
from tests.station.test_control_model import REAL


@pytest.fixture(scope="module")
def thesis_day():
    return day_of(simulate(load_scenario("S1"), create_from("logic"), replication=1))


def own_day(model, day):
    """The day as it would be if the model were the plant: the same vehicles and commands."""
    pressure, temperature, flow = np.empty((4, day.command.size)), np.empty((4, day.command.size)), day.flow.copy()
    state = np.zeros(12)
    pressure[:], temperature[:] = day.pressure, day.temperature
    present = -1
    for row in range(day.command.size):
        sizes = (*model.buffer_volume, day.volume[row])
        new = [VEHICLE] if day.vehicle[row] != present and day.vehicle[row] >= 0 else []
        for tank in [0, 1, 2, *new] if row == 0 else new:
            state[P + tank], state[T + tank] = day.pressure[tank, row], day.temperature[tank, row]
            state[M + tank] = gas_mass(state[P + tank], state[T + tank], sizes[tank], model)
        present = day.vehicle[row]
        pressure[:, row], temperature[:, row] = state[P : P + 4], state[T : T + 4]
        flow[:, row] = advance(state, day.volume[row], int(day.command[row]), 1.0, model)
    return day._replace(pressure=pressure, temperature=temperature, flow=flow)


@pytest.mark.slow
def test_the_thesis_plant_is_predicted_exactly_and_found_again(thesis_day):
    plant = thesis_model(load_scenario("S1").station.constants())
    exact = prediction_errors([thesis_day], plant)
    assert max(*exact.buffers, *exact.vehicle) < 1e-9
    wrong = plant._replace(
        inlet_coefficient=0.5 * plant.inlet_coefficient, outlet_coefficient=2.0 * plant.outlet_coefficient,
        vehicle_heating=0.1, heat_exchange=0.01, outlet_cooling=(0.1, 0.1, 0.1),
    )  # fmt: skip
    assert prediction_errors([thesis_day], wrong).buffers[0] > 10
    found = identify([thesis_day], wrong, Form.THESIS)
    assert found.inlet_coefficient == pytest.approx(plant.inlet_coefficient, rel=1e-6)
    assert found.outlet_coefficient == pytest.approx(plant.outlet_coefficient, rel=1e-6)
    assert found.vehicle_heating == pytest.approx(plant.vehicle_heating, rel=1e-6)
    assert found.heat_exchange == pytest.approx(plant.heat_exchange, rel=1e-6)
    assert found.outlet_cooling[:2] == pytest.approx(plant.outlet_cooling[:2], rel=1e-6)  # low hardly gives here


@pytest.mark.slow
def test_a_model_with_covolume_ramp_and_energy_is_found_again():
    """Commands and vehicles of a day at h70-light, its gas replaced by the model's own."""
    station = load_station("h70-light")
    scenario = load_scenario("S1", station)
    day = own_day(REAL, day_of(simulate(scenario, create_from("logic"), replication=1)))
    base = REAL._replace(covolume=0.0, delivered_temperature=0.0, wall_conductance=0.0, driving_pressure=2000.0)
    found = identify([day], base, Form.REAL_GAS)
    errors = prediction_errors([day], found)
    assert max(errors.buffers) < 0.5
    assert max(errors.vehicle) < 0.5
    assert found.covolume == pytest.approx(REAL.covolume, rel=0.02)
    assert found.delivered_temperature == pytest.approx(REAL.delivered_temperature, rel=0.02)
    thesis = prediction_errors([day], identify([day], base, Form.THESIS))
    assert thesis.vehicle[2] > 10 * errors.vehicle[2]


def test_a_prediction_is_of_the_vehicle_that_was_there(thesis_day):
    begins = vehicle_begins(thesis_day)
    assert set(np.unique(thesis_day.vehicle[begins])) == set(np.unique(thesis_day.vehicle)) - {-1}
    model = thesis_model(load_scenario("S1").station.constants())
    found = replay(thesis_day, begins, np.array([60, 900]), model)
    after = thesis_day.vehicle[np.minimum(begins + 900, thesis_day.vehicle.size - 1)]
    assert np.isnan(found[after != thesis_day.vehicle[begins], 1, 0, VEHICLE]).all()
    assert np.isfinite(found[begins + 60 < thesis_day.vehicle.size, 0, 0, :VEHICLE]).all()


def test_days_in_which_nothing_happens_are_refused(thesis_day):
    idle = thesis_day._replace(command=np.zeros_like(thesis_day.command))
    model = thesis_model(load_scenario("S1").station.constants())
    with pytest.raises(ValueError, match="the compressor must run"):
        identify([idle], model, Form.THESIS)
    inlets = thesis_day._replace(command=thesis_day.command & 7)
    with pytest.raises(ValueError, match="vehicles must be filled"):
        identify([inlets], model, Form.THESIS)


def test_rows_must_be_a_second_apart():
    record = simulate(load_scenario("S1"), create_from("logic"))
    record.values[0, 5:] += 1.0
    with pytest.raises(ValueError, match="a second apart"):
        day_of(record)
