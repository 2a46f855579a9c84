"""Runs stepped together: the bytes of `simulate`, cost components against its metrics, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st

from controllers import create
from station import InputError, Limit, load_scenario, load_station, parse_scenario, simulate
from station.geometry import VALVES
from station.simulation import liveness_of
from station.valves import commands
from station.vector_kernels import COSTS, RUNNING, SERVED, TIME_OVER
from station.vector_run import VectorRun
from tests.samples import samples


class Random:
    """A controller that draws its commands by a seed, and remembers them."""

    name, obeys_hold = "random", True

    def __init__(self, seed, *, closed=0.5):
        self.seed, self.closed = seed, closed
        self.fallback = create("logic")

    def start(self, station):
        self.commands = commands(station.compressor.count)
        self.generator, self.given = np.random.default_rng(self.seed), []

    def decide(self, observation):
        drawn = self.generator.random() < self.closed
        command = 0 if drawn else int(self.generator.choice(self.commands))
        self.given.append(command)
        return command, 0, np.nan, np.nan


def slot_of(scenario):
    """What the slot has beside a controller: the fallback, started, and the liveness limit."""
    rule = create("logic")
    rule.start(scenario.known_station)
    return {"fallback": rule.compiled(), "liveness": liveness_of(None, scenario.station)}


def played(run, given):
    """Step the first run with these commands; the sum of its costs."""
    total = np.zeros(len(COSTS))
    active = np.ones(run.number, np.bool_)
    run.begin()
    for command in given:
        assert run.over[0] == RUNNING
        run.apply(np.full(run.number, command, np.int64), active)
        run.begin()
        total += run.costs[0]
    return total


def document_of(preset, **changes):
    document = load_scenario("S1").on(load_station(preset)).model_dump()
    return document | {"time_limit_s": 4000.0, **changes}


@samples(
    3,
    20,
    preset=st.sampled_from(["thesis-fit", "light-duty-700", "h70-light"]),
    count=st.integers(1, 3),
    communication=st.booleans(),
    idle=st.sampled_from([1, 7]),
    replication=st.integers(0, 3),
    seed=st.integers(0, 9),
)
def test_the_same_commands_give_the_bytes_of_simulate(preset, count, communication, idle, replication, seed):
    document = document_of(preset, communication=communication, idle_period_s=idle)
    document["station"]["compressor"]["count"] = count
    document["station"]["slot"]["liveness_s"] = 60.0
    scenario = parse_scenario(document)
    controller = Random(seed)
    expected = simulate(scenario, controller, replication=replication, seed=seed)
    run = VectorRun(scenario, 1, keeping=True, **slot_of(scenario))
    run.start(0, replication, seed)
    played(run, controller.given)
    assert run.over[0] != RUNNING
    assert run.record("random").to_bytes() == expected.to_bytes()


@pytest.mark.parametrize(
    "changes",
    [
        {"disturbance": {"sensors": "uniform", "plant": "corner", "seed": 7}},
        {"faults": [{"kind": "leak", "buffer": "high", "begin_s": 100.0, "end_s": 900.0, "rate_g_per_s": 0.5}]},
        {"faults": [{"kind": "compressor_weak", "begin_s": 50.0, "loss_percent": 30.0}]},
    ],
)
def test_disturbed_and_faulty_runs_have_the_bytes_of_simulate(changes):
    scenario = parse_scenario(document_of("thesis-fit", **changes))
    controller = Random(3)
    expected = simulate(scenario, controller, replication=2, seed=1)
    run = VectorRun(scenario, 1, keeping=True, **slot_of(scenario))
    run.start(0, 2, 1)
    played(run, controller.given)
    assert run.record("random").to_bytes() == expected.to_bytes()


@pytest.mark.parametrize("preset", ["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
def test_costs_sum_to_the_metrics(preset):
    scenario = parse_scenario(document_of(preset, idle_period_s=5))
    controller = Random(4, closed=0.2)
    record = simulate(scenario, controller, replication=1, seed=8)
    found, expected = VectorRun(scenario, 1, keeping=True, **slot_of(scenario)), record.metrics()
    found.start(0, 1, 8)
    total = dict(zip(COSTS, played(found, controller.given), strict=True))
    assert total["waiting"] == pytest.approx(expected.t_total, rel=1e-12)
    assert total["compressor"] == expected.t_comp
    assert total["dispensing"] == expected.t_dis
    assert total["delivered"] / 1000 == pytest.approx(expected.delivered, rel=1e-12)
    assert total["energy"] == pytest.approx(expected.energy_kwh, rel=1e-9)
    assert total["refused"] == expected.refused_valves > 0
    assert total["liveness"] == expected.t_liveness


def test_runs_beside_each_other_do_not_touch_each_other():
    """Each of many runs is what it is alone, whoever is stepped beside it and whenever it began."""
    scenario = load_scenario("S1")
    many, alone = (VectorRun(scenario, number, **slot_of(scenario)) for number in (5, 1))
    generator = np.random.default_rng(6)
    steps = [many.commands[generator.integers(0, len(many.commands), 5)] for _ in range(700)]
    for place in range(5):
        many.start(place, place, place + 1)
    many.begin()
    shown, masks = [], []
    for step, asked in enumerate(steps):
        if step == 250:
            many.start(3, 9, 9)  # anew, beside four that go on
            many.begin()
        many.apply(asked, np.ones(5, np.bool_))
        many.begin()
        shown.append(many.shown.copy())
        masks.append(many.masks.copy())
    for place, first, day in ((1, 0, (1, 2)), (3, 250, (9, 9)), (4, 0, (4, 5))):
        alone.start(0, *day)
        alone.begin()
        for step in range(first, 700):
            alone.apply(steps[step][place : place + 1].copy(), np.ones(1, np.bool_))
            alone.begin()
            assert alone.shown.tobytes() == shown[step][place].tobytes()
            assert alone.masks.tobytes() == masks[step][place].tobytes()


def test_what_is_not_active_stays_where_it_is():
    run = VectorRun(load_scenario("S1"), 2)
    run.begin()
    run.apply(run.commands[[1, 1]], np.array([True, False]))
    run.begin()
    assert run.times().tolist() == [1.0, 0.0]


@pytest.mark.parametrize("preset", ["thesis-fit", pytest.param("h70-light", marks=pytest.mark.slow)])
def test_a_mask_is_what_the_shield_lets_through(preset):
    """A command passes the shield as it is where its mask says so, and nowhere else."""
    scenario = parse_scenario(document_of(preset))
    run = VectorRun(scenario, 1, keeping=True)
    generator, told = np.random.default_rng(2), []
    run.start(0, 1, 2)
    run.begin()
    for _ in range(1500):
        if run.over[0] != RUNNING:
            break
        action = int(generator.integers(len(run.commands)))
        told.append((int(run.commands[action]), bool(run.masks[0, action])))
        run.apply(run.commands[[action]], np.ones(1, np.bool_))
        run.begin()
    record = run.record("mask")
    applied = sum(record[valve][: len(told)].astype(int) << bit for bit, valve in enumerate(VALVES))
    assert [(asked == done) for (asked, _), done in zip(told, applied, strict=True)] == [passes for _, passes in told]
    assert 100 < sum(passes for _, passes in told) < len(told) - 100


def test_without_a_shield_limits_hold_nothing_and_are_named():
    scenario = parse_scenario(document_of("thesis-fit", time_limit_s=3600.0))
    run = VectorRun(scenario, 1, shielded=False, keeping=True)
    run.begin()
    violated = 0.0
    while run.over[0] == RUNNING:
        connected = run.shown[0, 7] == 1.0
        command = 8 if connected else 1  # give from high whatever the gap, else fill it whatever its heat
        run.apply(np.array([command]), np.ones(1, np.bool_))
        run.begin()
        violated += run.costs[0, list(COSTS).index("refused")]
    record = run.record("unshielded")
    refused = np.concatenate([record[f"refused_{valve}"] for valve in VALVES])
    broken = {Limit(int(code)) for code in np.unique(refused) if code}
    assert violated == np.count_nonzero(refused) > 0
    assert {Limit.GAP, Limit.HOLD} & broken
    assert (record["flow_dispenser"] >= 0).all()
    assert record["pressure_high"].max() < scenario.station.compressor.pressure_bar
    held = (record["refused_outlet_high"] > 0) & (record["outlet_high"] == 1)
    assert held.any()  # a valve that the shield would have kept closed is open
    assert not ((record["outlet_high"] == 1) & (record["vehicle"] < 0)).any()


def test_it_ends_by_serving_all_or_by_time():
    scenario = load_scenario("S1")
    logic = simulate(scenario, create("logic"))
    asked = sum(logic[valve][:-1].astype(int) << bit for bit, valve in enumerate(VALVES))
    run = VectorRun(scenario, 1, obeys_hold=False)
    played(run, asked.tolist())
    assert run.over[0] == SERVED
    short = VectorRun(parse_scenario(document_of("thesis-fit", time_limit_s=4000.0)), 1)
    played(short, [0] * 4000)
    assert short.over[0] == TIME_OVER


def test_what_cannot_be_stepped_together_is_refused_by_name():
    disturbed = parse_scenario(document_of("thesis-fit", disturbance={"sensors": "uniform", "plant": "corner"}))
    faulty = parse_scenario(document_of("thesis-fit", faults=[{"kind": "compressor_tripped", "begin_s": 10.0}]))
    for scenario, field in ((disturbed, "disturbance"), (faulty, "faults")):
        with pytest.raises(InputError, match=f"{field}: must be left out where more runs than one"):
            VectorRun(scenario, 2)
    with pytest.raises(InputError, match="disturbance: must be left out without a shield"):
        VectorRun(disturbed, 1, shielded=False)
    with pytest.raises(InputError, match="number: must be at least 1; given 0"):
        VectorRun(load_scenario("S1"), 0)
    with pytest.raises(InputError, match="keeping: must be true"):
        VectorRun(load_scenario("S1"), 1).record("x")
