"""CSV traces: files that scenarios name, and texts that are posted; vehicles, or line and column of what is wrong."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from pydantic import ValidationError

from api.scenarios.routes import read_trace as posted
from api.scenarios.schemas import TraceText
from station import InputError, load_scenario
from station.traces import parse_trace, read_trace
from tests.fuzz.documents import TEXTS, broken
from tests.fuzz.properties import Property
from tests.fuzz.scenarios import refused, simulated

DAY = (Path(__file__).parents[2] / "docs" / "examples" / "day.csv").read_bytes()

HEADERS = ("time_s", "start_pressure_bar", "volume_m3", "finish_pressure_bar")

cells = (
    st.floats(0, 90_000).map(repr) | st.floats().map(repr) | st.integers().map(str) | st.sampled_from(TEXTS)
    | st.sampled_from(("inf", "NaN", "1_0", "0x10", '"', '"1', "1;2", " 5 ", "٣", "1e5", "-0.0", "x" * 200_000))
    | st.text(max_size=6)
)  # fmt: skip


@st.composite
def tables(draw: Callable[[Any], Any]) -> bytes:
    """A table with a header that is nearly right, lines that nearly fit it, and ends of lines of any system."""
    header = draw(st.permutations(HEADERS).map(lambda names: names[: draw(st.integers(0, 4))]) | st.just(HEADERS[:2]))
    rows = draw(st.lists(st.lists(cells, min_size=max(0, len(header) - 1), max_size=len(header) + 1), max_size=6))
    end, between = (
        draw(st.sampled_from(("\n", "\r\n", "\r", "\u2028", "\n\n"))),
        draw(st.sampled_from((",", ", ", ";"))),
    )
    return end.join(between.join(row) for row in [header, *rows]).encode("utf-8", "surrogatepass")


TABLES = tables() | broken(DAY) | st.just(DAY) | st.binary(max_size=200)


def check_trace_file(content: bytes) -> None:
    """A file gives vehicles, alone and as a scenario, or is refused."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fuzzed.csv"
        path.write_bytes(content)
        try:
            vehicles = read_trace(path).vehicles
        except InputError as error:
            refused(error)
            return
        assert all({"time_s", "start_pressure_bar"} <= set(vehicle) for vehicle in vehicles)
        try:
            found = load_scenario(path)
        except InputError as error:
            refused(error)
            return
    assert len(found.vehicles().arrival) == len(vehicles)
    simulated(found)


def check_trace_text(content: bytes) -> None:
    """A text that is posted gives arrivals, or is the user's fault."""
    text = content.decode("utf-8", "surrogateescape")
    try:
        found = posted(TraceText(csv=text))
    except InputError as error:
        refused(error)
        return
    except ValidationError:  # a lone surrogate is no text
        return
    assert [vehicle.time_s for vehicle in found.vehicles] == [each["time_s"] for each in parse_trace(text).vehicles]


PROPERTIES = [Property("trace files", TABLES, check_trace_file), Property("trace texts", TABLES, check_trace_text)]
