"""Runs inside a certificate of service: vehicles of its ranges, from states of its box, as far apart as it says.

`python -m benchmarks.service_runs CERTIFICATE [RUNS]` prints vehicles, how many were late, and the longest fill; of
bursts the longest stay.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from controllers.certified.claim import Asked, Claim
from controllers.certified.falsify import LONGEST_GAP, Arrivals, Falsifier
from controllers.certified.vehicles import vehicles_of
from station.parameters import Station

RUNS = 100_000
LONG = 0.2
"""Share of runs of three vehicles, or bursts; the others have one."""

EDGE = 0.25
"""Share of states at a corner of the box, and of vehicles at a corner of the ranges."""


class Runs:
    """Drawn runs of a certificate's controller at its station."""

    def __init__(self, document: dict[str, Any], seed: int = 0) -> None:
        station = Station.model_validate(document["station"]["parameters"])
        name, options = document["controller"]["name"], document["controller"]["options"]
        asked = Asked.of_document(document["asked"])
        vehicles = vehicles_of(station, asked.volume, asked.start_spread)
        self.claim = Claim(vehicles, document["spacing_s"], document["within_s"], document["burst"])
        self.bench = Falsifier(station, name, options, self.claim)
        box = document["box"]
        self._low = np.array(box["pressure_low_bar"] + box["temperature_low_c"])
        self._high = np.array(box["pressure_high_bar"] + box["temperature_high_c"])
        self._random = np.random.default_rng(seed)

    def _unit(self, size: int) -> np.ndarray:
        """Places within 0 to 1, a part of them at the ends."""
        places = self._random.random(size)
        return np.round(places) if self._random.random() < EDGE else places

    def one(self) -> tuple[np.ndarray, Arrivals]:
        """A state and who comes when."""
        count = 3 * self.claim.burst if self._random.random() < LONG else self.claim.burst
        gaps = np.ceil(self.claim.spacing * np.where(self._unit(count) < 0.5, 1.0, LONGEST_GAP ** self._unit(count)))
        if self.claim.burst > 1:
            gaps = np.where(self._random.random(count) < 0.5, gaps, 0.0)
        times = self.claim.times(gaps[1:])
        state = self._low + (self._high - self._low) * self._unit(6)
        return state, tuple((float(time), self.claim.vehicles.drawn(self._unit(2))) for time in times)


def run(document: dict[str, Any], runs: int, seed: int = 0) -> dict[str, float]:
    """Vehicles, how many were late, and the longest fill [s]."""
    drawn = Runs(document, seed)
    vehicles, late, longest = 0, 0, 0.0
    for _ in range(runs):
        fills = drawn.bench.fills(*drawn.one())
        vehicles, late = vehicles + len(fills), late + int((fills > drawn.claim.promised).sum())
        longest = max(longest, float(fills.max()))
    return {"runs": runs, "vehicles": vehicles, "late": late, "longest_fill_s": longest}


def main(arguments: list[str]) -> None:
    """Read the certificate and print what came of the runs."""
    document = json.loads(Path(arguments[0]).read_text(encoding="utf-8"))
    found = run(document, int(arguments[1]) if len(arguments) > 1 else RUNS)
    found |= {"proved_s": document["proof"]["longest_fill_s"], "within_s": document["within_s"]}
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
