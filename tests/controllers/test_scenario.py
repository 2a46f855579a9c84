"""The scenario controller: its futures, its trees against brute force, its promise, and that it sees no future."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.stats import binomtest, kstest, lomax

from benchmarks.fleet_days import day as drawn_day
from controllers import create
from controllers.scenario.controller import STARTS
from controllers.scenario.futures import BELIEF_SIZE, GAPS, belief_of, branch_of, draw, quantile, uniform, watch
from controllers.scenario.play import plan_terminal_cost, play_block
from controllers.scenario.settings import ScenarioSettings
from controllers.scenario.tree import EARLY, LATE, TYPICAL, follow, grow, trunks
from controllers.switched.parts import CONNECTED, COST
from station import InputError, Observation, load_scenario, load_station, parse_scenario, simulate
from station.controller import NONE_ANNOUNCED
from tests.controllers.switched.test_search import best_by_first, state, task

PRESETS = ("thesis-fit", "thesis-fit-a", "light-duty-700")


def seen_at(time: float, vehicle: int = 0, queue: int = 0, pressure: float = 130.0, announced=NONE_ANNOUNCED):
    return Observation(
        time, 1.0, (850.0, 780.0, 740.0), (25.0,) * 3, vehicle, pressure, 25.0, 0.141, True, queue, 0, 700.0, announced
    )


def belief_after(arrivals: list[float], now: float, announced=NONE_ANNOUNCED):
    """The belief at `now`, after vehicles that came at these times and were all connected at once."""
    memory = np.zeros(BELIEF_SIZE)
    for number, time in enumerate(arrivals):
        watch(seen_at(time, number, pressure=100.0 + number), memory)
    last = seen_at(now, len(arrivals) - 1, announced=announced)
    watch(last, memory)
    return belief_of(last, 150.0, 137.0, 40.0, memory), last


def test_the_belief_counts_gaps_and_the_time_since():
    belief, _ = belief_after([100.0, 300.0, 350.0], 400.0)
    assert (belief.gaps, belief.seconds) == (3.0, 150.0 + 250.0 + 50.0)
    assert belief.seen.tolist() == [100.0, 101.0, 102.0]
    many, _ = belief_after([10.0 * number for number in range(100)], 1000.0)
    assert (many.gaps, many.seconds) == (GAPS + 1.0, 150.0 + 10.0 * GAPS + 10.0)
    memory = np.zeros(BELIEF_SIZE)
    watch(seen_at(0.0, 0, 2), memory)  # three at once
    assert belief_of(seen_at(0.0), 150.0, 137.0, 40.0, memory)[:2] == (3.0, 150.0)
    nobody = belief_of(seen_at(60.0, -1), 150.0, 137.0, 40.0, np.zeros(BELIEF_SIZE))
    assert nobody[:2] == (1.0, 210.0)


def test_the_generator_is_uniform_and_repeats():
    values = np.array([uniform(7, place) for place in range(20_000)])
    assert kstest(values, "uniform").pvalue > 0.01
    assert values[:5].tolist() == [uniform(7, place) for place in range(5)]
    assert uniform(8, 0) != uniform(7, 0)
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.02


def test_gaps_drawn_have_the_predictive_law_and_starts_are_those_seen_or_usual():
    belief, now = belief_after([100.0, 300.0, 350.0], 400.0)
    futures, place = draw(now, belief, 5000, 2, 3, 1, 0)
    assert kstest(futures.due[:, 0], lomax(belief.gaps, scale=belief.seconds).cdf).pvalue > 0.01
    assert kstest(futures.due[:, 1] - futures.due[:, 0], lomax(belief.gaps, scale=belief.seconds).cdf).pvalue > 0.01
    assert (futures.due[:, 1] > futures.due[:, 0]).all()
    for level in (0.1, 0.5, 0.9):
        assert lomax(belief.gaps, scale=belief.seconds).cdf(quantile(level, belief)) == pytest.approx(level)
    old = np.isin(futures.pressure, belief.seen)
    assert old.mean() == pytest.approx(0.75, abs=0.02)
    assert np.abs(futures.pressure[~old] - 137.0).max() <= 40.0
    again, _ = draw(now, belief, 5000, 2, 3, 1, 0)
    assert np.array_equal(again.due, futures.due)
    later, _ = draw(now, belief, 5000, 2, 3, 1, place)
    assert not np.isin(later.due, futures.due).any()


def test_a_known_rate_gives_exponential_gaps():
    belief, now = belief_after([100.0 * number for number in range(40)], 3900.0)
    sharp = belief._replace(gaps=4000.0, seconds=4000.0 * 100.0)
    futures, _ = draw(now, sharp, 500, 1, 1, 3, 0)
    assert kstest(futures.due[:, 0], "expon", (0, 100.0)).pvalue > 0.01


def test_announced_arrivals_are_certain():
    belief, now = belief_after([0.0, 300.0], 400.0, (450.0, 600.0, np.inf, np.inf))
    futures, _ = draw(now, belief, 50, 4, 2, 1, 0)
    assert (futures.due[:, :2] == [50.0, 200.0]).all()
    assert (futures.due[:, 2] > 200.0).all()
    due = np.empty(4)
    branch_of(now, belief, 0.5, due)
    assert due[:2].tolist() == [50.0, 200.0]
    assert due[2] == pytest.approx(200.0 + quantile(0.5, belief))


@pytest.mark.slow
def test_commands_played_cost_what_the_search_says():
    for preset, waiting in product(PRESETS, (0, 2)):
        problem = task(preset, 8, waiting)
        start = state(problem, [0.85, 0.8, 0.7], [20.0, 25.0, 30.0], 150.0, 0)
        paths, cost = np.zeros((4, 8), np.int64), np.zeros(4)
        number = trunks(start, 0, 0, problem, 60, (3, 4), paths, cost)
        assert number == 4
        assert len(set(paths[:, 0])) == 4
        assert cost.tolist() == sorted(cost)
        usual = np.full(1, problem.demand.next_pressure)
        for path, told in zip(paths, cost, strict=True):
            now, time = start.copy(), 0.0
            for block, command in enumerate(path):
                play_block(now, command, time, problem.blocks[block], problem, problem.coming, usual)
                time += problem.blocks[block]
            assert now[COST] + plan_terminal_cost(now, problem.coming, problem) == pytest.approx(told, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("preset", [pytest.param(PRESETS[0], marks=pytest.mark.slow), *PRESETS[1:]])
def test_the_best_of_each_first_command_is_that_of_brute_force(preset):
    problem = task(preset, 2, 1)
    start = state(problem, [0.8, 0.75, 0.6], [20.0, 25.0, 30.0], 300.0, 1)
    least = best_by_first(start, problem)
    paths, cost = np.zeros((20, 2), np.int64), np.zeros(20)
    number = trunks(start, 0, 0, problem, 2000, (2, 20), paths, cost)
    assert dict(zip(paths[:number, 0].tolist(), cost[:number].tolist(), strict=True)) == pytest.approx(least)
    narrow, told = np.zeros((3, 2), np.int64), np.zeros(3)
    assert trunks(start, 0, 0, problem, 13, (1, 3), narrow, told) == 3
    assert (told >= np.array([least[first] for first in narrow[:, 0]]) - 1e-9).all()


def grown(problem, start, due):
    branches = np.array([[time, time + 500.0, 1e9] for time in due])
    return grow(start, 0, 0, problem, branches, 0, (40, 8), 3), branches


def test_a_tree_shares_its_trunk_and_is_followed_by_what_has_been_seen():
    problem = task("thesis-fit", 10, 0)
    start = state(problem, [0.8, 0.75, 0.7], [20.0, 25.0, 30.0], 400.0, 0)
    tree, branches = grown(problem, start, (150.0, 60.0, 240.0))
    typical, early = tree.seen[TYPICAL], tree.seen[EARLY]
    assert (typical, early, tree.seen[LATE]) == (5, 2, 8)
    usual = np.full(STARTS, problem.demand.next_pressure)
    for candidate, commands in enumerate(tree.commands):
        assert (commands[EARLY, :early] == commands[TYPICAL, :early]).all()
        assert (commands[LATE, :typical] == commands[TYPICAL, :typical]).all()
        costs = []
        for coming in branches:  # a future that is a branch costs what the branch was told to cost
            now = start.copy()
            assert not follow(tree, candidate, now, problem, coming, 0, usual, 10)
            costs.append(now[COST] + plan_terminal_cost(now, coming, problem))
        assert np.mean(costs) == pytest.approx(tree.cost[candidate], rel=1e-9)


def test_a_branch_that_sees_nobody_is_the_trunk():
    problem = task("thesis-fit", 4, 0)
    start = state(problem, [0.8, 0.75, 0.7], [20.0, 25.0, 30.0], 400.0, 0)
    tree, _ = grown(problem, start, (1e6, 5e5, 2e6))
    assert (tree.seen == 4).all()
    assert (tree.commands == tree.commands[:, :1]).all()


def test_a_shortage_is_a_connected_vehicle_no_buffer_can_serve():
    problem = task("thesis-fit", 1, 0)
    usual = np.full(STARTS, problem.demand.next_pressure)
    for level, short in ((0.80, False), (0.68, True)):  # 766 and 651 bar beside a vehicle of 600
        start = state(problem, [level] * 3, [25.0] * 3, 600.0, 0)
        assert play_block(start.copy(), 0, 0.0, 6.0, problem, problem.coming, usual) is short
        start[CONNECTED] = 0.0
        assert not play_block(start, 0, 0.0, 6.0, problem, problem.coming, usual)


def test_the_chance_stated_holds_for_events_of_known_chances():
    """The rule on its own: J events of chances p_j, the first without one in S draws, one more draw."""
    random = np.random.default_rng(3)
    settings = ScenarioSettings()
    for chances in (np.full(settings.candidates, 1 / 25), random.random(settings.candidates) / 5):
        trials = 20_000
        clean = ~(random.random((trials, settings.candidates, settings.futures)) < chances[:, None]).any(axis=2)
        fresh = random.random((trials, settings.candidates)) < chances
        bad = clean.any(axis=1) & fresh[np.arange(trials), clean.argmax(axis=1)]
        exact = chances * (1 - chances) ** settings.futures
        before = np.concatenate(([1.0], np.cumprod(1 - (1 - chances) ** settings.futures)[:-1]))
        assert binomtest(int(bad.sum()), trials, float((exact * before).sum())).pvalue > 1e-3
        assert bad.mean() <= settings.chance.value


def day(vehicles, **given):
    station = load_station("thesis-fit").model_dump()
    arrivals = {"kind": "trace", "vehicles": vehicles}
    return parse_scenario({"name": "day", "station": station, "arrivals": arrivals, "time_limit_s": 9000.0, **given})


def test_it_serves_everybody_within_limits_and_repeats_by_seed():
    scenario = load_scenario("S1").on(load_station("thesis-fit"))
    one, same = (simulate(scenario, create("scenario", seed=3)) for _ in range(2))
    found = one.metrics()
    assert found.vehicles_not_finished == 0
    assert found.refused_valves == 0
    assert one.to_bytes() == same.to_bytes()
    assert np.median(one["decision_bound"][:-1] / one["decision_cost"][:-1]) < 1


def test_it_sees_no_future():
    early = [{"time_s": time, "start_pressure_bar": 130.0} for time in (0, 250, 500)]
    other = [*early, {"time_s": 601, "start_pressure_bar": 60.0}, {"time_s": 640, "start_pressure_bar": 200.0}]
    one, two = (simulate(day(vehicles), create("scenario")) for vehicles in (early, other))
    for column in one.columns:
        assert np.array_equal(one[column][:600], two[column][:600], equal_nan=True), column


@pytest.mark.slow
def test_a_plan_that_is_followed_puts_no_fill_off():
    """Begun anew each block it put fills off time and again, and queues waited a tenth longer than with logic."""
    waits = {}
    for name in ("logic", "scenario"):
        days = [simulate(drawn_day(place, "h70-equal", True, 252), create(name), replication=place + 1, seed=252)
                for place in range(5)]  # fmt: skip
        waits[name] = np.mean([each.metrics().t_avg for each in days])
    assert waits["scenario"] < waits["logic"]


def test_decisions_can_be_asked_whether_they_fall_short():
    controller = create("scenario")
    controller.start(load_station("thesis-fit"))
    assert controller.decisions == 0
    now = seen_at(0.0)
    controller.decide(now)
    assert controller.decisions == 1
    assert controller.covered
    nobody, many = np.full(16, 1e9), np.arange(1.0, 17.0)
    usual = np.full(STARTS, 137.0)
    assert not controller.falls_short(now, nobody, usual)
    assert isinstance(controller.falls_short(now, many, usual), bool)
    empty = now._replace(pressure=(300.0,) * 3, vehicle_pressure=250.0)
    controller.start(load_station("thesis-fit"))
    controller.decide(empty)
    assert not controller.covered
    assert controller.falls_short(empty, nobody, usual)


@pytest.mark.parametrize(
    "given", [{"futures": 0}, {"candidates": 9}, {"seed": -1}, {"window": 61}, {"width": 0}, {"scenarios": 3}]
)
def test_a_wrong_option_is_an_error_that_names_it(given):
    with pytest.raises(InputError, match=next(iter(given))):
        create("scenario", **given)
