"""Faults of a scenario: of the plant in every run, of sensors in what is measured, and nothing changes without any."""

from __future__ import annotations

import json
from typing import get_args

import numpy as np
import pytest
from hypothesis import strategies as st

from controllers import create
from station import InputError, load_scenario, load_station, simulate
from station.controller import Decision
from station.estimation.detection import Event
from station.estimation.score import load_truth, score, untold
from station.faults.sensors import Analog, SensorAbsent
from station.frames import frames_of
from station.geometry import BUFFERS
from station.live import AtEnd, LiveRun, SlotState
from station.measured_day import measured_day, tags_of_day
from station.measurement import TagMap, samples_of
from station.record import Record
from station.scenario import parse_scenario
from station.sensor_names import ANALOG
from tests.samples import samples
from tests.station.test_simulation import Called

LEAK = {"kind": "leak", "buffer": "medium", "begin_s": 300.0, "end_s": 400.0, "rate_g_per_s": 0.5}


def _scenario(*faults, station="thesis-fit", **more):
    return parse_scenario(
        {
            "name": "faulty",
            "station": station,
            "arrivals": {
                "kind": "trace",
                "vehicles": [{"time_s": 60.0 + 900 * k, "start_pressure_bar": 120.0} for k in range(2)],
            },
            "time_limit_s": 2400.0,
            "faults": list(faults),
            **more,
        }
    )


def _run(*faults):
    return simulate(_scenario(*faults), create("logic"))


def test_without_faults_nothing_changes():
    healthy = _scenario()
    assert "faults" not in json.loads(healthy.model_dump_json())
    assert not healthy.plant_faults


def test_a_fault_that_has_not_begun_changes_no_byte():
    assert _run({**LEAK, "begin_s": 1e6, "end_s": None}).to_bytes() == _run().to_bytes()


def test_a_leak_takes_its_gas_and_ends():
    faulty, healthy = _run(LEAK), _run()
    np.testing.assert_array_equal(faulty.values[:, :301], healthy.values[:, :301])
    held = faulty["mass_high"] + faulty["mass_medium"] + faulty["mass_low"]
    balance = np.diff(held) - faulty["flow_compressor"][:-1] + faulty["flow_dispenser"][:-1]
    there = (faulty["time"][:-1] >= 300) & (faulty["time"][:-1] < 400)
    np.testing.assert_allclose(balance[there], -0.5, atol=1e-6)
    np.testing.assert_allclose(balance[~there], 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("fault", "column", "factor"),
    [
        ({"kind": "compressor_weak", "loss_percent": 20.0}, "flow_compressor", 0.8),
        ({"kind": "compressor_tripped"}, "flow_compressor", 0.0),
        ({"kind": "dispenser_clogged", "loss_percent": 50.0}, "flow_dispenser", 0.5),
    ],
)
def test_a_weakness_takes_its_part_of_the_flow(fault, column, factor):
    healthy = _run()
    begin = int(np.flatnonzero(healthy[column])[5])
    faulty = _run({**fault, "begin_s": float(begin)})
    assert faulty[column][begin - 1] == healthy[column][begin - 1]
    assert faulty[column][begin] == pytest.approx(factor * healthy[column][begin])


def _run_real(*faults):
    return simulate(_scenario(*faults, station="h70-light"), create("logic"))


def test_a_leak_of_real_gas_takes_its_gas_and_is_accounted_for():
    faulty, healthy = _run_real(LEAK), _run_real()
    np.testing.assert_array_equal(faulty.values[:, :301], healthy.values[:, :301])
    lost = healthy["mass_medium"][:330] - faulty["mass_medium"][:330]
    np.testing.assert_allclose(np.diff(lost)[300:320], 0.5, rtol=1e-6)
    assert np.abs(faulty["mass_unaccounted"]).max() < 1e-6
    assert np.abs(faulty["energy_unaccounted"]).max() < 1.0


