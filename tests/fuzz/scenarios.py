"""Scenario and station files: each is a scenario that can be simulated, or refused with field, value and limit."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from controllers import create
from station import InputError, Scenario, load_scenario, load_station, scenarios
from station.live import AtEnd, LiveRun, SlotState
from station.station_files import load_station_file
from tests.fuzz.documents import as_json, as_toml, broken, mutated, values
from tests.fuzz.properties import Property

SECONDS = 5
"""A scenario that loads is simulated for so long [s]."""

LAWS: list[dict[str, Any]] = [
    {"kind": "uniform", "count": 5, "period_s": 1000.0},
    {"kind": "normal", "count": 9, "period_s": 1000.0},
    {"kind": "poisson", "rate_per_h": 12.0, "period_s": 7200.0},
    {"kind": "profile", "count": 7, "hourly_weights": [1.0, 4.0, 2.0]},
    {"kind": "trace", "vehicles": [{"time_s": 60.0, "start_pressure_bar": 120.0, "volume_m3": 0.14}]},
    {"file": "day.csv"},
]

GOOD: list[dict[str, Any]] = [
    *(load_scenario(name).model_dump(mode="json", exclude_none=True) for name in scenarios()),
    *({"name": "day", "arrivals": law, "time_limit_s": 90_000.0} for law in LAWS),
    {"name": "told", "arrivals": LAWS[0], "station": {"preset": "light-duty-700", "compressor": {"count": 2}}},
    {"name": "noisy", "arrivals": LAWS[2], "disturbance": {"sensors": "uniform", "plant": "corner", "seed": 7}},
]
STATIONS = [{"preset": "thesis-fit", "compressor": {"count": 2}}, load_station("thesis-fit").model_dump(mode="json")]


def files(good: list[dict[str, Any]]) -> st.SearchStrategy[tuple[str, bytes]]:
    """(suffix, content) of files that were good once."""
    written = {".json": as_json, ".toml": as_toml}
    documents = st.sampled_from(good).flatmap(mutated) | st.sampled_from(good)

    @st.composite
    def file(draw: Callable[[Any], Any]) -> tuple[str, bytes]:
        suffix = draw(st.sampled_from(sorted(written)))
        content = written[suffix](draw(documents))
        return suffix, draw(st.just(content) | broken(content))

    return file() | st.tuples(st.just(".json"), values.map(as_json))


def refused(error: InputError) -> None:
    """It says what is wrong, in words that fit a terminal."""
    assert error.problems
    assert all(message.strip() for _, message in error.problems)
    assert len(str(error)) < 200_000


def check_scenario_file(drawn: tuple[str, bytes]) -> None:
    """A file is a scenario that is written, read again and simulated, or is refused."""
    suffix, content = drawn
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"fuzzed{suffix}"
        path.write_bytes(content)
        path.with_name("day.csv").write_text("time_s,start_pressure_bar\n60,120\n")
        try:
            found = load_scenario(path)
        except InputError as error:
            refused(error)
            return
        again = path.with_name("again.json")
        again.write_text(found.model_dump_json())
        assert load_scenario(again).model_dump() == found.model_dump()
    simulated(found)


def simulated(scenario: Scenario) -> None:
    """Its first seconds, with figures that are numbers."""
    logic = create("logic")
    try:
        logic.start(scenario.known_station)
    except InputError as error:
        refused(error)
        return
    run = LiveRun(scenario, AtEnd.IDLE)
    for _ in range(SECONDS):
        second = run.step(SlotState(logic.decide))
        assert all(math.isfinite(figure) for figure in second.row[:4]), second.row


def check_station_file(drawn: tuple[str, bytes]) -> None:
    """A file is a station, or is refused."""
    suffix, content = drawn
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"fuzzed{suffix}"
        path.write_bytes(content)
        try:
            found = load_station_file(str(path))
        except InputError as error:
            refused(error)
            return
        path = path.with_suffix(".json")
        path.write_text(json.dumps(found.model_dump(mode="json")))
        assert load_station_file(str(path)) == found


PROPERTIES = [
    Property("scenario files", files(GOOD), check_scenario_file),
    Property("station files", files(STATIONS), check_station_file),
]
