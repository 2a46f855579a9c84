"""Scenario files: what is accepted, what is refused and how it is said, and the arrivals they make."""

from __future__ import annotations

import json
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station import InputError, load_scenario, load_station, parse_scenario, presets, scenarios
from station.traces import parse_trace

UNIFORM = {"kind": "uniform", "count": 3, "period_s": 100.0}


def test_shipped_scenarios_and_stations_load():
    assert {"S1", "S2", "S3", "S4"} <= set(scenarios())
    thesis = {"thesis-fit", "thesis-fit-cascade", "thesis-fit-a", "thesis-fit-b", "light-duty-700"}
    assert set(presets()) == thesis | {"h70-light", "h70-equal", "h35-bus", "h70-truck"}
    for name in scenarios():
        for station in presets():
            load_scenario(name).on(load_station(station))


def test_a_resolved_scenario_is_a_valid_file(tmp_path):
    scenario = load_scenario("S2")
    path = tmp_path / "mine.json"
    path.write_text(scenario.model_dump_json())
    assert load_scenario(path) == scenario


def test_a_station_can_be_a_preset_with_changes():
    given = {"name": "x", "arrivals": UNIFORM, "station": {"preset": "light-duty-700", "compressor": {"count": 2}}}
    station = parse_scenario(given).station
    assert station.compressor.count == 2
    assert station.compressor.power_kw == 65


def changed(**changes):
    document = load_scenario("S1").model_dump()
    for path, value in changes.items():
        place = document
        *above, last = path.split("__")
        for part in above:
            place = place[part]
        place[last] = value
    return document


@pytest.mark.parametrize(
    ("changes", "field", "limit"),
    [
        ({"arrivals__count": 0}, "arrivals.uniform.count", "greater than or equal to 1"),
        ({"arrivals__period_s": float("nan")}, "arrivals.uniform.period_s", "finite"),
        ({"station__buffers__low__volume_m3": 0.0}, "station.buffers.low.volume_m3", "greater than 0"),
        ({"station__buffers__low__initial_pressure_bar": 0.0}, "station.buffers.low.initial_pressure_bar", "greater"),
        ({"station__buffers__low__initial_pressure_bar": float("inf")}, "initial_pressure_bar", "finite"),
        ({"station__buffers__low__initial_pressure_bar": 960.0}, "buffers.low.initial_pressure_bar", "957.427"),
        ({"station__vehicle__finish_pressure_bar": 860.0}, "vehicle.finish_pressure_bar", "857.427"),
        ({"station__vehicle__start_pressure_bar": 699.0}, "finish_pressure_bar", "739"),
        ({"station__compressor__count": 0}, "station.compressor.count", "greater than or equal to 1"),
        ({"station__dispenser__flow_max_g_per_s": 4.0}, "dispenser.flow_max_g_per_s", "4.90914"),
        ({"station__vehicle__volume_m3": 0.0005}, "vehicle.volume_m3", "the limit is 1"),
        ({"station__buffers__high__volume_m3": 0.001}, "volume_m3", "the limit is 1"),
        ({"station__thermal__heat_exchange_per_s": -1.0}, "heat_exchange_per_s", "greater than or equal to 0"),
        ({"station__unknown_buffers": ["low", "low"]}, "unknown_buffers", "given low, low"),
        ({"station__volume_deviations_percent": {"low": -1.0}}, "volume_deviations_percent.low", "than or equal to 0"),
        ({"time_limit_s": 10.0}, "time_limit_s", "1000"),
        ({"idle_period_s": 0}, "idle_period_s", "greater than or equal to 1"),
        ({"surprise": 1}, "surprise", "not permitted"),
    ],
)
def test_a_wrong_field_is_named_with_its_limit(changes, field, limit):
    with pytest.raises(InputError) as caught:
        parse_scenario(changed(**changes))
    message = str(caught.value)
    assert field in message
    assert limit in message


def test_files_that_cannot_be_read_say_why(tmp_path):
    with pytest.raises(InputError, match="neither a scenario"):
        load_scenario("S9")
    with pytest.raises(InputError, match="cannot be read"):
        load_scenario(tmp_path / "none.toml")
    bad = tmp_path / "bad.toml"
    bad.write_text("name = ")
    with pytest.raises(InputError, match="cannot be parsed"):
        load_scenario(bad)


