"""Sizes of events with their standard deviations, and what one bank loses to another."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import create_from
from station import load_station, parse_scenario, simulate
from station.estimation.detection import Event, detect
from station.estimation.filter import ROBUST, STATES, Followed, follow
from station.estimation.interface import KC, KD, LEAK
from station.frames import Frames, frames_of
from station.geometry import BUFFERS, TANKS
from station.measured_day import measured_day, tags_of_day
from station.measurement import samples_of
from station.sensor_names import ANALOG, SENSORS
from tests.station.estimation.hidden import hidden_real_station, hidden_station

SIZED = [
    ("leak", {"buffer": "high", "rate_g_per_s": 0.5}, "leak_high", 0.5, 0.06),
    ("leak", {"buffer": "medium", "rate_g_per_s": 1.0}, "leak_medium", 1.0, 0.06),
    ("compressor_weak", {"loss_percent": 25.0}, "compressor_weak", 25.0, 0.5),
    ("sensor_offset", {"sensor": "pressure_high", "offset_bar": 10.0}, "offset_pressure_high", 10.0, 1.0),
    ("sensor_offset", {"sensor": "temperature_low", "offset_k": 6.0}, "offset_temperature_low", 6.0, 0.3),
    ("sensor_noisy", {"sensor": "pressure_medium", "noise_bar": 4.0}, "noisy_pressure_medium", 4.0, 0.2),
    ("precooler_weak", {"warmer_k": 5.0}, "precooler_weak", 5.0, 1.2),
]


def told(name: str, kind: str, fault: dict, seed: int) -> list[Event]:
    """Events of a day at a station half a percent off."""
    station = (hidden_station if name == "thesis-fit" else hidden_real_station)(seed, 0.005, 0.0)
    arrivals = {"kind": "poisson", "rate_per_h": 6.0 if name == "thesis-fit" else 3.0, "period_s": 14_000.0}
    scenario = parse_scenario(
        {
            "name": "sizes", "station": station.model_dump(), "arrivals": arrivals, "time_limit_s": 14_000.0,
            "faults": [{"kind": kind, "begin_s": 6000.0, **fault}],
        }
    )  # fmt: skip
    record = simulate(scenario, create_from("switched"), replication=seed)
    frames, known = frames_of(samples_of(measured_day(record, seed), tags_of_day())), load_station(name)
    return detect(frames, follow(frames, known), known)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thesis-fit", "h70-light"])
def test_a_size_lies_within_three_of_its_deviations(name):
    """Seven faults, three stations each: and they are off by one deviation mostly."""
    off = []
    for kind, fault, event, true, most in SIZED:
        if kind == "precooler_weak" and name == "thesis-fit":
            continue
        for seed in (21, 22, 23):
            found = next(each for each in told(name, kind, fault, seed) if each.name == event)
            assert found.settled
            assert found.size_deviation is not None
            assert found.size_deviation < most
            off.append(abs(found.size - true) / found.size_deviation)
    assert max(off) < 3.0
    assert np.mean(np.array(off) < 1.0) > 0.6


def test_what_has_no_deviation_says_none():
    """A reading that is frozen, a sensor that is silent; and how far a clogged dispenser was learned."""
    for kind, fault in (
        ("sensor_frozen", {"sensor": "pressure_high"}),
        ("sensor_absent", {"sensor": "pressure_low"}),
        ("dispenser_clogged", {"loss_percent": 50.0}),
    ):
        events = [each for each in told("thesis-fit", kind, fault, 21) if each.name.startswith(fault_stem(kind))]
        assert events
        assert [each.size_deviation for each in events] == [None] * len(events)


def fault_stem(kind: str) -> str:
    return {"sensor_frozen": "frozen", "sensor_absent": "absent", "dispenser_clogged": "dispenser_clogged"}[kind]


@pytest.mark.parametrize(
    ("losses", "names"),
    [
        ((0.0, 0.2, 0.0), {"leak_medium"}),
        ((-0.2, 0.2, 0.0), set()),
        ((-0.02, 0.2, -0.02), {"leak_medium"}),
        ((-0.06, 0.2, -0.06), set()),
        ((0.2, 0.2, 0.2), {"leak_high", "leak_medium", "leak_low"}),
        ((-0.2, 0.6, 0.0), {"leak_medium"}),
    ],
)
def test_what_one_bank_loses_and_another_gains_is_no_leak(losses, names):
    rows = 1500
    states, deviations = np.zeros((rows, len(STATES))), np.full((rows, len(STATES)), 0.02)
    states[:, [KC, KD]] = 1.0
    states[900:, LEAK : LEAK + 3] = losses
    unread = np.full((rows, len(ANALOG)), np.nan)
    followed = Followed(states, deviations, unread, unread, ROBUST.gate)
    values = np.full((rows, len(SENSORS)), np.nan)
    values[:, : len(BUFFERS)] = np.random.default_rng(1).normal(500.0, 1.0, (rows, len(BUFFERS)))
    read = (values, np.ones((rows, len(ANALOG))), np.zeros(len(ANALOG)))
    found = detect(Frames(0.0, *read, SENSORS, np.zeros(len(TANKS))), followed)
    assert {event.name for event in found if event.name.startswith("leak")} == names
