"""The slot: finding controllers, their options, and the deadline of live use."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import pytest

from controllers import DeadlineController, controllers, create
from station import Decision, InputError, Observation, Status, load_scenario, load_station, simulate
from station.errors import StationError


def test_the_four_controllers_are_installed():
    assert {"logic", "minlp1", "minlp2", "minlp3"} <= set(controllers())


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("nobody", {}, "none is called 'nobody'; there are adaptive, guarded, logic"),
        ("minlp1", {"horizon": 0}, "horizon: Input should be greater than or equal to 1; given 0"),
        ("minlp1", {"horizons": 2}, "horizons: Extra inputs are not permitted"),
        ("minlp2", {"engine": "magic"}, "engine: Input should be 'exact', 'pyomo' or 'casadi'; given 'magic'"),
        ("logic", {"dispense": "all"}, "dispense: Input should be 'largest_gap', 'cascade' or 'lowest_label'"),
    ],
)
def test_wrong_options_are_named(name, options, message):
    with pytest.raises(InputError) as caught:
        create(name, **options)
    assert message in str(caught.value)


def test_settings_come_from_the_station_and_options_win():
    station = load_station("thesis-fit")
    assert create("logic").settings_for(station).dispense == "largest_gap"
    assert create("logic", dispense="cascade").settings_for(station).dispense == "cascade"
    assert create("minlp1").settings_for(load_station("thesis-fit-a")).liveness
    bare = station.model_copy(update={"controllers": {}})
    with pytest.raises(InputError, match=r"controllers.minlp:\n  target_pressure_bar: Field required"):
        create("minlp1").start(bare)


def test_deciding_before_a_start_is_an_error():
    observation = Observation(0.0, 1.0, (700.0,) * 3, (25.0,) * 3, -1, 0.0, 0.0, 0.14, True, 0, 0)
    with pytest.raises(StationError, match="must be started"):
        create("minlp1").decide(observation)


class Slow:
    """Answers only when let; fails on request."""

    name = "slow"
    obeys_hold = True

    def __init__(self):
        self.go = threading.Event()
        self.calls = 0

    def start(self, station):
        pass

    def decide(self, observation):
        self.calls += 1
        if observation.time == 2:
            self.go.wait(10)
        if observation.time == 5:
            raise RuntimeError("broken")
        return Decision(0)


def test_after_the_deadline_logic_decides(caplog):
    slow = Slow()
    guarded = DeadlineController(slow, 0.5)
    station = load_station("thesis-fit")
    guarded.start(station)
    logic = create("logic")
    logic.start(station)
    try:
        answers = {}
        for time in range(7):
            seen = Observation(float(time), 1.0, (700.0,) * 3, (25.0,) * 3, 0, 200.0, 25.0, 0.14, True, 0, 0)
            if time == 4:
                slow.go.set()
                guarded._pending.result(1)
            answers[time] = guarded.decide(seen)
        expected = logic.decide(seen).command
        late = [time for time, answer in answers.items() if answer.status == Status.FALLBACK]
        assert late == [2, 3, 5]
        assert {answers[time].command for time in late} == {expected}
        assert slow.calls == 6  # at 3 s it was still busy with 2 s
        assert "no answer within 0.5 s" in caplog.text
        assert "broken" in caplog.text
    finally:
        slow.go.set()
        guarded.close()


def test_the_deadline_follows_the_speed():
    assert DeadlineController.at_speed(Slow(), 0.5)._seconds == 1.0
    assert DeadlineController.at_speed(Slow(), 100)._seconds == 0.01
    with pytest.raises(InputError, match="seconds"):
        DeadlineController(Slow(), 0)


def test_a_guarded_controller_runs_and_the_record_says_who_decided():
    guarded = DeadlineController(create("minlp1"), 1.0)
    try:
        plain, record = simulate(load_scenario("S1"), create("minlp1")), simulate(load_scenario("S1"), guarded)
        assert record.to_bytes() == plain.to_bytes()
        assert (record["decision_status"][:-1] == Status.OPTIMAL).all()
    finally:
        guarded.close()


@pytest.mark.slow
def test_the_documented_plugin_is_found_and_runs(tmp_path):
    """Install the example by hand, as pip would: its module, and the metadata that names its entry point."""
    example = Path(__file__).parents[2] / "docs" / "examples" / "plugin"
    (tmp_path / "thrifty.py").write_text((example / "thrifty.py").read_text())
    project = tomllib.loads((example / "pyproject.toml").read_text())["project"]
    about = tmp_path / f"hrs_thrifty-{project['version']}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = project["entry-points"]["hrs.controllers"]
    (about / "entry_points.txt").write_text(
        "[hrs.controllers]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
    )
    hrs = Path(sys.executable).with_name("hrs")
    done = subprocess.run(
        [hrs, "compare", "S1", "--controllers", "logic,thrifty"], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "thrifty" in done.stdout
