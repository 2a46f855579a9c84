"""What no controller can do better on S1, proved, and how near the thesis's come.

    python docs/examples/gallery/bound.py

It prints

    logic               waits 1054 s and compresses 1662 s; who waits no longer compresses 1026 s at least
    minlp1              waits 846 s and compresses 1828 s; who waits no longer compresses 1089 s at least
    switched:patience=1 waits 2794 s and compresses 1106 s; who waits no longer compresses 76[...] s at least
"""

from controllers import create_from
from station import load_scenario, simulate
from station.bounds import COARSE, bounds


def main():
    """Prove bounds on compressor time with refilled buffers at the waits that each controller has."""
    scenario = load_scenario("S1")
    runs = {
        name: simulate(scenario, create_from(name)).metrics() for name in ("logic", "minlp1", "switched:patience=1")
    }
    found = bounds(scenario, [run.t_total for run in runs.values()], resolution=COARSE)
    for (name, run), point in zip(runs.items(), found.trade_off, strict=True):
        print(
            f"{name:<19} waits {run.t_total:.0f} s and compresses {run.t_comp_restored:.0f} s; "
            f"who waits no longer compresses {point.restored:.0f} s at least"
        )


if __name__ == "__main__":
    main()
