"""Random days: the same draws for every controller, means with their standard errors.

    python docs/examples/gallery/drawn_days.py

It prints

    logic   mean wait 698 +- 122 s
    minlp1  mean wait 291 +- 49 s
    on the same day minlp1 saves 406 +- 76 s
"""

import numpy as np

from controllers import create
from station import parse_scenario, simulate

HOURS = {
    "name": "busy hours",
    "station": "thesis-fit",
    "arrivals": {"kind": "poisson", "rate_per_h": 7.0, "period_s": 14400.0},
}
DAYS = 20


def main():
    """Simulate twenty draws of four busy hours under each controller."""
    scenario = parse_scenario(HOURS)
    waits = {}
    for name in ("logic", "minlp1"):
        runs = [simulate(scenario, create(name), replication=day, seed=1) for day in range(1, DAYS + 1)]
        waits[name] = np.array([run.metrics().t_avg for run in runs])
        print(f"{name:<7} mean wait {waits[name].mean():.0f} +- {error(waits[name]):.0f} s")
    saved = waits["logic"] - waits["minlp1"]
    print(f"on the same day minlp1 saves {saved.mean():.0f} +- {error(saved):.0f} s")


def error(values):
    """Standard error of a mean."""
    return values.std(ddof=1) / np.sqrt(len(values))


if __name__ == "__main__":
    main()
