"""Random states where the limits are near, and the three MINLPs on them, for the tests of the engines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from hypothesis import strategies as st

from controllers import create
from controllers.minlp.evaluate import evaluate
from controllers.minlp.exact import decide_exact, memory_vector, settings_vector
from controllers.minlp.objective import Objective
from controllers.minlp.settings import MinlpSettings
from station import Decision, Observation, load_station
from station.control_model import ControlModel
from station.controller import CompiledController
from station.kernels import ask
from station.valves import commands

NAMES = ("minlp1", "minlp2", "minlp3")
STATIONS = {name: load_station(name) for name in ("thesis-fit", "thesis-fit-a", "light-duty-700")}
REAL_STATIONS = {name: load_station(name) for name in ("h70-light", "h70-equal", "h35-bus", "h70-truck")}
"""Stations whose control model has covolume, ramp and energy."""


class Problem(NamedTuple):
    """One decision: a MINLP in a state."""

    observation: Observation
    plant: ControlModel
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


class Source(NamedTuple):
    """Where a problem's numbers come from: a random generator, or Hypothesis."""

    uniform: Callable[[float, float], float]
    choice: Callable[[list], Any]

    def around(self, center: float, width: float) -> float:
        """A number near `center`."""
        return center + self.uniform(-width, width)


def seeded(rng: np.random.Generator) -> Source:
    """Numbers of a random generator."""
    return Source(lambda low, high: float(rng.uniform(low, high)), lambda items: items[rng.integers(len(items))])


def drawn(draw) -> Source:
    """Numbers Hypothesis chooses, and shrinks when a test fails."""
    return Source(lambda low, high: draw(st.floats(low, high)), lambda items: draw(st.sampled_from(items)))


@st.composite
def problems(draw, horizon: int, compressors: int = 1, **settings) -> Problem:
    """Problems of Hypothesis."""
    return problem(drawn(draw), horizon, compressors, **settings)


def problem(source: Source, horizon: int, compressors: int = 1, stations=STATIONS, **settings) -> Problem:
    """A problem with each pressure and temperature either anywhere or at one of the limits."""
    uniform, choice = source.uniform, source.choice
    station = stations[choice(list(stations))]
    plant = station.control_constants()._replace(compressor_count=compressors)
    if choice([False, True]):  # the fitted stations never reach 60 g/s: this outlet does, at gaps of some 400 bar
        plant = plant._replace(outlet_coefficient=uniform(0.12, 0.18))
    controller = create(choice(list(NAMES)), horizon=horizon, **{"liveness": False, **settings})
    found = controller.settings_for(station)
    idle = choice([True, False, False, False, False])
    vehicle = uniform(50.0, 750.0)
    observation = Observation(
        0.0, choice([1.0, 1.0, 5.0]) if idle else 1.0,
        tuple(_buffer_pressure(source, plant, vehicle) for _ in range(3)),
        tuple(_temperature(source, plant.limits.buffer_temperature_max) for _ in range(3)), -1 if idle else 0,
        np.nan if idle else vehicle, np.nan if idle else _temperature(source, plant.limits.vehicle_temperature_max),
        uniform(0.08, 0.25), True, 0, choice(commands(compressors)),
    )  # fmt: skip
    return Problem(observation, plant, controller.objective(found), found)


def _buffer_pressure(source: Source, plant: ControlModel, vehicle: float) -> float:
    """Anywhere, or where the hold, the compressor, the gap or the flow limit begins to bind."""
    top = plant.compressor_pressure - 1e-3
    kind = source.choice(["anywhere", "anywhere", "hold", "top", "gap", "flow"])
    if kind == "anywhere":
        return source.uniform(100.0, top)
    center = {
        "hold": plant.limits.hold_pressure,
        "top": top,
        "gap": vehicle + plant.limits.outlet_gap_min,
        "flow": vehicle + plant.limits.dispenser_flow_max / plant.outlet_coefficient,
    }[kind]
    return min(source.around(center, 3.0), top)


def _temperature(source: Source, limit: float) -> float:
    if source.choice([True, False, False, False]):
        return source.uniform(limit - 1.0, limit)
    return source.uniform(-10.0, limit)