@pytest.mark.parametrize(
    ("fault", "column", "change"),
    [
        ({"kind": "compressor_weak", "loss_percent": 20.0}, "flow_compressor", lambda x: 0.8 * x),
        ({"kind": "compressor_tripped"}, "flow_compressor", lambda x: 0.0 * x),
        ({"kind": "precooler_weak", "warmer_k": 5.0}, "temperature_delivery", lambda x: x + 4.5),
    ],
)
def test_a_weakness_of_real_machines(fault, column, change):
    healthy = _run_real()
    column_there = np.nan_to_num(healthy[column])
    begin = int(np.flatnonzero(column_there)[20])
    shift = 1 if column == "temperature_delivery" else 0  # a level stands in the row after its second
    faulty = _run_real({**fault, "begin_s": float(begin)})
    assert faulty[column][begin - 1 + shift] == healthy[column][begin - 1 + shift]
    assert faulty[column][begin + shift] == pytest.approx(change(healthy[column][begin + shift]), rel=0.01)


def test_the_truth_stands_in_the_record():
    again = Record.from_parquet(_run(LEAK).parquet())
    assert [fault.model_dump(exclude_none=True) for fault in again.scenario.faults] == [LEAK]


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "compressor_weak", "begin_s": 100.0, "loss_percent": 30.0},
        {"kind": "valve_stuck", "valve": "outlet_medium", "position": "open", "begin_s": 80.0, "end_s": 200.0},
        {"kind": "line_leak", "begin_s": 70.0, "rate_g_per_s": 1.0},
    ],
    ids=lambda fault: fault["kind"],
)
def test_a_live_run_has_the_same_faults(fault):
    scenario = _scenario(LEAK, fault)
    called = simulate(scenario, Called(create("logic")))
    expected = simulate(scenario, create("logic"))
    actor = create("logic")
    actor.start(scenario.known_station)

    def decide(observation) -> Decision:
        return actor.decide(observation)

    live = LiveRun(scenario, AtEnd.STOP)
    slot = SlotState(decide, bool(actor.obeys_hold))
    rows = []
    while not live.over:
        rows.append(live.step(slot).row)
    pressures = np.array([row[1:4] for row in rows])
    np.testing.assert_array_equal(pressures, expected.values[1:4].T)
    assert called.to_bytes() == expected.to_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate_g_per_s": 0.0}, "rate_g_per_s"),
        ({"end_s": 10.0}, "end_s must lie behind begin_s 300 s; given 10"),
        ({"kind": "fire"}, "kind"),
        ({"buffer": "vehicle"}, "buffer"),
    ],
)
def test_a_wrong_fault_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        _scenario({**LEAK, **change})


def test_the_size_of_a_sensors_fault_is_in_its_unit():
    with pytest.raises(InputError, match=r"offset_k must be given where sensor is temperature_high|offset_bar must be"):
        _scenario({"kind": "sensor_offset", "sensor": "temperature_high", "begin_s": 0.0, "offset_bar": 5.0})


def test_what_a_plant_cannot_have_is_refused():
    with pytest.raises(InputError, match=r"whose plant is 'thesis'.*given 'precooler_weak'"):
        _scenario({"kind": "precooler_weak", "begin_s": 0.0, "warmer_k": 5.0})
    with pytest.raises(InputError, match="idle_period_s must be 1"):
        _scenario(LEAK, idle_period_s=5)


def _measured(*faults, column, seed=1):
    table = measured_day(_run(*faults), seed, missing=0.0)
    return table["time_s"].to_numpy(), table[column].to_numpy(zero_copy_only=False)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ({"kind": "sensor_offset", "offset_bar": 7.0}, lambda since: 7.0 + 0 * since),
        ({"kind": "sensor_drift", "drift_bar_per_h": 36.0}, lambda since: since / 100),
    ],
)
def test_a_sensor_is_off_by_what_its_fault_says(fault, error):
    fault = {**fault, "sensor": "pressure_low", "begin_s": 200.0, "end_s": 500.0}
    time, healthy = _measured(column="pressure_low")
    _, faulty = _measured(fault, column="pressure_low")
    expected = np.where((time >= 200) & (time < 500), error(time - 200), 0.0)
    np.testing.assert_allclose(faulty - healthy, expected, atol=1e-9)
    other = {"sensor": "pressure_high"}
    np.testing.assert_array_equal(_measured({**fault, **other}, column="pressure_low")[1], healthy)


