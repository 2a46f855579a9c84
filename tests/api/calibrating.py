"""A hidden station's day of seven hours for tests of calibrations."""

from __future__ import annotations

from functools import cache

from controllers import create_from
from station import simulate
from station.batches import Batch, batches_of
from station.estimation.calibration import SHORTEST
from station.measured_day import measured_day, tags_of_day
from station.scenario import parse_scenario
from tests.station.estimation.hidden import hidden_station

SECONDS = SHORTEST + 3600
TAGS = tags_of_day()
ORDER = {"scenario": "S1", "source": "measured", "tags": TAGS.model_dump(mode="json", exclude_unset=True)}
"""A twin that follows it as the station of S1, but for its id."""

HIDDEN = hidden_station(1, spread=0.05, ambient=2.0)


@cache
def readings(seconds: int = SECONDS, each_s: float = 600.0) -> list[Batch]:
    """What its sensors tell, in batches."""
    arrivals = [
        {"time_s": 100.0 + 600.0 * k, "start_pressure_bar": 110.0 + 7.0 * (k % 8)} for k in range(seconds // 600)
    ]
    scenario = {
        "name": "hidden", "station": HIDDEN.model_dump(), "time_limit_s": float(seconds + 10),
        "arrivals": {"kind": "trace", "vehicles": arrivals},
    }  # fmt: skip
    record = simulate(parse_scenario(scenario), create_from("logic"))
    return batches_of(measured_day(record, 1), TAGS, each_s)
