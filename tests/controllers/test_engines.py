"""SCIP and Bonmin against the exact engine, which they share nothing with but the plant."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import create
from controllers.minlp.casadi_engine import CasadiEngine
from controllers.minlp.pyomo_engine import PyomoEngine
from controllers.minlp.solvers import Answer, SolverEngine, SolverError
from station import Status, load_scenario, parse_scenario, simulate
from station.geometry import INLETS, Valve
from tests.controllers.states import REAL_STATIONS, STATIONS, problem, seeded

EXACT = 1e-12  # relative: two sums of the same numbers in another order
AGREED = 1e-6  # relative to what the valves change, stricter than relative to the cost


def engine(kind, given):
    return kind(given.plant, given.objective, given.settings)


def referee(seed, count, horizon, stations=STATIONS):
    """Let SCIP judge the exact engine on random problems; the number of those it proved."""
    source = seeded(np.random.default_rng(seed))
    proven = 0
    for number in range(count):
        given = problem(source, horizon, node_limit=10**9, stations=stations)
        exact = given.exact()
        scip = engine(PyomoEngine, given).solve(given.observation)
        change = max(1.0, abs(exact.cost - given.standing()))
        where = f"seed {seed}, problem {number}, horizon {horizon}"
        assert exact.status == Status.OPTIMAL, where
        assert scip.cost == pytest.approx(given.cost(scip.commands), rel=EXACT), where
        assert exact.cost <= scip.cost * (1 + EXACT), where
        assert exact.cost >= scip.bound - AGREED * change, where
        if scip.proven:
            assert scip.cost - exact.cost <= AGREED * change, where
        proven += scip.proven
    return proven


@pytest.mark.slow
@pytest.mark.parametrize(("horizon", "count"), [(1, 14), (2, 10), pytest.param(3, 6, marks=pytest.mark.slow)])
def test_scip_finds_nothing_cheaper_than_exact(horizon, count):
    assert referee(horizon, count, horizon) >= count - 1


@pytest.mark.slow
@pytest.mark.parametrize(("horizon", "count"), [(1, 30), (2, 20), (3, 6)])
def test_scip_finds_nothing_cheaper_than_exact_with_covolume_ramp_and_energy(horizon, count):
    """Unproved are some in which no valve may open: what changes is then less than SCIP's tolerance."""
    assert referee(200 + horizon, count, horizon, REAL_STATIONS) >= 0.85 * count


@pytest.mark.parametrize(
    "count", [pytest.param(100, marks=pytest.mark.slow), pytest.param(500, marks=pytest.mark.full)]
)
@pytest.mark.parametrize("horizon", [1, 2, 3])
def test_scip_finds_nothing_cheaper_than_exact_in_many_states(horizon, count):
    assert referee(100 + horizon, count, horizon) >= 0.99 * count


@pytest.mark.slow
@pytest.mark.parametrize("stations", [STATIONS, REAL_STATIONS], ids=["thesis", "control-model"])
@pytest.mark.parametrize("horizon", [1, 2])
def test_bonmin_is_never_cheaper_than_exact(horizon, stations):
    source = seeded(np.random.default_rng(horizon))
    for _ in range(10):
        given = problem(source, horizon, node_limit=10**6, stations=stations)
        bonmin = engine(CasadiEngine, given).solve(given.observation)
        assert bonmin.cost == pytest.approx(given.cost(bonmin.commands), rel=EXACT)
        assert bonmin.cost >= given.exact().cost * (1 - EXACT)
        assert not bonmin.proven
        assert bonmin.bound == -math.inf


def test_bonmin_is_silent(capfd):
    given = problem(seeded(np.random.default_rng(0)), 1)
    engine(CasadiEngine, given).solve(given.observation)
    assert capfd.readouterr() == ("", "")


def short(seconds, **more):
    return load_scenario("S1").model_copy(update={"time_limit_s": seconds, **more})


@pytest.mark.slow
@pytest.mark.parametrize("communication", [True, False])
def test_a_run_with_scip_is_the_run_of_the_exact_engine(communication):
    scenario = short(40.0, communication=communication)
    exact, scip = (simulate(scenario, create("minlp1", engine=name)) for name in ("exact", "pyomo"))
    np.testing.assert_array_equal(scip.codes, exact.codes)


@pytest.mark.slow
def test_a_run_with_scip_at_a_station_of_real_gas_is_the_run_of_the_exact_engine():
    begin = {"high": 900.0, "medium": 700.0, "low": 450.0}  # SCIP cannot tell a bank that is full from one below
    buffers = {name: {"initial_pressure_bar": pressure} for name, pressure in begin.items()}
    station = {"preset": "h70-light", "buffers": buffers}
    vehicles = [{"time_s": 0.0, "start_pressure_bar": 100.0}]
    given = {"name": "begun", "station": station, "arrivals": {"kind": "trace", "vehicles": vehicles}}
    scenario = parse_scenario(given).model_copy(update={"time_limit_s": 40.0})
    exact, scip = (simulate(scenario, create("minlp1", engine=engine)) for engine in ("exact", "pyomo"))
    np.testing.assert_array_equal(scip.codes, exact.codes)
    assert exact["flow_dispenser"].max() > 0


@pytest.mark.slow
def test_a_run_with_scip_and_a_longer_horizon():
    record = simulate(short(6.0), create("minlp1", engine="pyomo", horizon=2))
    assert record.codes.shape[1] == 7


