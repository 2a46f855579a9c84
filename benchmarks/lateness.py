"""How late a twin tells its seconds with shadows, forecasts and what-ifs beside it: `python -m benchmarks.lateness`.

The twin runs at the clock's own speed with five shadows whose stretches of five minutes follow one another. All the
while a forecast by two of them is asked for, then a twin that begins as it was some time ago, and so on.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator

from benchmarks.measure import Bar, Row, cells
from benchmarks.served import Service, served

SHADOWS = ["logic", "minlp1", "reserve", "switched", "guarded"]
FORECAST = ["minlp1", "switched"]
STRETCH_S = 300
FUTURES = 100
REST_S = 2.0
"""Between forecasts, in which stretches are computed: their jobs are behind all others [s]."""

BAR_MS = 200.0
FIRST_S = 20
"""From here on what-ifs are asked for [s]."""


def beside(service: Service, until: float) -> tuple[int, int]:
    """Ask for forecasts and what-ifs in turn until a time [s, monotonic]; how many of each ended."""
    forecasts = begun = 0
    while time.monotonic() < until:
        asked = {"controllers": FORECAST, "futures": FUTURES, "seed": forecasts}
        forecast = service.request("POST", "/v1/twins/bench/forecasts", asked)
        while forecast["finished"] is None and time.monotonic() < until:
            time.sleep(0.1)
            forecast = service.request("GET", f"/v1/forecasts/{forecast['id']}")
        forecasts += forecast["finished"] is not None
        samples = service.request("GET", "/v1/twins/bench")["samples"]
        if samples > FIRST_S:
            other = {"id": f"other-{begun}", "of": "bench", "at_s": samples - 5, "controller": "minlp1", "speed": 1}
            service.request("POST", "/v1/twins", other)
            service.request("POST", f"/v1/twins/{other['id']}/stop")
            begun += 1
        time.sleep(REST_S)
    return forecasts, begun


def rows(station: str, seconds: float) -> Iterator[Row]:
    """Rows of a twin at a station."""
    law = {"kind": "poisson", "rate_per_h": 7.0, "period_s": 43_200.0}
    scenario = {"name": "late", "station": {"preset": station}, "arrivals": law}
    shadow = {"controllers": SHADOWS, "every_s": STRETCH_S, "horizon_s": STRETCH_S}
    with served() as service:
        twin = {"id": "bench", "scenario": scenario, "controller": "logic", "replication": 1, "at_end": "repeat"}
        service.request("POST", "/v1/twins", twin)
        service.request("PUT", "/v1/twins/bench/shadow", shadow)
        forecasts, begun = beside(service, time.monotonic() + seconds)
        state = service.request("GET", "/v1/twins/bench")
        stretches = service.request("GET", "/v1/twins/bench/shadow")["stretches"]
    what = f"{station} at 1x, {seconds:g} s beside {forecasts} forecasts, {begun} what-ifs, {len(stretches)} stretches"
    yield Row(f"{what}: latest tick", (1000 * state["lateness_max_s"],), "ms", Bar("at most", BAR_MS))
    yield Row(f"{what}: ticks more than 100 ms late of {state['samples']}", (float(state["ticks_late"]),), "1")


def main() -> None:
    """Parse the arguments and print; status 1 where the bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--station", action="append", help="thesis-fit and h70-light if left out; may be given again")
    parser.add_argument("--seconds", type=float, default=345.0, help="for each")
    asked = parser.parse_args()
    missed = False
    for station in asked.station or ["thesis-fit", "h70-light"]:
        for row in rows(station, asked.seconds):
            print(*cells(row), sep=" | ", flush=True)
            missed |= row.ok is False
    sys.exit(int(missed))


if __name__ == "__main__":
    main()
