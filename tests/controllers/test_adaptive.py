"""Constants identified on line: the truth stays in its interval, estimates converge, and half the loss is recovered."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.adaptive import LOST, REPLICATIONS, case_of, cost_of, disturbed
from controllers import create
from controllers.adaptive.controller import constants_of, flagged_of, identification_of
from controllers.adaptive.estimates import identified
from controllers.adaptive.identification import learn
from controllers.adaptive.memory import COUNT, ESTIMATE, FLAGGED, HIGH, IDENTIFIED, LOW, believed, start_identification
from station import InputError, load_scenario, load_station, parse_scenario, simulate
from station.limits import flow_margin
from station.readings import observations
from tests.station.test_simulation import Called

PRESETS = ("thesis-fit", "thesis-fit-a", "light-duty-700")
EXACT = {"parameters": 0.2, "pressure_bar": 0.0, "temperature_k": 0.0}


def run(preset="thesis-fit", *, limit=4000.0, communication=True, **disturbance):
    base = load_scenario("S1").on(load_station(preset)).model_dump()
    given = {"uncertainty": {"parameters": 0.2}, **disturbance}
    base |= {"time_limit_s": limit, "communication": communication, "disturbance": given}
    base["arrivals"]["period_s"] = min(limit, base["arrivals"]["period_s"])
    return parse_scenario(base)


def learned(scenario, controller="switched", replication=0):
    """The memory of the identification after each second of a run, (rows, COUNT) each: least, estimate, greatest."""
    record = simulate(scenario, create(controller), replication=replication)
    told = scenario.known_station.control_constants()
    memory = start_identification(scenario.known_station, None, 0.2)
    seen = np.empty((3, len(record), COUNT))
    for row, observation in enumerate(observations(record)):
        learn(observation, told, memory)
        for place, part in enumerate((LOW, ESTIMATE, HIGH)):
            seen[place, row] = memory[part : part + COUNT]
    return seen, record


@pytest.mark.parametrize("sensors", ["exact", "uniform", "corner"])
def test_the_truth_stays_in_its_interval_for_fifty_seeds(sensors):
    """Seventeen for each kind of sensors: plants at and within corners, three stations, some without communication."""
    for seed in range(17):
        scenario = run(
            PRESETS[seed % 3], limit=900.0, communication=seed % 4 != 0, sensors=sensors, seed=seed,
            plant="corner" if seed % 2 else "uniform",
        )  # fmt: skip
        (low, estimate, high), _ = learned(scenario, replication=seed % 3)
        truth = believed(scenario.plant(seed % 3))
        assert (low <= truth).all(), (seed, np.argwhere(low > truth)[0])
        assert (truth <= high).all(), (seed, np.argwhere(truth > high)[0])
        assert (low <= estimate).all()
        assert (estimate <= high).all()
        assert (np.diff(low, axis=0) >= 0).all()  # nothing was forgotten: the sets only shrink
        assert (np.diff(high, axis=0) <= 0).all()
        if scenario.communication:
            assert (high - low)[-1, 1] < 0.5 * (high - low)[0, 1]


SHARES = {
    "inlet_coefficient": 0.7, "outlet_coefficient": -0.8, "inlet_heating": -0.6, "outlet_cooling": 0.5,
    "vehicle_heating": 0.9, "heat_exchange": -0.7,
}  # fmt: skip


def test_estimates_converge_with_noisy_sensors():
    """After five vehicles: flows and the vehicle's heat within 1 %, the heat rates of buffers within 5 %."""
    for seed in range(5):
        scenario = run(sensors="uniform", plant="nominal", shares=SHARES, seed=seed)
        (low, estimate, high), _ = learned(scenario)
        off = np.abs(estimate / believed(scenario.plant()) - 1)
        assert off[0].min() > 0.09  # the station's figures are 10 to 18 % off
        assert off[-1][[0, 1, 8]].max() < 0.01, dict(zip(IDENTIFIED, off[-1], strict=True))
        assert off[-1][2:5].max() < 0.05
        assert ((high - low)[-1][:2] < 0.25 * (high - low)[0][:2]).all()


