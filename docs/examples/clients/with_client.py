"""Compare two controllers, plot a run's pressures, and follow a live twin, with the client that comes with hrs-twin.

python with_client.py [http://127.0.0.1:8000]
"""

import sys
from itertools import islice

from api.client import Service

URL = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
# A service that other machines reach asks for a key: Service(url=URL, key="hrs_...")


def main():
    """Submit a comparison and a run, then listen to a twin for five samples."""
    rush = {"name": "rush", "arrivals": {"kind": "poisson", "rate_per_h": 20, "period_s": 3600}}
    with Service(url=URL) as service:
        comparison = service.compare(["S1", rush], ["logic", "minlp1"], replications=5, seed=1).wait()
        found = comparison.results()
        for scenario, controller, waits in zip(found["scenario"], found["controller"], found["t_total"], strict=True):
            print(f"{scenario} {controller:<7} waits {waits:.0f} {found.units['t_total']} in all")

        run = service.run("S1", "minlp1").wait()
        print(f"compressor {run.metrics['t_comp']:.0f} s")
        series = run.series(["pressure_high"], step_s=300).numpy()
        for time_s, pressure in zip(series["time"], series["pressure_high"], strict=True):
            print(f"{time_s:>6.0f} s {pressure:7.1f} bar")

        twin = service.start("S1", controller="logic", at_end="repeat", speed=10)
        for sample in islice(twin.samples(), 5):
            print(f"sample {sample.seq}: {sample.values['pressure_high']:.1f} bar")
        twin.stop()
        twin.delete()


if __name__ == "__main__":
    main()
