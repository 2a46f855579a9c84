"""One stage on symbols, run on numbers and intervals: the limits and the reach are those of the plant."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.minlp.evaluate import begin, open_to
from controllers.minlp.exact import memory_vector
from controllers.minlp.interval import Interval
from controllers.minlp.quotient import Quotient
from controllers.minlp.symbolic import Stage, Tanks, Valves, lesser
from station.geometry import ALL_VALVES
from station.valves import commands
from tests.controllers.states import REAL_STATIONS, STATIONS, problem, seeded

models = pytest.mark.parametrize("stations", [STATIONS, REAL_STATIONS], ids=["thesis", "control-model"])


def staged(given):
    """A problem's stage and its present state."""
    observation = given.observation
    vehicle = observation.vehicle >= 0
    stage = Stage(given.plant, given.objective, vehicle, observation.vehicle_volume, observation.period)
    state = begin(observation, given.plant, memory_vector(given.settings.horizon))
    return stage, Tanks(*(part[: 4 if vehicle else 3] for part in state))


def after(stage, tanks, now):
    """The tanks after a stage."""
    drawn = stage.drawn(tanks, now)
    masses, temperatures = stage.masses(tanks, now, drawn), stage.temperatures(tanks, now, drawn)
    return Tanks(masses, temperatures, stage.pressures(masses, temperatures))


def valves(command):
    return Valves(tuple(command >> b & 1 for b in range(3)), tuple(command >> 3 + b & 1 for b in range(3)))


@pytest.mark.slow
@models
def test_margins_admit_what_the_plant_admits(stations):
    source = seeded(np.random.default_rng(1))
    compressing = 0
    for number in range(300):
        given = problem(source, 1, compressors=1 + number % 3, stations=stations)
        stage, tanks = staged(given)
        before = valves(given.observation.previous).inlet
        for command in range(ALL_VALVES + 1):
            if command > 7 and not stage.vehicle:
                break
            admitted = all(margin >= 0 for margin in stage.margins(tanks, valves(command), before))
            assert admitted == np.isfinite(given.cost([command, 0])), command
            compressing += admitted and command & 7 != 0
    assert compressing > 300


@models
def test_cost_is_that_of_the_plant(stations):
    rng = np.random.default_rng(2)
    source, opened = seeded(rng), 0
    for _ in range(200):
        given = problem(source, 1, stations=stations)
        stage, tanks = staged(given)
        sequence = [int(command) for command in rng.choice(commands(1), 2)]
        if np.isinf(given.cost(sequence)):
            sequence = [0, 0]
        total = 0.0
        for command in sequence:
            now = valves(command)
            tanks = after(stage, tanks, now)
            total += stage.cost(now, tanks.pressure)
        np.testing.assert_allclose(total, given.cost(sequence), rtol=1e-12)
        opened += any(command > 7 for command in sequence)
    assert opened > 3


@models
def test_the_reach_holds_every_state(stations):
    rng, opened = np.random.default_rng(3), 0
    source = seeded(rng)
    for _ in range(100):
        given = problem(source, 3, stations=stations)
        stage, tanks = staged(given)
        memory = memory_vector(3)
        allowed = open_to(given.observation, given.plant, given.vector, memory)
        reach, before = stage.reach(tanks, allowed, 4), valves(given.observation.previous).inlet
        for index, intervals in enumerate(reach):
            command = int(rng.choice(commands(1))) & (allowed if index == 0 else ALL_VALVES)
            now = valves(command if stage.vehicle else command & 7)
            if min(stage.margins(tanks, now, before)) < 0:  # the reach is that of what the limits admit
                now = valves(0)
            before, opened = now.inlet, opened + (now != valves(0))
            tanks = after(stage, tanks, now)
            for values, spans in zip(tanks, intervals, strict=True):
                for value, span in zip(values, spans, strict=True):
                    assert span.low * (1 - 1e-12) - 1e-9 <= value <= span.high * (1 + 1e-12) + 1e-9
    assert opened > 50


def test_intervals():
    one = Interval(-1.0, 2.0)
    assert one + 1 == 1 + one == Interval(0.0, 3.0)
    assert 1 - one == Interval(-1.0, 2.0)
    assert one - one == Interval(-3.0, 3.0)
    assert one * one == Interval(-2.0, 4.0)
    assert -2 * one == Interval(-4.0, 2.0)
    assert one / Interval(2.0, 4.0) == Interval(-0.5, 1.0)
    assert 6.0 / Interval(2.0, 3.0) == Interval(2.0, 3.0)
    assert lesser(one, 1.0) == lesser(1.0, one) == Interval(-1.0, 1.0)
    with pytest.raises(ZeroDivisionError, match="holds 0"):
        1.0 / one


def test_quotients():
    two, third = Quotient(2.0), 1.0 / Quotient(3.0)
    assert (two.plain, third.plain) == (True, False)
    for found, value in (
        (two + third, 7 / 3), (1 - third, 2 / 3), (third - 1, -2 / 3), (two * third, 2 / 3), (third / two, 1 / 6),
        (third + third, 2 / 3), (-third, -1 / 3), (5 * two, 10),
    ):  # fmt: skip
        assert found.top / found.bottom == pytest.approx(value, rel=1e-15)