def test_frozen_absent_and_noisy_sensors():
    where = {"sensor": "pressure_low", "begin_s": 200.0, "end_s": 500.0}
    time, healthy = _measured(column="pressure_low")
    there = (time >= 200) & (time < 500)
    frozen = _measured({"kind": "sensor_frozen", **where}, column="pressure_low")[1]
    assert np.unique(frozen[there]).tolist() == [healthy[200]]
    absent = _measured({"kind": "sensor_absent", **where}, column="pressure_low")[1]
    assert np.isnan(absent[there]).all()
    noisy = _measured({"kind": "sensor_noisy", "noise_bar": 5.0, **where}, column="pressure_low")[1]
    assert np.std((noisy - healthy)[there]) == pytest.approx(5.0, rel=0.15)
    for changed in (frozen, absent, noisy):
        np.testing.assert_array_equal(changed[~there], healthy[~there])


@pytest.mark.parametrize("skew", [3, -4])
def test_a_fast_clock_moves_the_samples_of_transmitters(skew):
    fault = {"kind": "clock_skew", "begin_s": 0.0, "skew_s": skew}
    time, healthy = _measured(column="pressure_low")
    _, moved = _measured(fault, column="pressure_low")
    inside = (time + skew >= 0) & (time + skew <= time[-1])
    np.testing.assert_array_equal(moved[(time[inside] + skew).astype(int)], healthy[inside])
    np.testing.assert_array_equal(_measured(fault, column="inlet_high")[1], _measured(column="inlet_high")[1])


def test_a_measured_day_is_one_that_can_be_read():
    frames = frames_of(samples_of(measured_day(_run(), 4), tags_of_day()))
    assert len(frames) == len(_run()) - 1
    assert load_station("thesis-fit").plant == "thesis"


def test_events_are_scored_against_the_truth(tmp_path):
    frozen = {"kind": "sensor_frozen", "sensor": "pressure_low", "begin_s": 50.0}
    file = tmp_path / "truth.parquet"
    _run(LEAK, frozen).to_parquet(file)
    faults = load_truth(file)
    events = [
        Event("leak_medium", 290.0, 340.0, 0.6, "g/s"),
        Event("leak_medium", 390.0, 500.0, 0.4, "g/s"),  # repeats it
        Event("leak_medium", 0.0, 200.0, 0.4, "g/s"),  # before it began
        Event("leak_high", 290.0, 350.0, 0.3, "g/s"),
    ]
    found = score(events, faults, tags_of_day(), load_station("thesis-fit"))
    assert (found["found"], found["missed"], found["false"]) == (1, 1, 2)
    assert found["false_events"] == ["leak_medium", "leak_high"]
    leak, still = found["faults"]
    assert (leak["delay_s"], leak["begin_error_s"], leak["size_error"]) == (40.0, -10.0, pytest.approx(0.1))
    assert (still["name"], still["found"], still["delay_s"]) == ("frozen_pressure_low", False, None)