def test_exact_sensors_tell_a_mode_in_seconds():
    """Where the readings are known to be exact, some seconds of a mode fix its constants to a millionth."""
    scenario = run(sensors="exact", plant="nominal", shares=SHARES, uncertainty=EXACT)
    (_, estimate, _), record = learned(scenario)
    off = np.abs(estimate / believed(scenario.plant()) - 1)
    for place, buffer in enumerate(("high", "medium", "low")):
        for item, name in ((0, "inlet"), (1, "outlet")):
            began = np.flatnonzero(record[f"{name}_{buffer}"])
            assert began.size > 10
            after = began[0] + 10
            assert off[after, item] < 1e-6, (name, buffer)
            assert off[after:, 2 + 3 * item + place].max() < 1e-3, (name, buffer)
    assert off[-1].max() < 1e-4


def test_a_plant_that_changes_is_learnt_anew():
    memory = None
    for share in (0.8, -0.8):
        scenario = run(sensors="exact", plant="nominal", shares={"outlet_coefficient": share}, uncertainty=EXACT)
        told = scenario.known_station.control_constants()
        memory = start_identification(scenario.known_station, None, 0.2) if memory is None else memory
        for observation in observations(simulate(scenario, create("switched"))):
            learn(observation, told, memory)
        truth = believed(scenario.plant())
        assert abs(memory[ESTIMATE + 1] / truth[1] - 1) < 1e-6
        assert memory[LOW + 1] <= truth[1] <= memory[HIGH + 1]
        assert (memory[FLAGGED] > 0) == (share < 0)  # the second plant is not the first


def _played(station):
    """The memory of an adaptive controller after a busy day at a station of real gas, and its constants as told."""
    arrivals = {"kind": "uniform", "count": 20, "period_s": 14_400.0}
    scenario = parse_scenario({"name": "day", "station": station, "arrivals": arrivals})
    controller = create("adaptive")
    controller.start(scenario.known_station)
    compiled = controller.compiled()
    controller.compiled = lambda: compiled
    simulate(scenario, controller, replication=1)
    return compiled.memory, believed(scenario.station.control_constants())


def test_a_model_that_comes_near_a_plant_is_fitted_within_its_errors():
    """Before, every other second was flagged at a plant of real gas, and nothing was ever identified there."""
    memory, told = _played("h70-light")
    assert flagged_of(memory) == (0, None)
    assert identification_of(memory)[ESTIMATE] != told[0]


def test_a_model_of_unknown_errors_is_left_as_it_is():
    memory, told = _played({**load_station("h35-bus").model_dump(), "control_model": None})
    assert flagged_of(memory) == (0, None)
    assert identification_of(memory)[ESTIMATE : ESTIMATE + COUNT].tolist() == told.tolist()


def test_limits_stay_the_stations():
    """The flow limit is met at the pressure difference at which the station as told meets it."""
    scenario = run(plant="nominal", shares={"outlet_coefficient": -1.0})
    told = scenario.known_station.control_constants()
    memory = start_identification(scenario.known_station, None, 0.2)
    memory[ESTIMATE + 1] *= 0.85
    model = identified(told, memory)
    edge = told.limits.dispenser_flow_max / told.outlet_coefficient
    assert model.outlet_coefficient == pytest.approx(0.85 * told.outlet_coefficient)
    assert abs(flow_margin(edge, 0.0, model)) < 1e-12 * edge
    limits = model.limits._replace(dispenser_flow_max=told.limits.dispenser_flow_max)
    assert model.limits != limits == told.limits
    assert model._replace(outlet_coefficient=told.outlet_coefficient, limits=limits) == told


