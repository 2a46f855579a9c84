"""The exact engine where controllers plan with covolume, ramp and energy: against enumeration and the model itself."""

from __future__ import annotations

import numpy as np
import pytest

from station import Status
from station.control_model import advance, gas_mass
from station.geometry import VEHICLE
from station.plants.interface import M, P, T
from station.valves import commands
from tests.controllers.replay import enumerate_best
from tests.controllers.states import REAL_STATIONS, problem, seeded


def _problems(seed, count, horizon, compressors=1, **options):
    source = seeded(np.random.default_rng(seed))
    return [problem(source, horizon, compressors, stations=REAL_STATIONS, **options) for _ in range(count)]


def _played(given, sequence):
    """What a sequence costs by the control model's own second."""
    seen, plant, weights = given.observation, given.plant, given.objective
    connected = seen.vehicle >= 0
    volume = seen.vehicle_volume if connected else 0.0
    state = np.zeros(12)
    for tank in range(4 if connected else 3):
        pressure, warmth, size = (
            (seen.vehicle_pressure, seen.vehicle_temperature, volume)
            if tank == VEHICLE
            else (seen.pressure[tank], seen.temperature[tank], plant.buffer_volume[tank])
        )
        state[P + tank], state[T + tank] = pressure, warmth
        state[M + tank] = gas_mass(pressure, warmth, size, plant)
    total = 0.0
    for command in sequence:
        advance(state, volume, int(command), seen.period, plant)
        total += weights.compressor * (command & 7).bit_count() + weights.precooler * (command >> 3).bit_count()
        total += weights.buffers * sum((state[P + b] - weights.target) ** 2 for b in range(3))
        total += weights.vehicle * (state[P + VEHICLE] - weights.target) ** 2 if connected else 0.0
    return total


@pytest.mark.parametrize("compressors", [1, 3])
def test_a_sequence_costs_what_the_model_says(compressors):
    rng = np.random.default_rng(compressors)
    admissible = 0
    for given in _problems(compressors, 200, 2, compressors):
        for sequence in rng.choice(commands(compressors), (5, 3)):
            cost = given.cost(sequence)
            if np.isfinite(cost):
                admissible += 1
                assert cost == pytest.approx(_played(given, sequence), rel=1e-12)
    assert admissible > 50


@pytest.mark.parametrize(
    ("horizon", "compressors", "count"),
    [
        (1, 1, 60), (1, 2, 20), (1, 3, 20), (2, 1, 5),
        pytest.param(2, 1, 60, marks=pytest.mark.slow), pytest.param(3, 1, 6, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_exact_is_the_best_of_all_sequences(horizon, compressors, count):
    dispensing = 0
    for given in _problems(10 * horizon + compressors, count, horizon, compressors, node_limit=10**9):
        best, sequence = enumerate_best(given.cost, commands(compressors), horizon + 1)
        decision = given.exact()
        assert decision.status == Status.OPTIMAL
        assert decision.cost == pytest.approx(best, rel=1e-9)
        dispensing += any(command >> 3 for command in sequence)
    assert dispensing


@pytest.mark.parametrize("horizon", [2, 4, pytest.param(6, marks=pytest.mark.slow)])
def test_a_search_cut_short_bounds_the_optimum(horizon):
    cut = 0
    for given in _problems(horizon, 25, horizon, node_limit=10**6):
        best = given.exact()
        assert best.status == Status.OPTIMAL
        short = given._replace(settings=given.settings.model_copy(update={"node_limit": 1})).exact()
        assert short.bound <= best.cost * (1 + 1e-12)
        assert short.cost >= best.cost * (1 - 1e-12)
        cut += short.status == Status.FEASIBLE
    assert cut
