"""Foreign units in the plant's place: other names and units, our own back to the bit, and what is wrong by name."""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from api.bridges.fmi import export
from api.bridges.fmi.foreign_run import ForeignRun
from api.bridges.fmi.foreign_unit import ForeignUnit, UnitError, describe
from api.bridges.fmi.unit_map import UnitMap, load_map
from api.client import Service
from controllers import create
from station import InputError, load_scenario, parse_scenario, simulate
from station.geometry import VALVES
from station.record import Record
from tests.api.bridges.fmi.foreign import MAP, build
from tests.api.conftest import RunningService
from tests.api.here import hrs
from tests.api.test_cli_send import HRS
from tests.waiting import wait_until

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no C compiler")


@pytest.fixture(scope="module", params=[2, 3])
def foreign(request, tmp_path_factory):
    """A unit of somebody else, of either version."""
    return build(tmp_path_factory.mktemp("foreign"), request.param)


@pytest.fixture
def given(tmp_path):
    """Writes a map, with replacements, and loads it."""

    def write(*replaced: tuple[str, str]) -> UnitMap:
        text = MAP
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "map.toml").write_text(text)
        return load_map(tmp_path / "map.toml")

    return write


def few():
    """Three cars, two of which come at once."""
    cars = [
        {"time_s": when, "start_pressure_bar": bar, "volume_m3": 0.15}
        for when, bar in ((5, 300.0), (6, 450.0), (200, 500.0))
    ]
    return parse_scenario({"name": "few", "station": "thesis-fit", "arrivals": {"kind": "trace", "vehicles": cars}})


def busy():
    """The station of S3 for an hour and a half, with a row a second."""
    shown = load_scenario("S3").model_dump(mode="json", exclude_none=True)
    arrivals = {"kind": "uniform", "count": 12, "period_s": 5400.0}
    return parse_scenario({**shown, "arrivals": arrivals, "time_limit_s": 7000.0, "idle_period_s": 1})


def run(unit, controller="logic", scenario=None, **options):
    with ForeignUnit(unit, **options) as plant:
        return ForeignRun(scenario or few(), create(controller), plant).run()


OWN_FILE = Path(__file__).parents[4] / "docs" / "examples" / "fmi" / "own.toml"
OWN = load_map(OWN_FILE)
"""The map of a unit of ours."""


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("controller", ["logic", "minlp1"])
def test_our_own_unit_gives_the_record_of_the_simulation_to_the_bit(tmp_path, version, controller):
    scenario = busy()
    path = tmp_path / "own.fmu"
    path.write_bytes(export.fmu(scenario.station, version))
    found = run(describe(path, OWN, "map"), controller, scenario)
    expected = simulate(scenario, create(controller))
    assert np.isfinite(found.vehicles["finished"]).sum() == 12
    assert found.to_bytes() == expected.to_bytes()


def test_masses_and_flows_may_be_missing(tmp_path):
    scenario = busy()
    path = tmp_path / "own.fmu"
    path.write_bytes(export.fmu(scenario.station, 3))
    shown = {name: each for name, each in OWN.outputs.items() if not name.startswith(("mass", "flow"))}
    found = run(describe(path, OWN.model_copy(update={"outputs": shown}), "map"), "logic", scenario)
    expected = simulate(scenario, create("logic"))
    for name in (*VALVES, "vehicle", "pressure_high", "temperature_vehicle"):
        assert np.array_equal(found[name], expected[name], equal_nan=True), name
    assert np.nanmax(np.abs(found["mass_low"] / expected["mass_low"] - 1)) < 1e-12
    assert np.isnan(found["flow_dispenser"][:-1]).all()


def test_a_foreign_unit_is_driven_in_its_own_units(foreign, given):
    record = run(describe(foreign, given(), "map"))
    assert [record[f"pressure_{name}"][0] for name in ("high", "medium", "low")] == pytest.approx([900, 700, 500])
    assert record["temperature_high"][0] == pytest.approx(290 - 273.15)
    assert np.isfinite(record.vehicles["finished"]).all()
    assert (record.vehicles["final_pressure"] >= record.vehicles["finish_pressure"]).all()
    for vehicle in range(3):  # each begins as the scenario says, also the one that follows another at once
        first = int(np.flatnonzero(record["vehicle"] == vehicle)[0])
        assert record["pressure_vehicle"][first] == record.vehicles["start_pressure"][vehicle]
        assert record["pressure_vehicle"][first + 1] < record["pressure_vehicle"][first] + 30
    assert record["temperature_vehicle"][np.flatnonzero(record["vehicle"] >= 0)] == pytest.approx(
        record.vehicles["start_temperature"][0]
    )
    # The gas of the unit's own equations: what flowed to the cars is what they hold more.
    warm = record.vehicles["start_temperature"][0] + 273.15
    gas = 100000 * 0.15 / (8.314462618 / 2.01588e-3 * warm) * 1000  # g a bar
    more = (record.vehicles["final_pressure"] - record.vehicles["start_pressure"]) * gas
    assert record.vehicles["delivered"] == pytest.approx(more, rel=1e-6)
    working = record["inlet_high"] + record["inlet_medium"] + record["inlet_low"]
    assert record["flow_compressor"] == pytest.approx(40.0 * working)


