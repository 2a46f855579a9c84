"""Records as they are stored: less than half the bytes, and every bit as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from api import packing
from api.packing import Basis, DamagedError, packed, packed_record, unpacked, vehicles_of, whole
from controllers import controllers, create
from station import load_scenario, load_station, simulate
from station.preset_files import presets

KEPT = Path(__file__).with_name("packed.parquet")
"""The first 200 rows of S1 under logic, packed by the version that began to pack."""

USUAL = ("thesis-fit", "h70-light")
"""Of each plant the preset at which slow controllers are tried; elsewhere with the full samples."""

SPEEDY = ("logic", "minlp1", "minlp2", "minlp3", "reserve", "switched")
"""Controllers whose S1 takes no time."""


def _record(preset, controller, scenario="S1"):
    return simulate(load_scenario(scenario).on(load_station(preset)), create(controller))


def _check(record):
    content = packed_record(record)
    columns = unpacked(content)
    assert list(columns) == list(record.columns)
    for name, column in columns.items():
        assert column.dtype == record[name].dtype, name
        assert column.tobytes() == np.ascontiguousarray(record[name]).tobytes(), name
    assert whole(content) == record.parquet()
    return content


@pytest.mark.parametrize("preset", presets())
@pytest.mark.parametrize("controller", SPEEDY)
def test_a_packed_record_is_the_record_bit_for_bit(preset, controller):
    _check(_record(preset, controller))


@pytest.mark.parametrize(
    "preset",
    [pytest.param(name, marks=pytest.mark.slow if name in USUAL else pytest.mark.full) for name in presets()],
)
@pytest.mark.parametrize("controller", sorted(set(controllers()) - set(SPEEDY)))
def test_so_it_is_under_controllers_that_take_their_time(preset, controller):
    _check(_record(preset, controller))


def test_a_day_takes_less_than_half_the_bytes():
    record = _record("thesis-fit", "logic", "S3")
    content = _check(record)
    assert len(content) < 0.45 * len(record.parquet())
    assert vehicles_of(content).keys() == record.vehicles.keys()
    for name, column in vehicles_of(content).items():
        np.testing.assert_array_equal(column, record.vehicles[name])


@pytest.mark.slow
def test_a_day_of_switched_takes_two_megabytes():
    """S3 is the thesis's longest; its plain file takes 4.5 MB."""
    assert len(packed_record(_record("thesis-fit", "switched", "S3"))) < 2_000_000


def test_columns_can_be_read_alone():
    record = _record("thesis-fit", "minlp1")
    content = packed_record(record)
    for name in record.columns:
        found = unpacked(content, ("time", name))
        assert list(found) == list(dict.fromkeys(("time", name)))
        assert found[name].tobytes() == np.ascontiguousarray(record[name]).tobytes()


def test_figures_that_follow_no_formula_are_kept():
    """Another plant, or a vehicle of another tank: nothing is taken for granted."""
    chance = np.random.default_rng(7)
    record = _record("thesis-fit", "logic")
    columns = {name: record[name].copy() for name in record.columns}
    for name in packing._RULES:
        wrong = chance.random(len(record)) < 0.3
        columns[name][wrong] = chance.standard_normal(wrong.sum())
    columns["pressure_low"][5:9] = [np.nan, -0.0, np.inf, 5e-324]
    for basis in (Basis.of(record.scenario.station, [0.1]), Basis.of(load_station("light-duty-700"))):
        found = unpacked(packed(columns, basis, {}))
        for name, column in columns.items():
            assert found[name].tobytes() == column.tobytes(), name


def test_no_rows_are_none():
    record = _record("thesis-fit", "logic")
    columns = {name: record[name][:0] for name in record.columns}
    found = unpacked(packed(columns, Basis.of(record.scenario.station), {}))
    assert all(len(column) == 0 for column in found.values())


def test_plain_files_of_older_versions_stay_readable():
    record = _record("thesis-fit", "logic")
    content = record.parquet()
    assert whole(content) == content
    for name, column in unpacked(content).items():
        assert column.tobytes() == np.ascontiguousarray(record[name]).tobytes()
    assert list(unpacked(content, ("time", "vehicle"))) == ["time", "vehicle"]


def test_what_was_packed_once_reads_the_same_for_ever():
    record = _record("thesis-fit", "logic")
    for name, column in unpacked(KEPT.read_bytes()).items():
        assert column.tobytes() == np.ascontiguousarray(record[name][:200]).tobytes(), name


def test_a_formula_that_has_changed_is_found_out(monkeypatch):
    content = packed_record(_record("thesis-fit", "logic"))
    monkeypatch.setattr(packing, "gas_pressure", lambda mass, temperature, volume: mass * temperature / volume)
    with pytest.raises(DamagedError, match="pressure_high"):
        unpacked(content)
    assert len(unpacked(content, ("time", "mass_high"))["time"]) > 0
