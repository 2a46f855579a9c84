"""The search of the switched controller, against brute force and its bound."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers import create
from controllers.switched import search
from controllers.switched.controller import bound_of
from controllers.switched.model import Tank, Vehicle, serve
from controllers.switched.parts import (
    COMMAND,
    CONNECTED,
    COST,
    MASS,
    MISSING,
    OWN_TANK,
    OWN_VEHICLE,
    SIZE,
    TEMPERATURE,
    VEHICLE_MASS,
    Block,
    Task,
    admitted,
    compute_parts,
    keeps_start,
    may_start,
    new_parts,
)
from controllers.switched.search import plan
from controllers.switched.settings import SwitchedSettings
from controllers.switched.value import restore
from controllers.switched.vector import (
    USUAL_PACE,
    commands_of,
    demand_of,
    fills_of,
    prices_of,
    settings_vector,
    terminal_costs_of,
)
from station import load_scenario, load_station, simulate
from station.limits import start_limit
from station.plants.thesis import gas_mass

PRESETS = ["thesis-fit", "thesis-fit-a", "thesis-fit-b", "thesis-fit-cascade", "light-duty-700"]


STEP = 6.0


def task(preset: str, blocks: int, waiting: int, **options) -> Task:
    """A planning problem on a preset with few blocks."""
    station = load_station(preset)
    vector = settings_vector(SwitchedSettings(**options), station)
    usual = station.vehicle
    demand = demand_of(usual.volume_m3, usual.finish_pressure_bar, 1.0, vector)
    model = station.control_constants()
    return Task(
        model, demand, prices_of(vector, USUAL_PACE), waiting, np.array([70.0, 1e9]),
        np.full(blocks, 30.0), STEP, terminal_costs_of(demand, model, vector), fills_of(vector, USUAL_PACE),
        gas_mass(demand.next_finish, demand.next_temperature, demand.next_volume), commands_of(vector),
    )  # fmt: skip


def state(problem: Task, levels: list[float], temperatures: list[float], vehicle: float, previous: int) -> np.ndarray:
    """A state with buffers at these shares of the compressor's pressure, and a vehicle at this pressure [bar]."""
    start = np.zeros(SIZE)
    for buffer in range(3):
        pressure = levels[buffer] * problem.model.compressor_pressure
        start[MASS + buffer] = gas_mass(pressure, temperatures[buffer], problem.model.buffer_volume[buffer])
        start[TEMPERATURE + buffer] = temperatures[buffer]
    start[CONNECTED] = 1.0
    start[VEHICLE_MASS] = gas_mass(vehicle, 30.0, problem.demand.volume)
    start[VEHICLE_MASS + 1] = 30.0
    start[COMMAND] = previous
    return start


def begun(start: np.ndarray, problem: Task) -> np.ndarray:
    """The state a search begins with: seconds to restore its buffers are told."""
    now = start.copy()
    for buffer in range(3):
        now[MISSING + buffer] = restore(now[MASS + buffer], problem.terminal[buffer], buffer, problem.model)
    return now


def after_block(now: np.ndarray, command: int, level: int, problem: Task) -> tuple[np.ndarray, float] | None:
    """The state after a block, from its parts alone, and its cost with the worth of its end; None if not admitted."""
    time = float(np.sum(problem.blocks[:level]))
    first, last = (
        search.arrived_by(moment, problem.waiting, problem.coming) for moment in (time, time + problem.blocks[level])
    )
    parts = new_parts(1)
    now[OWN_TANK : OWN_VEHICLE + 1] = 0.0
    compute_parts(now[None], Block(time, problem.blocks[level], first, last, 0), problem, parts)
    of, row = parts.of[0], parts.row
    if command & ~admitted(of, row) or not keeps_start(command, *may_start(now, of, row, problem.model)):
        return None
    after = np.empty(SIZE)
    search._put_together(now, command, of, row, after)
    return after, now[COST] + search._score(command, of, row)


def best_by_first(start: np.ndarray, problem: Task) -> dict[int, float]:
    """Least cost over every sequence of commands, for each first one, without beam, cells or pool."""
    found: dict[int, float] = {}
    for sequence in product(problem.commands, repeat=len(problem.blocks)):
        now, score = begun(start, problem), np.inf
        for level, command in enumerate(sequence):
            then = after_block(now, command, level, problem)
            if then is None:
                score = np.inf
                break
            now, score = then
        found[sequence[0]] = min(found.get(sequence[0], np.inf), score)
    return {first: cost for first, cost in found.items() if cost < np.inf}