def test_every_constant_identified_stands_at_its_name():
    told = load_station("thesis-fit").control_constants()
    memory = start_identification(load_station("thesis-fit"), None, 0.2)
    memory[ESTIMATE : ESTIMATE + COUNT] = np.arange(1.0, COUNT + 1)
    model = identified(told, memory)
    assert believed(model).tolist() == memory[ESTIMATE : ESTIMATE + COUNT].tolist()
    taken = ("inlet_coefficient", "outlet_coefficient", "inlet_heating", "outlet_cooling", "vehicle_heating",
             "heat_exchange")  # fmt: skip
    limits = model.limits._replace(dispenser_flow_max=told.limits.dispenser_flow_max)
    assert model._replace(**{name: getattr(told, name) for name in taken}, limits=limits) == told


@pytest.mark.parametrize(
    ("preset", "communication", "idle", "disturbance"),
    [
        ("thesis-fit", True, 1, {"sensors": "uniform", "plant": "corner", "seed": 3}),
        ("light-duty-700", False, 1, {"sensors": "corner", "plant": "uniform", "seed": 4}),
        pytest.param("thesis-fit-a", True, 7, None, marks=pytest.mark.slow),
        pytest.param("thesis-fit", False, 60, None, marks=pytest.mark.slow),
    ],
)
def test_compiled_and_called_give_identical_bytes(preset, communication, idle, disturbance):
    document = load_scenario("S1").on(load_station(preset)).model_dump()
    document |= {"communication": communication, "idle_period_s": idle, "disturbance": disturbance}
    scenario = parse_scenario(document)
    compiled = simulate(scenario, create("adaptive"), replication=2)
    assert compiled.to_bytes() == simulate(scenario, Called(create("adaptive")), replication=2).to_bytes()
    assert compiled.to_bytes() == simulate(scenario, create("adaptive"), replication=2).to_bytes()
    assert compiled.metrics().vehicles_not_finished == 0


def test_with_nothing_to_identify_it_is_switched():
    scenario = run(sensors="uniform", plant="corner", seed=5)
    found, expected = (simulate(scenario, create(*given[:1], **given[1])) for given in
                       (("adaptive", {"parameters": 0.0}), ("switched", {})))  # fmt: skip
    assert len(found) == len(expected)
    for name in found.columns:
        np.testing.assert_array_equal(found[name], expected[name])


def test_memory_carries_what_was_learnt():
    scenario = run(sensors="uniform", plant="corner", seed=6, limit=600.0)
    usual = scenario.station.vehicle.finish_pressure_bar
    record = simulate(scenario, create("switched"))
    seen = [item._replace(finish_pressure=usual) for item in observations(record)]
    first, second = create("adaptive"), create("adaptive")
    first.start(scenario.known_station)
    second.start(scenario.known_station)
    for observation in seen[:300]:
        first.decide(observation)
    second.memory = first.memory.copy()
    assert constants_of(second.memory) == constants_of(first.memory)
    both = [[each.decide(item)[:3] for item in seen[300:400]] for each in (first, second)]
    assert both[0] == both[1]
    low, estimate, high = constants_of(first.memory)["outlet_coefficient"]
    assert low <= estimate <= high
    assert estimate == identification_of(first.memory)[ESTIMATE + 1]


@pytest.mark.parametrize("given", [{"parameters": 0.31}, {"parameters": -0.1}, {"width": 0}, {"window": 3}])
def test_a_wrong_option_is_an_error_that_names_it(given):
    with pytest.raises(InputError, match=next(iter(given))):
        create("adaptive", **given)


@pytest.mark.slow
def test_half_the_loss_is_recovered():
    """A compressor 20 % weaker than the station's file says, noisy sensors, S3: a row of docs/adaptive.md."""
    case = case_of(("thesis-fit-a", "S3", "uniform", "inlet_coefficient -1"))
    assert case.loss >= LOST
    assert case.recovered >= 0.5


@pytest.mark.slow
def test_no_worse_where_the_model_is_right():
    """Noisy sensors at the station's own figures: within 1 % of `switched`, over the stations."""
    shares = []
    for preset in PRESETS:
        scenario = disturbed(preset, "S1", "uniform", {})
        costs = [cost_of(scenario, create(name), REPLICATIONS["S1"]).cost for name in ("adaptive", "switched")]
        shares.append(costs[0] / costs[1] - 1)
    assert np.mean(shares) < 0.01, shares