def test_its_parameters_are_set(foreign, given):
    record = run(describe(foreign, given(("[inputs]", '[parameters]\n"p.start" = 80000.0\n\n[inputs]')), "map"))
    assert record["pressure_high"][0] == pytest.approx(800)


@pytest.mark.parametrize(
    ("replaced", "field", "message"),
    [
        (('"p.HP"', '"p.hp"'), "outputs.pressure_high.variable", "has p.HP, p.MP"),
        (('"p.HP"', '"fill.HP"'), "outputs.pressure_high.variable", "causality output or local; 'fill.HP' is input"),
        (('"fill.HP"', '"p.HP"'), "inputs.inlet_high.variable", "causality input; 'p.HP' is output"),
        (('"p.HP" }', '"p.HP", unit = "bar" }'), "outputs.pressure_high.unit", "kPa, as the unit's description"),
        (('"p.HP" }', '"T.HP" }'), "outputs.pressure_high.unit", "dimension of bar; given 'K'"),
        ((', unit = "degC"', ""), "outputs.temperature_vehicle.unit", "must be given, as degC"),
        (('"degC"', '"furlong"'), "outputs.temperature_vehicle.unit", "dimension of degC; given 'furlong'"),
        (('"car.number" }', '"car.number", unit = "bar" }'), "inputs.vehicle_number.unit", "must be left out"),
        (('vehicle_number = { variable = "car.number" }', ""), "inputs", "must have vehicle_connected or vehicle_num"),
        (('pressure_low = { variable = "p.LP" }', ""), "outputs", "must have pressure_low"),
        (
            ('"fill.MP"', '"fill.HP"'),
            "inputs.inlet_medium.variable",
            "must be another variable than that of inlet_high",
        ),
        (("flow_compressor =", "flow_pump ="), "outputs.flow_pump", "must be one of pressure_high"),
        (("[inputs]", '[parameters]\n"p.LP" = 1.0\n[inputs]'), "parameters.p.LP", "of causality parameter"),
    ],
)
def test_a_map_that_does_not_fit_is_named(foreign, given, replaced, field, message):
    with pytest.raises(InputError) as caught:
        describe(foreign, given(replaced), "map.toml")
    assert caught.value.source == "map.toml"
    [(where, what)] = caught.value.problems
    assert (where, message in what) == (field, True), what


def test_every_problem_is_named_at_once(foreign, given):
    with pytest.raises(InputError) as caught:
        describe(foreign, given(('"p.HP"', '"x"'), ('"T.LP"', '"y"')), "map.toml")
    assert [field for field, _ in caught.value.problems] == [
        "outputs.pressure_high.variable",
        "outputs.temperature_low.variable",
    ]


def test_what_is_no_unit_for_this_machine_is_named(tmp_path, foreign, given):
    (tmp_path / "none.fmu").write_text("no archive")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for path, message in [
        (tmp_path / "none.fmu", "no ZIP archive"),
        (tmp_path / "missing.fmu", "cannot be read"),
        (build(elsewhere, 2, platform="win64"), "must have one for linux64, this platform; given win64"),
    ]:
        with pytest.raises(InputError, match=message):
            describe(path, given(), "map")


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (1, "at 20 s: has crashed: its process ended with signal SIGSEGV"),
        (2, "at 20 s: has not answered for 2 s"),
        (3, r"at 20 s: the unit refuses: fmi[23]DoStep failed with status 3 \(error\).\n  the second bank is stuck$"),
        (4, "pressure_medium, its variable 'p.MP', must lie within 0 and 2000 bar; given -0.01"),
        (5, "at 20 s: has crashed: its process ended with status 7"),
    ],
)
def test_a_unit_that_misbehaves_ends_the_run_and_nothing_else(foreign, given, how, message):
    parameters = f'[parameters]\n"bad.how" = {how}.0\n"bad.when" = 19.2\n\n[inputs]'
    unit = describe(foreign, given(("[inputs]", parameters)), "map")
    began = time.monotonic()
    with pytest.raises(UnitError, match=message if how == 3 else re.escape(message)):
        run(unit, patience_s=2.0)
    assert time.monotonic() - began < 20


def test_a_unit_that_hangs_does_not_outlive_who_started_it(tmp_path, given):
    unit = build(tmp_path, 2)
    given(("[inputs]", '[parameters]\n"bad.how" = 2.0\n"bad.when" = 3.2\n\n[inputs]'))
    command = [HRS, "import", "fmu", unit, "--map", tmp_path / "map.toml", "--scenario", "S1", "--timeout", "3600"]
    running = subprocess.Popen([str(part) for part in command], stderr=subprocess.DEVNULL)
    host = Path(f"/proc/{running.pid}/task/{running.pid}/children")
    loaded = lambda pid: "foreign.so" in Path(f"/proc/{pid}/maps").read_text()  # noqa: E731
    try:
        wait_until(lambda: any(loaded(pid) for pid in host.read_text().split()))
        [pid] = [pid for pid in host.read_text().split() if loaded(pid)]
        time.sleep(1.0)  # the fourth second is begun
    finally:
        running.kill()
        running.wait()
    wait_until(lambda: not Path(f"/proc/{pid}").exists())


