"""The filter on a hidden station: consistent with true parameters, and undisturbed by what sensors do."""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from station import InputError
from station.estimation.filter import ROBUST, STATES, STIFF, follow
from station.estimation.verdict import fits_of, reasons
from station.frames import frames_of
from station.geometry import BUFFERS
from station.measurement import samples_of
from station.sensor_names import SENSORS
from tests.pace import slowness
from tests.station.estimation.hidden import measured, tags


@pytest.fixture(scope="module")
def frames(hidden):
    return frames_of(samples_of(measured(hidden.true, 1), tags()))


def test_with_true_parameters_it_is_consistent_and_knows_the_masses(hidden, frames):
    found = follow(frames, hidden.station, STIFF)
    fits = fits_of(found)
    assert len(fits) == 10
    assert reasons(fits) == []
    for place, name in enumerate(BUFFERS):
        off = found.states[600:, place] - hidden.record[f"mass_{name}"][600 : len(frames)]
        assert np.sqrt(np.mean(off**2)) < 2.0
        inside = np.abs(off) <= 1.96 * found.deviations[600:, place]
        assert inside.mean() > 0.85


@pytest.mark.timed
@pytest.mark.slow
def test_a_second_takes_little(hidden, frames):
    took = []
    for _ in range(4):  # the first of them may compile
        began = process_time()
        follow(frames, hidden.station, ROBUST)
        took.append((process_time() - began) / len(frames))
    assert min(took) < 5e-6 * slowness()


@pytest.mark.slow
def test_the_same_record_is_followed_the_same_way(hidden, frames):
    one, two = (follow(frames, hidden.station, ROBUST) for _ in range(2))
    assert one.states.tobytes() == two.states.tobytes()


@pytest.mark.parametrize("what", ["gap", "outliers", "nothing", "alternating"])
def test_whatever_sensors_do_the_states_stay_finite(hidden, frames, what):
    values = frames.values[:20_000].copy()
    rng = np.random.default_rng(5)
    if what == "gap":
        values[5000:9000] = np.nan
    elif what == "outliers":
        hit = rng.random(values.shape) < 0.05
        values[hit] = rng.uniform(0, 2000, hit.sum())
    elif what == "nothing":
        values[:] = np.nan
    else:
        values[::2] = np.nan
    part = frames.part(0, 20_000)
    odd = replace(part, values=values)
    found = follow(odd, hidden.station, ROBUST)
    buffers = [place for place, name in enumerate(STATES) if "vehicle" not in name]
    assert np.isfinite(found.states[:, buffers]).all()
    assert np.isfinite(found.deviations[:, buffers]).all()
    if what == "gap":
        error = found.states[9600:, 0] - hidden.record["mass_high"][9600:20_000]
        assert np.sqrt(np.mean(error**2)) < 10


def test_any_subset_of_sensors_is_followed(hidden, frames):
    values = frames.values.copy()
    for name in ("pressure_low", "temperature_high", "flow_compressor", "temperature_vehicle"):
        values[:, SENSORS.index(name)] = np.nan
    fewer = replace(frames, values=values)
    fits = fits_of(follow(fewer, hidden.station, STIFF))
    assert "pressure_low" not in fits
    assert reasons(fits) == []


def test_a_plant_that_no_model_follows_is_refused(frames, hidden):
    other = hidden.station.model_copy(update={"plant": "leaky"})
    with pytest.raises(InputError, match="must be one of real-gas, thesis: no other is followed; given 'leaky'"):
        follow(frames, other)
