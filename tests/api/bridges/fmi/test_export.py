"""Exported units, validated and run by FMPy: our kernel's bits, states kept and restored, and refusals by name."""

from __future__ import annotations

import math
import shutil
import subprocess
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from api.bridges.fmi import export
from api.bridges.fmi.variables import VARIABLES
from controllers import create
from station import load_scenario, load_station, simulate
from station.geometry import BUFFERS, TANKS, VALVES
from tests.api.here import hrs

SIZE_MAX = 50_000
"""Of a binary [bytes]."""

AT = {variable.name: place for place, variable in enumerate(VARIABLES)}

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no C compiler")


@pytest.fixture(scope="module", params=[2, 3])
def made(request, tmp_path_factory):
    """Version and path of the unit of S3's station."""
    path = tmp_path_factory.mktemp("fmu") / f"station{request.param}.fmu"
    path.write_bytes(export.fmu(load_scenario("S3").station, request.param))
    return request.param, path


class Unit:
    """A unit of either version behind the same words."""

    def __init__(self, version, path, folder) -> None:
        self.version = version
        description = fmpy.read_model_description(path)
        where = fmpy.extract(path, folder)
        kind = FMU2Slave if version == 2 else FMU3Slave
        token = description.guid if version == 2 else description.instantiationToken
        self.slave = kind(
            guid=token, unzipDirectory=where, modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="station",
        )  # fmt: skip
        self.slave.instantiate()
        if version == 2:
            self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        self.time = 0.0

    def set(self, **values) -> None:
        for name, value in values.items():
            if AT[name] < 7:
                self.slave.setBoolean([AT[name]], [bool(value)])
            else:
                (self.slave.setReal if self.version == 2 else self.slave.setFloat64)([AT[name]], [float(value)])

    def get(self, *names):
        places = [AT[name] for name in names]
        return (self.slave.getReal if self.version == 2 else self.slave.getFloat64)(places)

    def step(self, seconds=1.0) -> None:
        self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=seconds)
        self.time += seconds

    def close(self) -> None:
        self.slave.terminate()
        self.slave.freeInstance()


@pytest.fixture
def unit(made, tmp_path):
    opened = Unit(*made, str(tmp_path / "unzipped"))
    yield opened
    opened.close()


OUTPUTS = [f"{quantity}_{tank}" for quantity in ("pressure", "temperature", "mass") for tank in TANKS]


def drive(unit, record, begin, end):
    """Step a unit through seconds of a record with its valves and vehicles; what it showed after each."""
    found = []
    for row in range(begin, end):
        vehicle = int(record["vehicle"][row])
        if vehicle < 0 or (row and vehicle != record["vehicle"][row - 1]):
            unit.set(vehicle=False)
        if vehicle >= 0 and (row == 0 or vehicle != record["vehicle"][row - 1]):
            start = {name: record.vehicles[name][vehicle] for name in ("start_pressure", "start_temperature")}
            unit.set(**{f"vehicle_{name}": value for name, value in start.items()})
            unit.set(vehicle_volume=record.vehicles["volume"][vehicle], vehicle=True)
        unit.set(**{valve: record[valve][row] for valve in VALVES})
        unit.step()
        found.append(unit.get(*OUTPUTS, "flow_compressor", "flow_dispenser"))
    return np.array(found)


@pytest.fixture(scope="module")
def record():
    """A busy day under logic."""
    return simulate(load_scenario("S3"), create("logic"))


def check_bits(found, record, begin):
    """What a unit showed after each second is what the record has at the next, and the flows of the second."""
    end = begin + len(found)
    for place, name in enumerate(OUTPUTS):
        expected = record[name][begin + 1 : end + 1]
        if name.endswith("vehicle"):
            same = (record["vehicle"][begin:end] == record["vehicle"][begin + 1 : end + 1]) & ~np.isnan(expected)
            assert found[same, place].tobytes() == expected[same].tobytes(), name
        else:
            assert found[:, place].tobytes() == expected.tobytes(), name
    for place, name in enumerate(("flow_compressor", "flow_dispenser")):
        assert np.array_equal(found[:, len(OUTPUTS) + place], record[name][begin:end]), name


def test_it_is_valid_and_small(made):
    version, path = made
    assert validate_fmu(str(path)) == []
    with ZipFile(path) as archive:
        binaries = [each for each in archive.infolist() if each.filename.startswith("binaries/")]
        assert [each.file_size < SIZE_MAX for each in binaries] == [True]
        assert f"sources/fmi{version}.c" in archive.namelist()
    description = fmpy.read_model_description(str(path))
    assert [variable.name for variable in description.modelVariables][: len(VARIABLES)] == list(AT)
    assert description.coSimulation.canSerializeFMUstate


