"""The equations (7.1)-(7.10): their numbers, their symbols, and what they conserve."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from hypothesis import strategies as st

from station import Decision, load_scenario, load_station, parse_scenario, simulate
from station.geometry import BUFFERS
from station.plants import thesis as eq
from tests.samples import THESIS_PRESETS, samples

PLANT = load_station("thesis-fit").constants()


def test_ideal_gas_of_a_full_vehicle():
    # 122.4 l at 700 bar and 15 C; m = p V M / (R T) in SI units.
    mass = 700e5 * 0.1224 * 0.002016 / (8.3145 * 288.15)
    assert eq.gas_mass(700.0, 15.0, 0.1224) == pytest.approx(1000 * mass, rel=1e-12)
    assert eq.gas_pressure(1000 * mass, 15.0, 0.1224) == pytest.approx(700.0, rel=1e-12)


def test_compressor_of_the_engineering_preset_gives_36_kg_per_hour():
    plant = load_station("light-duty-700").constants()
    assert eq.inlet_flow(650.0, plant) * 3.6 == pytest.approx(36.0, rel=2e-3)


def test_flows_and_temperatures_by_hand():
    assert eq.outlet_flow(800.0, 300.0, PLANT) == pytest.approx(0.049091428522917986 * 500)
    warmed = eq.buffer_temperature(0, 40.0, 1, 0, PLANT, 1.0)
    assert warmed == pytest.approx(40 + 0.2637791921780225 + 0.001942151830677135 * (25 - 40))
    assert eq.vehicle_temperature(25.0, 1, PLANT, 1.0) == pytest.approx(25 + 0.18262987297059768)


@pytest.mark.parametrize("name", ["gas_pressure", "gas_mass"])
def test_traced_formulas_equal_called_ones(name):
    symbols = [casadi.SX.sym(letter) for letter in "abc"]
    traced = casadi.Function("f", symbols, [getattr(eq, name)(*symbols)])
    assert float(traced(500.0, 30.0, 0.2)) == pytest.approx(getattr(eq, name)(500.0, 30.0, 0.2), rel=1e-15)


class Random:
    """Opens valves at random, admissible or not."""

    name = "random"
    obeys_hold = True

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def start(self, station):
        self.random = np.random.default_rng(self.seed)

    def decide(self, observation):
        return Decision(int(self.random.integers(64)))


@samples(7, 25, seed=st.integers(0, 2**32), preset=st.sampled_from(THESIS_PRESETS), count=st.integers(1, 3))
def test_mass_is_conserved_on_random_commands(seed, preset, count):
    document = load_scenario("S1").on(load_station(preset)).model_dump()
    document["station"]["compressor"]["count"] = count
    record = simulate(parse_scenario({**document, "time_limit_s": 1500.0}), Random(seed))
    stored = sum(record[f"mass_{name}"] for name in BUFFERS)
    compressed = np.concatenate(([0.0], np.cumsum(record["flow_compressor"][:-1])))
    dispensed = np.concatenate(([0.0], np.cumsum(record["flow_dispenser"][:-1])))
    np.testing.assert_allclose(stored, stored[0] + compressed - dispensed, rtol=1e-11)
    assert record.vehicles["delivered"].sum() == pytest.approx(dispensed[-1], rel=1e-11)


@samples(7, 25, seed=st.integers(0, 2**32), preset=st.sampled_from(THESIS_PRESETS))
def test_no_random_command_leads_past_a_limit(seed, preset):
    station = load_station(preset)
    record = simulate(
        parse_scenario({**load_scenario("S1").on(station).model_dump(), "time_limit_s": 1500.0}), Random(seed)
    )
    for name in BUFFERS:
        assert record[f"temperature_{name}"].max() <= station.thermal.buffer_temperature_max_c
        opened = record[f"inlet_{name}"] == 1
        assert record[f"pressure_{name}"][opened].max(initial=0) < station.compressor.pressure_bar
        gaps = (record[f"pressure_{name}"] - record["pressure_vehicle"])[record[f"outlet_{name}"] == 1]
        assert gaps.min(initial=1e9) >= station.dispenser.outlet_gap_min_bar
    assert np.nanmax(record["temperature_vehicle"]) <= station.vehicle.temperature_max_c
    assert record["flow_dispenser"].max() <= station.dispenser.flow_max_g_per_s
    assert sum(record[f"outlet_{name}"].astype(int) for name in BUFFERS).max() <= 1
