"""A plant's own columns in a twin's samples: as the record has them, and null where an older version kept none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api.http.timeseries import Fold
from api.packing import Basis, names_of, packed
from api.twins.journal import TwinJournal
from api.twins.messages import COLUMNS, Sample, sample_columns
from api.twins.minutes import minutes, thinned
from api.twins.segments import SENT, columns_of, decode, encode, history_columns, stored_columns
from controllers import create_from
from station import parse_scenario, simulate
from station.live import AtEnd, LiveRun
from station.plants.interface import plant_named
from tests.station.test_live import _rows, _seat

GAS = "real-gas"
OWN = list(plant_named(GAS).columns)
SCENARIO = parse_scenario(
    {
        "name": "two",
        "station": {"preset": "h70-light"},
        "arrivals": {"kind": "uniform", "count": 2, "period_s": 300.0},
        "idle_period_s": 1,
    }
)


@pytest.fixture(scope="module")
def rows():
    """Rows of a live run of SCENARIO, each told at some time."""
    run = LiveRun(SCENARIO, AtEnd.STOP)
    return [
        (*row, 1e9 + second)
        for second, row in enumerate(_rows(run, _seat(create_from("logic"), SCENARIO.station)).tolist())
    ]


def test_rows_are_those_of_the_record(rows):
    record = simulate(SCENARIO, create_from("logic"))
    expected = np.array([record[name] for name in sample_columns(GAS)], float).T
    assert np.array(rows)[:, :-1].tobytes() == expected.tobytes()


def test_they_survive_their_coding_bit_for_bit(rows):
    content = encode(rows, Basis.of(SCENARIO.station), GAS)
    assert names_of(content) == list(history_columns(GAS))
    assert np.array(decode(content, GAS)).tobytes() == np.array(rows).tobytes()
    part = Sample("gas", 1, 0, None, rows[40][:-1], layout=GAS).document()["values"]
    assert list(part) == list(sample_columns(GAS))
    assert part["state_of_charge_vehicle"] == rows[40][len(COLUMNS) + OWN.index("state_of_charge_vehicle")]


def test_minutes_have_them_too(rows):
    content = thinned(columns_of(rows, GAS))
    found = minutes(content, ("time", "power_compressor"), Fold.HOLD, 0, 59)
    power = len(COLUMNS) + OWN.index("power_compressor")
    assert found["power_compressor"] == pytest.approx([np.mean([row[power] for row in rows[:60]])])


def test_what_an_older_version_stored_has_none(rows):
    columns = columns_of(rows, GAS)
    old = packed({name: columns[name] for name in COLUMNS}, Basis.of(SCENARIO.station), {})
    assert np.isnan(stored_columns(old, ("time", *OWN))[OWN[0]]).all()
    shared = slice(0, len(COLUMNS))
    assert np.array(decode(old, GAS))[:, shared].tobytes() == np.array(rows)[:, shared].tobytes()
    thin = thinned({name: columns[name] for name in (*COLUMNS, SENT)})
    assert np.isnan(minutes(thin, ("time", OWN[0]), Fold.HOLD, 0, 59)[OWN[0]]).all()
    journal = TwinJournal(0, Basis.of(SCENARIO.station), GAS)
    journal.resume({"row": np.array(rows[40][: len(COLUMNS)])}, 41)
    assert len(journal.last_row) == len(sample_columns(GAS))
    assert all(math.isnan(figure) for figure in journal.last_row[len(COLUMNS) :])