def test_a_run_with_bonmin_claims_no_optimum():
    given = problem(seeded(np.random.default_rng(4)), 1)
    decision = engine(CasadiEngine, given).decide(given.observation)
    assert decision.status == Status.FEASIBLE
    assert math.isnan(decision.bound)


class Proposal(SolverEngine):
    """A solver that answers what it is told to."""

    def answering(self, commands, cost=0.0, bound=-math.inf, *, proven=True):
        self.answer = Answer(list(commands), cost, bound, proven, 0.0)
        return self

    def optimize(self, observation, present, allowed):
        return self.answer


def connected(name="minlp1", **settings):
    """A problem with a vehicle that any buffer could fill, all buffers below the hold."""
    source = seeded(np.random.default_rng(8))
    while True:
        given = problem(source, 1, **settings)
        if given.objective.buffers and not given.plant.outlet_coefficient > 0.1:
            observation = given.observation._replace(
                vehicle=0, vehicle_pressure=300.0, vehicle_temperature=25.0, pressure=(700.0, 600.0, 500.0),
                temperature=(25.0,) * 3, previous=0, period=1.0,
            )  # fmt: skip
            objective = create(name).objective(given.settings)
            return given._replace(observation=observation, objective=objective)


def test_a_claim_the_plant_denies_is_no_optimum():
    given = connected()
    pair = (int(Valve.OUTLET_HIGH), 0)
    true = given.cost(pair) - given.standing()
    for claimed, proven in ((true, True), (true * (1 + 1e-4), False)):
        solution = engine(Proposal, given).answering(pair, claimed, claimed).solve(given.observation)
        assert solution.proven == proven
        assert solution.cost == pytest.approx(given.cost(pair), rel=EXACT)
        decision = engine(Proposal, given).answering(pair, claimed, claimed).decide(given.observation)
        assert decision.status == (Status.OPTIMAL if proven else Status.FEASIBLE)
        assert decision.bound <= decision.cost


def test_of_the_first_command_the_plant_refuses_what_it_admits_and_costs_least_stays():
    given = connected()
    two_outlets = int(Valve.OUTLET_HIGH | Valve.OUTLET_LOW)
    solution = engine(Proposal, given).answering((int(Valve.INLET_LOW), two_outlets)).solve(given.observation)
    kept = (int(Valve.OUTLET_HIGH), int(Valve.OUTLET_LOW), 0)
    least = min(kept, key=lambda command: given.cost((int(Valve.INLET_LOW), command)))
    assert least
    assert solution.commands == (int(Valve.INLET_LOW), least)
    assert not solution.proven
    solution = engine(Proposal, given).answering((two_outlets, int(Valve.INLET_LOW))).solve(given.observation)
    assert solution.commands == (min(kept, key=lambda command: given.cost((command, 0))), 0)


def test_a_gap_a_solver_would_tolerate_stays_closed():
    given = connected()
    tight = given.observation._replace(pressure=(400.0 - 1e-11, 350.0, 350.0))
    for kind in (PyomoEngine, CasadiEngine):
        solution = engine(kind, given).solve(tight)
        assert not solution.commands[0] & ~int(INLETS)


def test_inlets_that_gain_nothing_are_closed():
    given = connected("minlp2")
    pair = (int(Valve.OUTLET_HIGH | Valve.INLET_LOW), int(Valve.OUTLET_HIGH | Valve.INLET_MEDIUM))
    solution = engine(Proposal, given).answering(pair).solve(given.observation)
    assert solution.commands == (int(Valve.OUTLET_HIGH), int(Valve.OUTLET_HIGH))


def test_liveness_fills_the_lowest_buffer_as_the_exact_engine_does():
    given = connected("minlp2", liveness=True)
    stalled = given._replace(observation=given.observation._replace(pressure=(390.0, 380.0, 370.0)))
    expected = stalled.exact()
    assert expected.status == Status.LIVENESS
    for kind in (PyomoEngine, CasadiEngine):
        decision = engine(kind, stalled).decide(stalled.observation)
        assert (decision.command, decision.status) == (expected.command, expected.status)


def test_a_solver_without_an_answer_is_an_error():
    given = connected()
    impossible = given.observation._replace(pressure=(math.nan, 600.0, 500.0))
    for kind in (PyomoEngine, CasadiEngine):
        with pytest.raises(SolverError, match="at 0 s"):
            engine(kind, given).solve(impossible)


class Silent(SolverEngine):
    """A solver that has no answer."""

    def optimize(self, observation, present, allowed):
        raise SolverError("none")


def test_without_an_answer_all_stays_closed_and_nothing_is_claimed():
    given = connected()
    decision = engine(Silent, given).decide(given.observation)
    assert (decision.command, decision.status) == (0, Status.FEASIBLE)
    assert decision.cost == pytest.approx(given.cost((0, 0)), rel=EXACT)
    assert math.isnan(decision.bound)


@pytest.mark.slow
def test_a_node_limit_gives_what_was_found():
    source = seeded(np.random.default_rng(12))
    unproven = 0
    for _ in range(12):
        given = problem(source, 3, node_limit=1)
        decision = engine(PyomoEngine, given).decide(given.observation)
        exact = given._replace(settings=given.settings.model_copy(update={"node_limit": 10**9})).exact()
        assert not decision.bound > exact.cost * (1 + 1e-9)
        assert decision.cost >= exact.cost * (1 - EXACT)
        unproven += decision.status == Status.FEASIBLE
    assert unproven
