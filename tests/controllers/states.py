"""Random states where the limits are near, and the three MINLPs on them, for the tests of the engines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controllers import create
from controllers.minlp.controller import MinlpSettings
from controllers.minlp.evaluate import evaluate
from controllers.minlp.exact import decide_exact, memory_vector, settings_vector
from controllers.minlp.objective import Objective
from station import Decision, Observation, load_station
from station.controller import CompiledController
from station.limits import commands
from station.plant import PlantConstants
from station.simulation import ask

NAMES = ("minlp1", "minlp2", "minlp3")
STATIONS = {name: load_station(name) for name in ("thesis-fit", "thesis-fit-a", "light-duty-700")}


class Problem(NamedTuple):
    """One decision: a MINLP in a state."""

    observation: Observation
    plant: PlantConstants
    objective: Objective
    settings: MinlpSettings

    @property
    def vector(self):
        """The settings as the compiled code reads them."""
        s = self.settings
        return settings_vector(self.objective, s.horizon, s.node_limit, s.liveness, self.plant.compressor_count)

    def exact(self) -> Decision:
        """The exact engine's decision."""
        memory = memory_vector(self.settings.horizon)
        return ask(CompiledController(decide_exact, self.plant, self.vector, memory, True), self.observation)

    def cost(self, sequence) -> float:
        """What a sequence costs on the plant."""
        memory = memory_vector(self.settings.horizon)
        return evaluate(self.observation, self.plant, self.vector, memory, np.array(sequence, np.int64))

    def standing(self) -> float:
        """Cost of a horizon spent at the present pressures: what the valves change is the cost less this."""
        o, weights = self.observation, self.objective
        cost = weights.buffers * sum((p - weights.target) ** 2 for p in o.pressure)
        if o.vehicle >= 0:
            cost += weights.vehicle * (o.vehicle_pressure - weights.target) ** 2
        return (self.settings.horizon + 1) * cost


def random_problem(rng: np.random.Generator, horizon: int, compressors: int = 1, **settings) -> Problem:
    """A problem with each pressure and temperature either anywhere or at one of the limits."""
    station = STATIONS[str(rng.choice(list(STATIONS)))]
    plant = station.constants()._replace(compressor_count=compressors)
    if rng.random() < 0.5:  # the fitted stations never reach 60 g/s: this outlet does, at gaps of some 400 bar
        plant = plant._replace(outlet_coefficient=float(rng.uniform(0.12, 0.18)))
    controller = create(str(rng.choice(NAMES)), horizon=horizon, **{"liveness": False, **settings})
    found = controller.settings_for(station)
    vehicle = -1 if rng.random() < 0.2 else 0
    vehicle_pressure = rng.uniform(50.0, 750.0)
    pressure = tuple(_buffer_pressure(rng, plant, vehicle_pressure) for _ in range(3))
    temperature = tuple(_temperature(rng, plant.buffer_temperature_max) for _ in range(3))
    observation = Observation(
        0.0, float(rng.choice([1.0, 1.0, 5.0])) if vehicle < 0 else 1.0, pressure, temperature, vehicle,
        float(vehicle_pressure) if vehicle >= 0 else np.nan,
        _temperature(rng, plant.vehicle_temperature_max) if vehicle >= 0 else np.nan,
        float(rng.uniform(0.08, 0.25)), True, 0, int(rng.choice(commands(compressors))),
    )  # fmt: skip
    return Problem(observation, plant, controller.objective(found), found)


def _buffer_pressure(rng: np.random.Generator, plant: PlantConstants, vehicle: float) -> float:
    top = plant.compressor_pressure - 1e-3
    near = float(rng.normal(0.0, 1.5))
    kind = rng.integers(6)
    if kind == 0:
        pressure = plant.hold_pressure + near
    elif kind == 1:
        pressure = top - 0.3 * abs(near)
    elif kind == 2:
        pressure = vehicle + plant.outlet_gap_min + near
    elif kind == 3:
        pressure = vehicle + plant.dispenser_flow_max / plant.outlet_coefficient + near
    else:
        pressure = rng.uniform(100.0, top)
    return float(min(pressure, top))


def _temperature(rng: np.random.Generator, limit: float) -> float:
    if rng.random() < 0.25:
        return float(limit - abs(rng.normal(0.0, 0.4)))
    return float(rng.uniform(-10.0, limit))