@pytest.mark.parametrize(
    ("fault", "lacking", "calibrated", "why"),
    [
        ({"kind": "leak", "buffer": "high", "rate_g_per_s": 1.0}, None, False, None),
        ({"kind": "leak", "buffer": "high", "rate_g_per_s": 1.0}, "pressure_high", True, "whose pressure no tag tells"),
        ({"kind": "leak", "buffer": "high", "rate_g_per_s": 1.0}, "pressure_low", True, None),
        ({"kind": "line_leak", "rate_g_per_s": 1.0}, "pressure_low", True, "whose pressure no tag tells"),
        ({"kind": "sensor_frozen", "sensor": "temperature_low"}, "temperature_low", True, "no tag tells"),
        ({"kind": "sensor_drift", "sensor": "pressure_low", "drift_bar_per_h": 3.0}, None, False, "was calibrated"),
        ({"kind": "sensor_drift", "sensor": "pressure_low", "drift_bar_per_h": 3.0}, None, True, None),
        ({"kind": "sensor_drift", "sensor": "flow_compressor", "drift_g_per_s_per_h": 3.0}, None, False, None),
        ({"kind": "sensor_drift", "sensor": "pressure_vehicle", "drift_bar_per_h": 3.0}, None, True, "of its own"),
        ({"kind": "clock_skew", "skew_s": 3}, None, False, None),
    ],
)  # fmt: skip
def test_a_fault_that_no_twin_can_tell_is_said_to_be_one(fault, lacking, calibrated, why):
    tags = TagMap(tags=[tag for tag in tags_of_day().tags if tag.sensor != lacking])
    (given,) = parse_scenario({**load_scenario("S1").model_dump(), "faults": [{**fault, "begin_s": 60.0}]}).faults
    station = load_station("thesis-fit").model_copy(update={"calibrated": calibrated})
    told = untold(given, tags, station)
    assert (told is None) == (why is None)
    assert why is None or why in told
    (judged,) = score([], [given], tags, station)["faults"]
    assert judged["untold"] == told


def test_nobody_can_tell_that_a_tag_told_when_it_changes_is_silent():
    absent = SensorAbsent(kind="sensor_absent", sensor="flow_compressor", begin_s=60.0)
    tags = [tag.model_copy(update={"on_change": tag.sensor == absent.sensor}) for tag in tags_of_day().tags]
    assert "silent" in untold(absent, TagMap(tags=tags), load_station("thesis-fit"))
    assert untold(absent, tags_of_day(), load_station("thesis-fit")) is None


def test_a_truth_without_faults_is_refused(tmp_path):
    file = tmp_path / "truth.toml"
    file.write_text("name = 'none'\n")
    with pytest.raises(InputError, match="faults"):
        load_truth(file)


def test_every_sensor_with_an_error_may_fail():
    assert get_args(Analog) == ANALOG


def test_a_shipped_scenario_has_no_fault():
    assert load_scenario("S1").faults == []


FAULTS_OF_PLANT = st.one_of(
    st.builds(
        lambda buffer, rate: {"kind": "leak", "buffer": buffer, "rate_g_per_s": rate},
        st.sampled_from(BUFFERS), st.floats(0.01, 100),
    ),
    st.builds(lambda loss: {"kind": "compressor_weak", "loss_percent": loss}, st.floats(1, 99)),
    st.builds(lambda loss: {"kind": "dispenser_clogged", "loss_percent": loss}, st.floats(1, 99)),
    st.just({"kind": "compressor_tripped"}),
)  # fmt: skip


@pytest.mark.slow
@samples(
    3, 30, kinds=st.lists(FAULTS_OF_PLANT, min_size=1, max_size=4),
    times=st.lists(st.tuples(st.integers(0, 2000), st.none() | st.integers(1, 900)), min_size=4, max_size=4),
    name=st.sampled_from(["logic", "minlp1"]),
)  # fmt: skip
def test_compiled_and_called_give_identical_bytes(kinds, times, name):
    faults = [
        {**kind, "begin_s": float(begin), "end_s": None if length is None else float(begin + length)}
        for kind, (begin, length) in zip(kinds, times, strict=False)
    ]
    scenario = _scenario(*faults)
    compiled, called = simulate(scenario, create(name)), simulate(scenario, Called(create(name)))
    assert compiled.timing.decisions is None
    assert compiled.to_bytes() == called.to_bytes()