@settings(max_examples=10, deadline=None)
@given(
    preset=st.sampled_from(PRESETS),
    levels=st.lists(st.floats(0.3, 0.97), min_size=3, max_size=3),
    temperatures=st.lists(st.floats(0.0, 50.0), min_size=3, max_size=3),
    vehicle=st.floats(100.0, 500.0),
    waiting=st.integers(0, 3),
    previous=st.sampled_from([0, 1, 2, 4, 8, 17, 34]),
    patience=st.floats(0.0, 1.0),
)
def test_a_wide_beam_finds_what_brute_force_finds_and_the_bound_holds(
    preset, levels, temperatures, vehicle, waiting, previous, patience
):
    problem = task(preset, 2, waiting, patience=patience)
    start = state(problem, levels, temperatures, vehicle, previous)
    least = min(best_by_first(start, problem).values())
    commands = np.empty(len(problem.blocks), np.int64)
    cost, looked_at = plan(start, 0, 0, problem, 2000, commands)
    assert looked_at > 1
    assert cost == pytest.approx(least, rel=1e-12)
    now, score = begun(start, problem), np.inf
    for level, command in enumerate(commands):
        now, score = after_block(now, command, level, problem)
    assert score == pytest.approx(cost, rel=1e-12), "the commands are those of that cost"
    assert bound_of(start, problem) <= least


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    preset=st.sampled_from(PRESETS),
    levels=st.lists(st.floats(0.3, 1.0), min_size=3, max_size=3),
    temperatures=st.lists(st.floats(0.0, 60.0), min_size=3, max_size=3),
    vehicle=st.floats(10.0, 800.0),
    previous=st.sampled_from([0, 1, 2, 4, 8, 12, 17, 34, 36]),
    mask=st.integers(0, 63),
    allowed=st.integers(0, 63),
)
def test_there_is_a_plan_whatever_valves_are_bound(preset, levels, temperatures, vehicle, previous, mask, allowed):
    """An inlet bound open may be one that would keep every fill from beginning: it is let go then."""
    problem = task(preset, 3, 1)
    start = state(problem, levels, temperatures, vehicle, previous)
    commands = np.full(len(problem.blocks), -1)
    cost, _ = plan(start, mask, allowed, problem, 4, commands)
    assert np.isfinite(cost)
    assert set(commands.tolist()) <= set(problem.commands.tolist())


def test_a_bound_inlet_that_fills_low_too_full_is_let_go():
    problem = task("thesis-fit-a", 3, 26)
    limit = start_limit(problem.model) / problem.model.compressor_pressure
    start = state(problem, [0.5, 0.5, 0.999 * limit], [25.0, 25.0, 25.0], 600.0, 4)
    commands = np.full(len(problem.blocks), -1)
    plan(start, 4, 63, problem, 8, commands)
    assert set(commands.tolist()) <= set(problem.commands.tolist())
    assert commands[0] & 4 == 0


def test_the_bound_holds_in_every_decision_and_says_something():
    for preset, informative in (("thesis-fit", True), ("thesis-fit-b", False)):
        record = simulate(load_scenario("S1").on(load_station(preset)), create("switched"))
        cost, bound = record["decision_cost"][:-1], record["decision_bound"][:-1]
        assert (bound <= cost).all()
        if informative:
            assert np.median(bound / cost) > 0.1


def test_it_needs_its_look_ahead():
    """With a plan of one block the same prices and the same worth of the end do far worse."""
    prices = SwitchedSettings().prices(load_station("thesis-fit"))

    def cost(controller) -> float:
        found = simulate(load_scenario("S1"), controller).metrics()
        return found.t_comp_restored + prices.dispensing * found.t_dis + prices.waiting * found.t_total

    assert cost(create("switched", blocks=1)) > 1.05 * cost(create("switched"))


@pytest.mark.parametrize("above", [0.5, 2.0, 10.0, 60.0])
def test_a_long_step_closes_the_outlet_where_short_ones_do(above):
    problem = task("light-duty-700", 1, 0)
    model, demand = problem.model, problem.demand
    buffer, vehicle = 0, 560.0
    pressure = vehicle + model.limits.outlet_gap_min + above
    tank = Tank(gas_mass(pressure, 25.0, model.buffer_volume[buffer]), 25.0)
    connected = Vehicle(gas_mass(vehicle, 40.0, demand.volume), 40.0, True, 0)
    given = [
        tank.mass
        - serve(buffer, tank, connected, 0.0, 30.0, step, 0, np.empty(0), demand, problem.prices, model)[0].mass
        for step in (1.0, 30.0)
    ]
    flow = model.outlet_coefficient * (model.limits.outlet_gap_min + above)
    assert given[0] > 0.0
    # A step may end within a second, and takes no account of the vehicle's warming, which closes the outlet sooner.
    assert given[0] - flow <= given[1] <= 1.33 * given[0] + flow
    assert above > 10 or given[1] < 0.5 * 30 * flow  # what an outlet gives that stays open
