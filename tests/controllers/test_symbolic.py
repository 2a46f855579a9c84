"""One stage on symbols, run on numbers and intervals: the limits and the reach are those of the plant."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.minlp.evaluate import begin, open_to
from controllers.minlp.exact import memory_vector
from controllers.minlp.interval import Interval
from controllers.minlp.symbolic import Stage, Tanks, Valves
from station.geometry import ALL_VALVES
from station.valves import commands
from tests.controllers.states import problem, seeded


def staged(given):
    """A problem's stage and its present state."""
    observation = given.observation
    vehicle = observation.vehicle >= 0
    stage = Stage(given.plant, given.objective, vehicle, observation.vehicle_volume, observation.period)
    state = begin(observation, given.plant, memory_vector(given.settings.horizon))
    return stage, Tanks(*(part[: 4 if vehicle else 3] for part in state))


def valves(command):
    return Valves(tuple(command >> b & 1 for b in range(3)), tuple(command >> 3 + b & 1 for b in range(3)))


@pytest.mark.slow
def test_margins_admit_what_the_plant_admits():
    source = seeded(np.random.default_rng(1))
    compressing = 0
    for number in range(300):
        given = problem(source, 1, compressors=1 + number % 3)
        stage, tanks = staged(given)
        before = valves(given.observation.previous).inlet
        for command in range(ALL_VALVES + 1):
            if command > 7 and not stage.vehicle:
                break
            admitted = all(margin >= 0 for margin in stage.margins(tanks, valves(command), before))
            assert admitted == np.isfinite(given.cost([command, 0])), command
            compressing += admitted and command & 7 != 0
    assert compressing > 300


def test_cost_is_that_of_the_plant():
    source = seeded(np.random.default_rng(2))
    for _ in range(100):
        given = problem(source, 1)
        stage, tanks = staged(given)
        total = 0.0
        for _ in range(2):
            masses, temperatures = stage.masses(tanks, valves(0)), stage.temperatures(tanks, valves(0))
            tanks = Tanks(masses, temperatures, stage.pressures(masses, temperatures))
            total += stage.cost(valves(0), tanks.pressure)
        np.testing.assert_allclose(total, given.cost([0, 0]), rtol=1e-12)


def test_the_reach_holds_every_state():
    rng = np.random.default_rng(3)
    source = seeded(rng)
    for _ in range(100):
        given = problem(source, 3)
        stage, tanks = staged(given)
        memory = memory_vector(3)
        allowed = open_to(given.observation, given.plant, given.vector, memory)
        reach = stage.reach(tanks, allowed, 4)
        for index, intervals in enumerate(reach):
            command = int(rng.choice(commands(1))) & (allowed if index == 0 else ALL_VALVES)
            now = valves(command if stage.vehicle else command & 7)
            masses, temperatures = stage.masses(tanks, now), stage.temperatures(tanks, now)
            tanks = Tanks(masses, temperatures, stage.pressures(masses, temperatures))
            for values, spans in zip(tanks, intervals, strict=True):
                for value, span in zip(values, spans, strict=True):
                    assert span.low * (1 - 1e-12) - 1e-9 <= value <= span.high * (1 + 1e-12) + 1e-9


def test_intervals():
    one = Interval(-1.0, 2.0)
    assert one + 1 == 1 + one == Interval(0.0, 3.0)
    assert 1 - one == Interval(-1.0, 2.0)
    assert one - one == Interval(-3.0, 3.0)
    assert one * one == Interval(-2.0, 4.0)
    assert -2 * one == Interval(-4.0, 2.0)
