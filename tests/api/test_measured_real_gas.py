"""A twin that follows a station of the faithful plant: the bytes of one run, across a kill, with its own estimates."""

from __future__ import annotations

import numpy as np
import pytest

from api.twins.estimates import estimate_of
from api.twins.messages import is_measured, measured_layout, sample_columns
from api.twins.segments import decode, encode
from station import load_station
from station.estimation.followed import FollowedRun
from tests.api.measured import TAG_MAP, batches, measured
from tests.api.reopened import kill, opening
from tests.waiting import wait_until

SCENARIO = {
    "name": "field",
    "station": "h70-light",
    "arrivals": {"kind": "trace", "vehicles": [{"time_s": 60.0, "start_pressure_bar": 120.0}]},
}


@pytest.mark.slow
def test_it_is_followed_across_a_kill_to_the_last_bit(database):
    sent = batches(120)
    run = FollowedRun(load_station("h70-light"), TAG_MAP)
    found = [run.push(batch) for batch in sent] + [run.finish()]
    wanted = np.concatenate([np.column_stack((part.time, part.table())) for part in found])
    with opening(database, checkpoint_s=0.2) as opened:
        twins = opened()
        twins.start(measured(scenario=SCENARIO))
        for place, batch in enumerate(sent[:90]):
            twins.measure("m", "plc", place, batch)
        wait_until(lambda: twins.measured("m").taken >= 80)
        kill(twins)
        twins = opened()
        twins.resume_all()
        for place, batch in enumerate(sent[80:], 80):
            twins.measure("m", "plc", place, batch)
        wait_until(lambda: twins.measured("m").taken == len(sent))
        estimate = estimate_of(twins, "m")
        assert {"precooler_deviation", "temperature_wall_high", "leak_low"} <= set(estimate.quantities)
        assert estimate.quantities["precooler_deviation"].unit == "K"
        twins.stop("m")
        rows = np.array([sample.row[1:] for sample in twins.history("m", 0, 1000)])
        assert rows.tobytes() == wanted.tobytes()


def test_its_samples_have_a_layout_of_their_own():
    layout = measured_layout("real-gas")
    assert is_measured(layout)
    columns = sample_columns(layout)
    assert set(sample_columns(measured_layout("thesis"))) < set(columns)
    row = (*np.arange(len(columns) + 1.0),)
    assert decode(encode([row], None, layout), layout) == [row]
