"""Compare two controllers on a day of your own, and draw one of the runs.

    python docs/examples/gallery/own_day.py

It prints

    logic     mean wait 198 s, longest 567 s, compressor 2394 s
    switched  mean wait 114 s, longest 278 s, compressor 1967 s
    drawn: morning.png
"""

import numpy as np

from api.runs.plot import plot_run
from controllers import create
from station import parse_scenario, simulate

MORNING = {
    "name": "morning",
    "station": "thesis-fit",
    "arrivals": {
        "kind": "trace",
        "vehicles": [
            {"time_s": 360.0 * number, "start_pressure_bar": pressure}
            for number, pressure in enumerate([60, 120, 40, 180, 90, 150, 60, 110])
        ],
    },
}
"""Eight vehicles, one every six minutes, each with what it has left."""


def main():
    """Simulate the morning under two controllers."""
    scenario = parse_scenario(MORNING)
    for name in ("logic", "switched"):
        record = simulate(scenario, create(name))
        found = record.metrics()
        waits = np.subtract(record.vehicles["connected"], record.vehicles["arrival"])
        print(f"{name:<9} mean wait {found.t_avg:.0f} s, longest {waits.max():.0f} s, compressor {found.t_comp:.0f} s")
    plot_run(record, "morning.png")
    print("drawn: morning.png")


if __name__ == "__main__":
    main()