@pytest.mark.parametrize("name", ["\0", "day\0.csv", "\ud800", "a" * 5000, ".", "none.csv"])
def test_a_trace_whose_name_no_file_can_have_is_refused(tmp_path, name):
    path = tmp_path / "day.json"
    path.write_text(json.dumps({"name": "day", "arrivals": {"file": name}}))
    with pytest.raises(InputError, match=r"cannot be read: ."):
        load_scenario(path)


def test_a_csv_trace_names_line_and_column(tmp_path):
    path = tmp_path / "day.csv"
    path.write_text("time_s,start_pressure_bar,volume_m3\n0,100,0.12\n50,x,0.12\n60,100\n")
    with pytest.raises(
        InputError, match=r"day\.csv:3, start_pressure_bar: must be a number; given 'x'\n.*day\.csv:4: must have"
    ):
        load_scenario(path)
    path.write_text("time_s,pressure\n0,100\n")
    with pytest.raises(InputError, match=r"day\.csv:1: columns must be start_pressure_bar, time_s"):
        load_scenario(path)
    path.write_text("time_s,start_pressure_bar,volume_m3\n500,100,0.12\n0,150,\n")
    vehicles = load_scenario(path).vehicles()
    assert vehicles.arrival.tolist() == [0.0, 500.0]
    assert vehicles.start_pressure.tolist() == [150.0, 100.0]
    assert vehicles.volume.tolist() == [load_station("thesis-fit").vehicle.volume_m3, 0.12]


@pytest.mark.parametrize("text", ["time_s;start_pressure_bar\n0;100\n", "time_s\tstart_pressure_bar\n0\t100\n"])
def test_a_csv_trace_of_another_separator_says_so(tmp_path, text):
    (tmp_path / "day.csv").write_text(text)
    with pytest.raises(InputError, match="columns must be separated by commas"):
        load_scenario(tmp_path / "day.csv")


@pytest.mark.parametrize("cell", ["1_00", "\u0661\u0660\u0660"])
def test_what_only_python_takes_for_a_number_is_refused(cell):
    with pytest.raises(InputError, match=r"line 2, start_pressure_bar: must be a number"):
        parse_trace(f"time_s,start_pressure_bar\n0,{cell}\n")


def test_a_byte_order_mark_is_no_part_of_a_trace():
    assert parse_trace("\ufefftime_s,start_pressure_bar\n0,100\n").vehicles[0]["start_pressure_bar"] == 100


WRONG_ROWS = [
    ("60,9000", r", start_pressure_bar: Input should be less than or equal to 2000; given 9000\.0"),
    ("60,nan", r", start_pressure_bar: .*; given nan"),
    ("1e9,100", r", time_s: Input should be less than or equal to 604800; given 1000000000\.0"),
    ("60,900", r", start_pressure_bar must lie below the finish pressure .*; given 900"),
    ("60,100,0.12,5000", r", finish_pressure_bar: Input should be less than or equal to 2000; given 5000\.0"),
    ("60,100,0.12,880", r", finish_pressure_bar must lie below .*; given 880"),
    ("60,100,1e-9", r", volume_m3 and .*; given 1e-09"),
]


@pytest.mark.parametrize(("row", "says"), WRONG_ROWS)
@pytest.mark.parametrize("beside", [False, True])
def test_what_is_wrong_in_a_trace_is_named_with_file_line_and_column(tmp_path, row, says, beside):
    """Behind blank lines, and a scenario that names the trace."""
    columns = ["time_s", "start_pressure_bar", "volume_m3", "finish_pressure_bar"][: row.count(",") + 1]
    good = ",".join(["0", "100", "0.12", "690"][: len(columns)])
    (tmp_path / "day.csv").write_text("\n".join([",".join(columns), "", good, "", "", row, good]) + "\n")
    (tmp_path / "day.toml").write_text('name = "day"\n[arrivals]\nfile = "day.csv"\n')
    with pytest.raises(InputError, match=rf"day\.csv:6{says}"):
        load_scenario(tmp_path / ("day.toml" if beside else "day.csv"))