def test_5000_seconds_are_those_of_our_kernel(unit, record):
    assert list(unit.get(*(f"pressure_{name}" for name in BUFFERS))) == [
        record[f"pressure_{name}"][0] for name in BUFFERS
    ]
    found = drive(unit, record, 0, 5000)
    check_bits(found, record, 0)
    connected = (record["vehicle"][:5000] >= 0) & (record["vehicle"][1:5001] == record["vehicle"][:5000])
    assert connected.sum() > 1000  # vehicles were filled


def test_it_goes_on_from_a_state_that_was_kept(made, unit, record, tmp_path):
    drive(unit, record, 0, 1500)
    slave = unit.slave
    if unit.version == 2:
        state = slave.getFMUstate()
        content = slave.serializeFMUstate(state)
    else:
        state = slave.getFMUState()
        content = slave.serializeFMUState(state)
    expected = drive(unit, record, 1500, 2500)
    (slave.setFMUstate if unit.version == 2 else slave.setFMUState)(state)
    unit.time = 1500.0
    assert drive(unit, record, 1500, 2500).tobytes() == expected.tobytes()
    other = Unit(*made, str(tmp_path / "other"))  # in another instance, from bytes
    if unit.version == 2:
        restored = other.slave.deSerializeFMUstate(content)
        other.slave.setFMUstate(restored)
    else:
        restored = other.slave.deserializeFMUState(content)
        other.slave.setFMUState(restored)
    other.time = 1500.0
    assert drive(other, record, 1500, 2500).tobytes() == expected.tobytes()
    other.close()


def test_steps_of_many_seconds_and_other_initial_values(made, tmp_path):
    one, many = (Unit(*made, str(tmp_path / name)) for name in ("one", "many"))
    for unit in (one, many):
        unit.set(inlet_low=True)
    for _ in range(60):
        one.step()
    many.step(60.0)
    assert list(one.get(*OUTPUTS)) == list(many.get(*OUTPUTS))
    for unit in (one, many):
        unit.close()


@pytest.mark.parametrize(
    ("name", "value", "seconds"),
    [
        ("pressure_high", 1.0, 1.0), ("initial_pressure_high", 5.0, 1.0), ("vehicle_volume", 0.0, 1.0),
        ("vehicle_volume", math.inf, 1.0), ("", 0.0, 0.5), ("", 0.0, 1e300),
    ],
)  # fmt: skip
def test_what_is_wrong_is_an_error(unit, name, value, seconds):
    def wrong():
        if name:
            unit.set(**{name: value})
        if name == "vehicle_volume":
            unit.set(vehicle=True)
        unit.step(seconds)

    with pytest.raises(Exception, match=r"(?i)error|failed|status"):
        wrong()


@pytest.mark.parametrize("value", [-1.0, 0.0, 2000.1, math.inf, math.nan])
def test_buffers_that_begin_with_what_is_no_pressure_are_refused(made, tmp_path, value):
    messages = []
    with pytest.raises(Exception, match="status 3"):
        fmpy.simulate_fmu(
            str(made[1]), stop_time=1.0, step_size=1.0, start_values={"initial_pressure_low": value},
            logger=lambda *given: messages.append(given[-1]),
        )  # fmt: skip
    assert messages == [b"an initial pressure must be above 0 bar, and at most 2000"]


def test_another_plant_is_refused_by_name_and_so_is_a_machine_without_compiler(tmp_path, monkeypatch):
    done = hrs("export", "fmu", "h70-light", cwd=tmp_path)
    assert done.returncode == 2
    assert "given 'real-gas'" in done.stderr
    done = hrs("export", "fmu", "thesis-fit", "--version", "2", "--out", "x.zip", cwd=tmp_path)
    assert (done.returncode, "must end in .fmu" in done.stderr) == (2, True)
    done = hrs("export", "fmu", "thesis-fit", "--version", "2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first = (tmp_path / "thesis-fit-fmi2.fmu").read_bytes()
    assert first == export.fmu(load_station("thesis-fit"), 2)
    monkeypatch.setattr(export.shutil, "which", lambda _name: None)
    done = hrs("export", "fmu", "thesis-fit", cwd=tmp_path)
    assert (done.returncode, "needs a C compiler" in done.stderr) == (2, True), done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["thesis-fit-fmi2.fmu"]


def test_its_sources_compile_as_they_are_delivered(made, tmp_path):
    version, path = made
    with ZipFile(path) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    command = ["gcc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", f"fmi{version}.c"]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