def test_a_step_that_it_does_not_take_is_named(foreign, given):
    with pytest.raises(UnitError, match=r"at 1 s: the unit refuses: fmi[23]DoStep failed with status 3"):
        run(describe(foreign, given(("steps_per_second = 2", "steps_per_second = 1")), "map"))


def test_a_unit_may_say_that_it_ends(tmp_path, given):
    unit = build(tmp_path, 3)
    parameters = '[parameters]\n"bad.how" = 6.0\n"bad.when" = 19.2\n\n[inputs]'
    with pytest.raises(UnitError, match="at 20 s: the unit refuses: the unit ends the simulation"):
        run(describe(unit, given(("[inputs]", parameters)), "map"))


def test_what_is_the_units_own_is_refused(foreign, given):
    unit = describe(foreign, given(), "map")
    real = parse_scenario({**few().model_dump(mode="json", exclude_none=True), "station": "h70-light"})
    with ForeignUnit(unit) as plant, pytest.raises(InputError, match="real-gas"):
        ForeignRun(real, create("logic"), plant)
    leaking = {"kind": "leak", "buffer": "low", "begin_s": 1.0, "rate_g_per_s": 1.0}
    faulty = parse_scenario({**few().model_dump(mode="json", exclude_none=True), "faults": [leaking]})
    with ForeignUnit(unit) as plant, pytest.raises(InputError, match="the unit's own"):
        ForeignRun(faulty, create("logic"), plant)


def test_the_command_prints_figures_and_writes_the_record(tmp_path, foreign, given):
    given()
    day = tmp_path / "few.csv"
    day.write_text("time_s,start_pressure_bar,volume_m3\n5,300,0.15\n6,450,0.15\n200,500,0.15\n")
    done = hrs(
        "import", "fmu", foreign, "--map", tmp_path / "map.toml", "--scenario", day, "--out", "r.parquet", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "vehicles_not_finished" in done.stdout
    record = Record.from_parquet(tmp_path / "r.parquet")
    assert np.isfinite(record.vehicles["finished"]).all()
    done = hrs("import", "fmu", foreign, "--map", tmp_path / "none.toml", "--scenario", day)
    assert (done.returncode, "none.toml" in done.stderr) == (2, True), done.stderr
    done = hrs("import", "fmu", foreign, "--map", tmp_path / "map.toml", "--scenario", day, "--speed", "60")
    assert (done.returncode, "--speed needs --twin" in done.stderr) == (2, True), done.stderr


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    done = hrs("import", "fmu", "a.fmu", "--map", "b.toml", "--scenario", "S1")
    assert (done.returncode, "pip install hrs-twin[fmi]" in done.stderr) == (2, True), done.stderr


@pytest.mark.slow
def test_a_twin_follows_the_unit(tmp_path, given):
    running = RunningService(tmp_path / "data", "--workers", "0")
    try:
        unit = build(tmp_path, 3)
        given()
        arguments = ("--scenario", "S4", "--twin", "pilot", "--speed", "200", "--url", running.url)
        scenario = parse_scenario({**busy().model_dump(mode="json", exclude_none=True), "name": "busy"})
        (tmp_path / "busy.json").write_text(scenario.model_dump_json(exclude_none=True))
        (tmp_path / "own.fmu").write_bytes(export.fmu(scenario.station, 3))
        where = ("--twin", "pilot", "--speed", "2000", "--url", running.url, "--out", "r.parquet")
        done = hrs("import", "fmu", "own.fmu", "--map", OWN_FILE, "--scenario", "busy.json", *where, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        record = Record.from_parquet(tmp_path / "r.parquet")
        with Service(url=running.url) as service:
            twin = service.twin("pilot")
            wait_until(lambda: twin.state()["samples"] >= len(record) - 10)
            history = twin.history(from_s=0, to_s=4999)
            rows = slice(0, 5000)
            measured, expected = history["measured_pressure_high"][rows], record["pressure_high"][rows]
            assert np.array_equal(measured, expected[: len(measured)])
            # It is the station that the filter knows: what it expects is what is measured.
            held = history["estimate_mass_high"] - record["mass_high"][: len(measured)]
            assert np.nanmax(np.abs(held)) < 0.01 * record["mass_high"].max()
            assert np.nanmax(np.abs(history["innovation_pressure_high"])) < 6
        # A unit that crashes takes nothing of the service with it.
        given(("[inputs]", '[parameters]\n"bad.how" = 1.0\n"bad.when" = 30.2\n\n[inputs]'))
        done = hrs("import", "fmu", unit, "--map", tmp_path / "map.toml", *(*arguments[:3], "crashed", *arguments[4:]))
        assert (done.returncode, "signal SIGSEGV" in done.stderr) == (2, True), done.stderr
        assert "twin crashed has" in done.stdout
        with Service(url=running.url) as service:
            assert service.twin("crashed").state()["state"] == "running"
            assert service.twin("pilot").state()["state"] == "running"
    finally:
        running.stop()