def test_patterns_of_the_four_scenarios():
    assert load_scenario("S1").vehicles().arrival.tolist() == [0, 250, 500, 750, 1000]
    s3 = load_scenario("S3").vehicles().arrival
    assert (s3[0], s3[-1], len(s3)) == (0, 43200, 96)
    law, z = NormalDist(), load_scenario("S2").arrivals.truncation
    low, high = law.cdf(-z), law.cdf(z)
    expected = [round((law.inv_cdf(low + (high - low) * k / 4) + z) / (2 * z) * 1000) for k in range(5)]
    assert load_scenario("S2").vehicles().arrival.tolist() == expected


ARRIVALS = [
    UNIFORM,
    {"kind": "normal", "count": 40, "period_s": 5000.0, "truncation": 2.0},
    {"kind": "poisson", "rate_per_h": 20.0, "period_s": 7200.0},
    {"kind": "profile", "count": 30, "hourly_weights": [0.0, 1.0, 3.0]},
    {"kind": "trace", "vehicles": [{"time_s": 3.0, "start_pressure_bar": 90.0}]},
]


@settings(max_examples=60)
@given(st.sampled_from(ARRIVALS), st.integers(0, 50), st.integers(0, 2**40))
def test_every_law_gives_vehicles_within_its_period(arrivals, replication, seed):
    scenario = parse_scenario({"name": "x", "arrivals": arrivals})
    vehicles = scenario.vehicles(replication, seed)
    again = scenario.vehicles(replication, seed)
    assert all(np.array_equal(one, two) for one, two in zip(vehicles, again, strict=True))
    assert (np.diff(vehicles.arrival) >= 0).all()
    assert vehicles.arrival.min() >= 0
    assert vehicles.arrival.max() <= round(scenario.arrivals.period_s)
    usual = scenario.station.vehicle
    if replication == 0 and arrivals["kind"] != "trace":
        assert set(vehicles.start_pressure) == {usual.start_pressure_bar}
    assert (vehicles.start_pressure < vehicles.finish_pressure).all()


def test_replications_differ_and_profile_follows_its_weights():
    scenario = load_scenario("S3")
    assert not np.array_equal(scenario.vehicles(1, 0).arrival, scenario.vehicles(2, 0).arrival)
    assert not np.array_equal(scenario.vehicles(1, 0).arrival, scenario.vehicles(1, 1).arrival)
    profile = {"kind": "profile", "count": 4000, "hourly_weights": [0, 1, 3]}
    arrival = parse_scenario({"name": "x", "arrivals": profile}).vehicles(1, 7).arrival
    hours = np.minimum(arrival, 10_799) // 3600
    assert np.bincount(hours.astype(int), minlength=3) / 4000 == pytest.approx([0, 0.25, 0.75], abs=0.03)


def test_json_of_a_scenario_has_no_unresolved_parameter():
    document = json.loads(load_scenario("S1").model_dump_json())
    assert document["time_limit_s"] == 2 * 1000 + 14_400
    assert document["station"]["name"] == "thesis-fit"


@pytest.mark.parametrize("name", ["S1", "S4"])
def test_a_scenario_at_another_station_is_the_one_that_was_moved_there(name):
    there = load_station("thesis-fit-a")
    assert load_scenario(name, there) == load_scenario(name).on(there)


def test_a_file_is_held_against_the_station_that_is_used(tmp_path):
    """A vehicle that the file's own station could not fill, and one that the other cannot."""
    trace, high = tmp_path / "high.csv", load_station("light-duty-700")
    usual = load_station("thesis-fit")
    finish = (usual.finish_pressure_max + high.finish_pressure_max) / 2
    assert usual.finish_pressure_max < finish < high.finish_pressure_max
    trace.write_text(f"time_s,start_pressure_bar,volume_m3,finish_pressure_bar\n0,50,0.14,{finish}\n")
    assert load_scenario(trace, high).vehicles(0, 0).finish_pressure.tolist() == [finish]
    with pytest.raises(InputError, match=r"high.csv:2, finish_pressure_bar must lie below 857"):
        load_scenario(trace)
    with pytest.raises(InputError, match=r"must lie below 440 bar, real_gas.bank_pressure_max_bar.high less"):
        load_scenario(trace, load_station("h35-bus"))
