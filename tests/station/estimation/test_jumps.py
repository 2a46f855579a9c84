"""A sensor of a buffer that is off all at once is told as such, and by nothing else, for as long as it is."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.drills import OFF, VEHICLES
from benchmarks.following import HALF_DAY, WIDTH, told
from benchmarks.measured_forecasts import drawn_station, measured
from controllers import create_from
from station import load_station, parse_scenario, simulate
from station.batches import batches_of
from station.estimation.filter import follow
from station.estimation.followed import FollowedRun
from station.estimation.jumps import SURE, jumps_of_nothing, nearer_gate, note_jump
from station.geometry import BUFFERS
from station.measured_day import measured_day, tags_of_day

BEGIN, END = 15_000.0, 25_000.0
GATE = 6.0


def day_with(preset, sensor, size, seed, end=None, controller="logic"):
    """Half a day of a drawn station whose sensor is off, as it is measured, and its true record."""
    hidden = drawn_station(preset, seed, OFF / WIDTH)
    law = {"kind": "uniform", "count": VEHICLES // 2, "period_s": float(HALF_DAY)}
    unit = "offset_bar" if sensor.startswith("pressure") else "offset_k"
    fault = {"kind": "sensor_offset", "sensor": sensor, unit: size, "begin_s": BEGIN, "end_s": end}
    given = {"name": "jump", "station": hidden.model_dump(mode="json"), "arrivals": law, "faults": [fault]}
    scenario = parse_scenario({**given, "time_limit_s": float(HALF_DAY)})
    return simulate(scenario, create_from(controller), replication=seed, seed=seed)


def known(preset):
    return load_station(preset).model_copy(update={"calibrated": True})


@pytest.mark.parametrize("end", [None, END])
@pytest.mark.parametrize(
    ("preset", "sensor", "size", "seed"),
    [
        ("thesis-fit", "pressure_high", 10.0, 1),
        ("thesis-fit", "pressure_medium", -10.0, 11),
        ("thesis-fit", "pressure_low", 30.0, 2),
        ("thesis-fit", "temperature_high", -5.0, 1),
        ("h70-light", "pressure_medium", 10.0, 12),
        ("h70-light", "temperature_low", 4.0, 21),
    ],
)
def test_a_sensor_that_jumps_is_told_by_nothing_else(preset, sensor, size, seed, end):
    """Twenty leaks of its bank were told in the hours behind: what was refused at first came to be believed."""
    frames = measured(day_with(preset, sensor, size, seed, end), seed)
    events = told(frames, known(preset))
    assert [event.name for event in events] == [f"offset_{sensor}"]
    (event,) = events
    assert event.found_s - BEGIN <= 60
    assert event.size == pytest.approx(size, abs=1.0)


def test_masses_stay_known():
    record = day_with("thesis-fit", "pressure_high", 10.0, 1)
    followed = follow(measured(record, 1), known("thesis-fit"))
    for bank, name in enumerate(BUFFERS):
        error = followed.states[:, bank] - np.asarray(record[f"mass_{name}"])[: len(followed.states)]
        assert np.sqrt(np.mean(error[int(BEGIN) + 600 :] ** 2)) < 15.0  # g: of 10 bar it would be 90


def test_it_lasts_until_the_sensor_is_right_again():
    """Also through a snapshot."""
    record, tags = day_with("thesis-fit", "pressure_high", 10.0, 1, END), tags_of_day()
    table = measured_day(record, 1).slice(int(BEGIN) - 3000, 14_000)
    station = known("thesis-fit")
    run, lasts = FollowedRun(station, tags), {}
    for batch in batches_of(table, tags, 500.0):
        run.push(batch)
        run = FollowedRun.restore(station, tags, run.snapshot())
        lasts[run.next_second] = run.active
    during = [names for second, names in lasts.items() if second is not None and BEGIN + 600 < second < END]
    assert len(during) > 10
    assert set(during) == {("offset_pressure_high",)}
    assert lasts[max(second for second in lasts if second is not None)] == ()


def test_gas_that_nobody_counts_is_no_jump():
    """A pressure that goes on to fall is read again before it is far off; one that is off by the same is not."""
    for slope, taken in ((0.0, True), (0.2, False)):
        jumps, noise = jumps_of_nothing(), np.random.default_rng(3)
        for second in range(SURE + 5):
            error = 9.0 + slope * second - jumps[0, 0] + noise.normal()
            note_jump(jumps, 0, error, error, 1.0, nearer_gate(jumps, 0, 1.0, GATE), GATE)
        assert (jumps[0, 0] > 8.0) == taken
