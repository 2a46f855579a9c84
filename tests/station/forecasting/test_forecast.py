"""Forecasts: a future with known vehicles is the run that goes on; others share what is drawn; what they cost is so."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.brief_plans import DAYS, costs, told
from controllers import create_from
from controllers.contenders import contender
from station import InputError, load_scenario, parse_scenario, simulate
from station.arrivals import Vehicles
from station.columns import VALUES
from station.estimation.belief import root_of
from station.estimation.filter import model_of
from station.estimation.online import OnlineFilter
from station.forecasting.accounts import Account
from station.forecasting.demand import FIGURES, Seen, as_seen, by_law, nobody, seen_of
from station.forecasting.estimate import Estimated, drawn, fork_of, fork_of_belief, in_air
from station.forecasting.forecast import LEVELS, Price, forecast
from station.forecasting.futures import GRID
from station.frames import frames_of
from station.live import AtEnd, LiveRun, SlotState
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.metrics import metrics
from station.plants.interface import M, P, T
from station.plants.real_gas.entries import INSIDE, connected_visit
from station.plants.real_gas.layout import BLOCK
from station.plants.real_gas.tank import CELLS
from station.run import ARRIVAL, ARRIVED, CONNECTED, CURRENT, FINISHED, PREVIOUS, START_PRESSURE

PRICE = Price(waiting=20.0, unserved=50.0)
PRESSURES = [list(VALUES).index(f"pressure_{name}") for name in ("high", "medium", "low")]


def _live(scenario, name, seconds):
    """A live run so many seconds on, and the slot it is decided by."""
    controller = create_from(name)
    controller.start(scenario.known_station)
    beside = contender(name, scenario)
    slot = SlotState(controller.decide, controller.obeys_hold, fallback=beside.fallback, liveness=beside.liveness)
    run = LiveRun(scenario, AtEnd.REPEAT)
    for _ in range(seconds):
        run.step(slot)
    return run, slot, controller


FAULTS = [
    {"kind": "compressor_weak", "begin_s": 2000.0, "end_s": 4000.0, "loss_percent": 40.0},
    {"kind": "leak", "buffer": "high", "begin_s": 3300.0, "rate_g_per_s": 2.0},
]
"""One that is there when a forecast begins and ends within it, and one that begins within it."""


@pytest.mark.parametrize("station", ["thesis-fit", "h70-light"])
@pytest.mark.parametrize(("name", "faults"), [("logic", []), ("minlp1", []), ("logic", FAULTS)])
def test_a_future_with_known_vehicles_is_the_run_that_goes_on(station, name, faults):
    scenario = parse_scenario({**load_scenario("S3").model_dump(), "station": station, "faults": faults})
    run, slot, controller = _live(scenario, name, 3000)
    fork = run.fork()
    before = [array.copy() for array in fork[:3]]
    acting = contender(name, scenario, controller.memory)
    account = Account(scenario, fork, 1800, 0.3)
    found = forecast(fork, [acting], nobody, account, horizon=1800, futures=2, price=PRICE).outcomes[0]
    assert all(np.array_equal(one, other, equal_nan=True) for one, other in zip(before, fork[:3], strict=True))
    rows = np.array([run.step(slot).row for _ in range(1801)])
    assert found.pressures[0].tobytes() == found.pressures[1].tobytes()
    assert found.pressures[0].tobytes() == rows[::GRID, PRESSURES].tobytes()
    vehicles = run.fork().vehicles
    there = slice(int(before[1][CURRENT]) if before[1][CURRENT] >= 0 else None, None)
    served = np.count_nonzero(vehicles[FINISHED, there] <= fork.time + 1800)
    assert found["served"][0] == served > 0
    waits = np.fmin(vehicles[CONNECTED, there], fork.time + 1800) - vehicles[ARRIVAL, there]
    waits = waits[vehicles[ARRIVAL, there] < fork.time + 1800]
    assert found["wait"][0] == pytest.approx(waits.mean(), abs=1e-12)


@pytest.mark.parametrize("station", ["thesis-fit", "h70-light"])
def test_a_whole_day_costs_what_its_record_does(station):
    """From the first second on a future is a simulated day: hydrogen, energy and cost are those of its metrics."""
    scenario = parse_scenario({**load_scenario("S1").model_dump(), "station": station})
    record = simulate(scenario, create_from("logic"))
    figures, horizon = metrics(record), int(record["time"][-1])
    fork = LiveRun(scenario, AtEnd.IDLE).fork()
    (found,) = forecast(
        fork, [contender("logic", scenario)], nobody, Account(scenario, fork, horizon, 0.3), horizon=horizon, futures=1,
        price=PRICE,
    ).outcomes  # fmt: skip
    assert found["delivered"][0] == pytest.approx(figures.delivered, rel=1e-9)
    assert found["served"][0] == figures.vehicles - figures.vehicles_not_finished > 0
    assert found["compressing"][0] == figures.t_comp
    assert found["energy"][0] == pytest.approx(figures.energy_kwh, rel=1e-9)
    if scenario.station.tariff is not None:
        assert found["cost"][0] == pytest.approx(figures.total_eur, rel=1e-9)


def test_controllers_share_states_and_vehicles_and_a_seed_is_a_forecast():
    scenario = load_scenario("S3")
    run, _, _ = _live(scenario, "logic", 600)
    fork = run.fork().known(0.0)
    account = Account(scenario, fork, 3600, 0.3)

    def made(seed, names):
        demand = by_law(scenario, fork.time, 3600, seed)
        given = [contender(name, scenario) for name in names]
        return forecast(fork, given, demand, account, horizon=3600, futures=20, price=PRICE)

    both = made(1, ("logic", "minlp1"))
    assert (both.outcomes[0]["vehicles"] == both.outcomes[1]["vehicles"]).all()
    alone = made(1, ("logic",))
    assert both.outcomes[0].figures.tobytes() == alone.outcomes[0].figures.tobytes()
    assert made(2, ("logic",)).outcomes[0].figures.tobytes() != alone.outcomes[0].figures.tobytes()
    same = made(1, ("logic", "logic"))
    assert [each.beats for each in same.ranking()] == [0.5, 0.5]


def test_what_is_not_announced_is_not_known():
    scenario = load_scenario("S1")
    run, _, _ = _live(scenario, "logic", 100)
    fork = run.fork()
    arrivals = fork.vehicles[ARRIVAL]
    assert fork.known(0.0).vehicles.shape[1] == np.count_nonzero(arrivals <= fork.time) < len(arrivals)
    assert fork.known(1e9).vehicles.shape[1] == len(arrivals)
    assert fork.known(0.0).vehicles.shape[1] == int(fork.counters[ARRIVED])


def test_a_law_draws_at_its_rate_over_midnight():
    scenario = parse_scenario(
        {"name": "x", "about": "x", "arrivals": {"kind": "poisson", "rate_per_h": 12.0, "period_s": 7200.0}}
    )
    begin, horizon = 5000.0, 10_800.0
    draw = by_law(scenario, begin, horizon, seed=3)
    drawn = [draw(future) for future in range(400)]
    assert all((each.arrival > begin).all() and (each.arrival <= begin + horizon).all() for each in drawn)
    assert all((np.diff(each.arrival) >= 0).all() for each in drawn)
    assert np.mean([len(each.arrival) for each in drawn]) == pytest.approx(36.0, abs=3 * 6.0 / 20)
    assert draw(7).arrival.tobytes() == by_law(scenario, begin, horizon, seed=3)(7).arrival.tobytes()


def test_what_came_is_learned_with_what_is_not_known_of_its_rate():
    """Poisson counts at a rate of Gamma(n + 1/2, t): their mean is (n + 1/2) h / t, their variance larger."""
    scenario = load_scenario("S1")
    seen = Seen(LiveRun(scenario, AtEnd.IDLE).fork().vehicles[:, :5], 3600.0)
    draw = as_seen(seen, 100.0, 1800.0, seed=5)
    counts = np.array([len(draw(future).arrival) for future in range(4000)])
    mean = 5.5 * 0.5
    assert counts.mean() == pytest.approx(mean, abs=0.12)
    assert counts.var() == pytest.approx(mean + 5.5 * 0.25, rel=0.1)
    assert len(as_seen(seen._replace(vehicles=seen.vehicles[:, :0]), 0.0, 1800.0, seed=5)(0).arrival) == 0


def test_bands_are_quantiles_and_a_station_without_powers_is_ranked_by_service():
    plain = load_scenario("S1").model_dump()
    for part in ("compressor", "precooler"):
        plain["station"][part]["power_kw"] = None
    scenario = parse_scenario(plain)
    fork = LiveRun(scenario, AtEnd.IDLE).fork()
    found = forecast(
        fork, [contender(name, scenario) for name in ("logic", "reserve")], nobody, Account(scenario, fork, 3600, 0.3),
        horizon=3600, futures=1, price=PRICE,
    )  # fmt: skip
    assert np.isnan([each["cost"] for each in found.outcomes]).all()
    order = found.ranking()
    assert order[0].score <= order[1].score
    assert np.isfinite([each.score for each in order]).all()
    assert LEVELS == (0.05, 0.5, 0.95)


def test_a_controller_that_is_called_each_second_is_refused(monkeypatch):
    from controllers import contenders

    class Called:
        name, obeys_hold = "called", True

        def start(self, station):
            pass

        def decide(self, observation):
            return 0

    monkeypatch.setattr(contenders, "create", lambda name: Called())
    with pytest.raises(InputError, match="cannot be forecast"):
        contender("called", load_scenario("S1"))


@pytest.mark.parametrize("station", ["thesis-fit", "h70-light"])
def test_a_fork_of_a_row_of_estimates_holds_what_it_says(station):
    scenario = parse_scenario({**load_scenario("S1").model_dump(), "station": station})
    run, _, _ = _live(scenario, "logic", 300)
    true = run.fork()
    mass, temperature = true.state[M : M + 4], true.state[T : T + 4]
    estimated = Estimated(mass, temperature, scenario.station.vehicle.volume_m3)
    fork = fork_of(scenario, true.time, estimated)
    assert fork.time == true.time
    assert np.allclose(fork.state[M : M + 4], mass, rtol=1e-6)
    assert np.allclose(fork.state[P : P + 4], true.state[P : P + 4], rtol=1e-5)
    assert (fork.counters[CURRENT], fork.waiting, fork.vehicles.shape[1]) == (0, 0, 1)
    nobody_there = estimated._replace(mass=np.append(mass[:3], np.nan))
    empty = fork_of(scenario, 5.0, nobody_there)
    assert (empty.counters[CURRENT], empty.vehicles.shape[1]) == (-1, 0)
    with pytest.raises(ValueError, match="sign"):
        fork_of(scenario, 5.0, estimated._replace(mass=mass * 10))


def _believed(scenario, seconds):
    """What a filter believes of S1 that is measured, before a second, and the true run there."""
    record = simulate(scenario, create_from("logic"))
    followed = OnlineFilter(scenario.station)
    followed.push(frames_of(samples_of(measured_day(record, 1), tags_of_day())).part(0, seconds + 1))
    run, _, _ = _live(scenario, "logic", seconds)
    return followed.belief(), run.fork()


@pytest.mark.parametrize("communication", [False, True])
@pytest.mark.parametrize("station", ["thesis-fit", "h70-light"])
def test_a_fork_of_a_belief_is_the_station_with_all_that_is_in_it(station, communication):
    given = {**load_scenario("S1").model_dump(), "station": station, "communication": communication}
    scenario = parse_scenario(given)
    belief, true = _believed(scenario, 150)
    assert belief.connected
    fork = fork_of_belief(scenario, 150.0, belief)
    assert fork.time == true.time
    assert (fork.counters[CURRENT], fork.waiting, fork.vehicles.shape[1]) == (0, 0, 1)
    assert fork.counters[PREVIOUS] == true.counters[PREVIOUS]
    assert fork.state[P : P + 4] == pytest.approx(true.state[P : P + 4], abs=2.0)
    assert fork.state[T : T + 4] == pytest.approx(true.state[T : T + 4], abs=1.0)
    if station == "h70-light":
        assert connected_visit(fork.state) == pytest.approx(connected_visit(true.state), rel=0.03)
        cold = INSIDE + true.parameters.plant.station.rest_at + BLOCK
        assert fork.state[cold] == pytest.approx(true.state[cold], abs=0.5)
        walls = INSIDE + true.parameters.plant.station.vehicle_at + CELLS
        assert fork.state[walls : walls + 8] == pytest.approx(true.state[walls : walls + 8], abs=3.0)
    account = Account(scenario, fork, 600, 0.3)
    both = [
        forecast(each, [contender("logic", scenario)], nobody, account, horizon=600, futures=1, price=PRICE).outcomes[0]
        for each in (fork, true.known(0.0))
    ]  # fmt: skip
    assert both[0].pressures == pytest.approx(both[1].pressures, abs=4.0)
    assert both[0]["served"] == both[1]["served"] == 1  # the vehicle connected is filled to its end


@pytest.mark.parametrize("station", ["thesis-fit", "h70-light"])
def test_states_are_drawn_with_the_covariance_of_the_filter(station):
    scenario = parse_scenario({**load_scenario("S1").model_dump(), "station": station})
    belief, _ = _believed(scenario, 150)
    fork = fork_of_belief(scenario, 150.0, belief)
    state = drawn(scenario, fork, belief.spread, seed=4)
    states = np.array([state(future) for future in range(400)])
    assert state(3).tobytes() == drawn(scenario, fork, belief.spread, seed=4)(3).tobytes()
    masses = slice(M, M + 4)
    model, plant = model_of(scenario.station), fork.parameters.plant
    volume = scenario.station.vehicle.volume_m3
    moved = []
    for column in belief.spread.T:
        there = fork.state + column
        model.restate(there, volume, plant)
        moved.append(there - fork.state)
    expected = np.sqrt(np.sum(np.square(moved), axis=0))
    assert states[:, masses].std(axis=0) == pytest.approx(expected[masses], rel=0.15)
    assert states[:, P : P + 4].std(axis=0) == pytest.approx(expected[P : P + 4], rel=0.15)
    assert states[:, P : P + 4].mean(axis=0) == pytest.approx(fork.state[P : P + 4], abs=1.0)
    empty = fork_of_belief(scenario, 5.0, belief._replace(connected=False))
    assert (empty.counters[CURRENT], empty.vehicles.shape[1]) == (-1, 0)


@pytest.mark.parametrize("station", ["thesis-fit", "h70-light"])
def test_no_future_begins_in_a_state_that_none_can_be_in(station):
    scenario = parse_scenario({**load_scenario("S1").model_dump(), "station": station})
    belief, _ = _believed(scenario, 150)
    fork = fork_of_belief(scenario, 150.0, belief)
    state = drawn(scenario, fork, 300.0 * belief.spread, seed=1)
    pressures = np.array([state(future)[P : P + 4] for future in range(100)])
    assert ((pressures > 0.0) & (pressures < 2000.0)).all()
    assert pressures[:, 0].std() > 20.0
    emptied = belief.state.copy()
    emptied[P] = np.nan
    with pytest.raises(ValueError, match="pressures must lie between"):
        fork_of_belief(scenario, 150.0, belief._replace(state=emptied))


def test_a_filter_believes_nothing_while_it_holds_the_first_minute_back():
    scenario = load_scenario("S1")
    frames = frames_of(samples_of(measured_day(simulate(scenario, create_from("logic")), 1), tags_of_day()))
    followed = OnlineFilter(scenario.station)
    followed.push(frames.part(0, 59))
    assert followed.belief() is None
    followed.push(frames.part(59, 60))
    assert followed.belief() is not None


def test_a_root_of_a_covariance_that_rounding_left_negative_is_one_all_the_same():
    random = np.random.default_rng(3)
    part = random.standard_normal((6, 4)) * np.array([1e-3, 1e5, 1.0, 1e-9, 0.0, 10.0])[:, None]
    covariance = part @ part.T
    root = root_of(covariance)
    scale = np.sqrt(np.diag(covariance))
    assert root @ root.T == pytest.approx(covariance, abs=1e-9 * float(np.outer(scale, scale).max()))
    assert not root[4].any()


def test_other_air_is_that_of_the_station():
    scenario = load_scenario("S1")
    warmer = in_air(scenario, 2.5)
    usual = scenario.station.thermal.ambient_temperature_c
    assert warmer.station.thermal.ambient_temperature_c == usual + 2.5
    assert warmer.on(scenario.station) == scenario


def test_vehicles_that_were_seen_are_told_once_with_the_pressure_they_came_with():
    station = load_scenario("S1").station
    number = np.array([np.nan, -1, 3, np.nan, 3, -1, 4, 4, 5, 5], float)
    pressure = np.array([np.nan, np.nan, np.nan, 120.0, 130.0, np.nan, 90.0, 95.0, 9000.0, np.nan])
    seen = seen_of(np.arange(10.0), number, pressure, station, 10.0)
    assert seen.vehicles[ARRIVAL].tolist() == [2.0, 6.0, 8.0]
    usual = station.vehicle.start_pressure_bar
    assert seen.vehicles[START_PRESSURE].tolist() == [120.0, 90.0, usual]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["guarded", "adaptive"])
def test_vehicles_of_a_long_run_have_the_numbers_that_controllers_remember(name):
    arrivals = {"kind": "uniform", "count": 80, "period_s": 20_000.0}
    scenario = parse_scenario({**load_scenario("S3").model_dump(), "arrivals": arrivals, "communication": True})
    run, slot, controller = _live(scenario, name, 17_000)
    while run.fork().counters[CURRENT] < 0 or not run.fork().gone:
        run.step(slot)
    fork = run.fork()
    again = [fork.numbered(), fork.here().numbered()]
    account = Account(scenario, fork, 600, 0.3)
    coming = fork.vehicles[FIGURES, fork.counters[ARRIVED] :]
    found = []
    for each, demand in zip(again, (nobody, lambda _: Vehicles(*coming)), strict=True):
        assert each.counters[CURRENT] == fork.gone + fork.counters[CURRENT]
        acting = contender(name, scenario, controller.memory, slot.fallback.memory)
        (outcomes,) = forecast(each, [acting], demand, account, horizon=600, futures=1, price=PRICE).outcomes
        found.append(outcomes.pressures[0].tobytes())
    rows = np.array([run.step(slot).row for _ in range(601)])
    assert found == [rows[::GRID, PRESSURES].tobytes()] * 2


def test_briefly_planned_futures_have_their_own_options_unless_the_text_has_others():
    scenario = load_scenario("S1")

    def vector(text, *, brief):
        return contender(text, scenario, brief=brief).controller.settings.tolist()

    assert vector("switched", brief=False) == vector("switched:bound=true", brief=False)
    short = vector("switched", brief=True)
    assert short == vector("switched:width=24:blocks=8:follow=6:bound=false", brief=False)
    assert vector("switched:blocks=14:width=46", brief=True) != short
    assert vector("switched:blocks=14:follow=3", brief=True) == vector("switched:width=24:bound=false", brief=False)
    assert vector("logic", brief=True) == vector("logic", brief=False)


def test_a_bound_that_is_not_wanted_changes_no_command():
    told, silent = (simulate(load_scenario("S1"), create_from(f"switched:bound={each}")) for each in ("true", "false"))
    bound = list(VALUES).index("decision_bound")
    assert np.isfinite(told.values[bound, :-1]).all()
    assert np.isnan(silent.values[bound]).all()
    silent.values[bound] = told.values[bound]
    assert silent.to_bytes() == told.to_bytes()


def test_a_plan_is_followed_no_further_than_it_goes():
    """With fewer blocks than are to be followed a plan is made anew when they are over."""
    day = load_scenario("S1")
    short = simulate(day, create_from("switched:blocks=3:follow=12"))
    assert short.to_bytes() == simulate(day, create_from("switched:blocks=3:follow=3")).to_bytes()


@pytest.mark.slow
def test_brief_plans_cost_a_day_no_more_than_two_hundredths():
    usual, brief = (costs(text, "thesis-fit", DAYS) for text in ("switched", told("switched")))
    assert brief.unserved == usual.unserved
    assert brief.t_avg == pytest.approx(usual.t_avg, rel=0.02)
    assert brief.t_comp_restored == pytest.approx(usual.t_comp_restored, rel=0.02)
