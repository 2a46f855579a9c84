"""One hidden day for all: simulated once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from station.parameters import Station
from station.record import Record
from tests.station.estimation.hidden import day, hidden_real_station, hidden_station, truth
from tests.station.estimation.sensors import CARS, LEAKS, SECONDS, STATIONS


class Hidden(NamedTuple):
    station: Station
    record: Record
    true: dict[str, np.ndarray]


@pytest.fixture(scope="session")
def hidden() -> Hidden:
    """A station 15 % off and its day."""
    station = hidden_station(1)
    record = day(station)
    return Hidden(station, record, truth(record, 86_400))


@pytest.fixture(scope="session")
def near() -> Hidden:
    """A station 0.5 % off, in another air temperature, and its day: what the robust filter must bear."""
    station = hidden_station(3, spread=0.005, ambient=5.0)
    record = day(station)
    return Hidden(station, record, truth(record, 86_400))


@pytest.fixture(scope="session")
def hidden_real() -> Hidden:
    """A station of real gas 15 % off, in air 1.9 K colder than its file says, and its day."""
    station = hidden_real_station(1)
    record = day(station)
    return Hidden(station, record, truth(record, 86_400))


@pytest.fixture(scope="session")
def records() -> dict[tuple[str, bool], Record]:
    """A day of each plant's station 0.5 % off, healthy and with a leak of 0.5 g/s."""
    leak = {"kind": "leak", "buffer": "medium", "rate_g_per_s": 0.5, "begin_s": LEAKS, "end_s": SECONDS}
    slightly_off = {name: make(3, spread=0.005) for name, make in STATIONS.items()}
    return {
        (name, bool(faults)): day(station, CARS, SECONDS, faults=faults)
        for name, station in slightly_off.items()
        for faults in ([], [leak])
    }
