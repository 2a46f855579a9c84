"""Sensors that err and a plant that differs: no limit is broken, and what that costs.

    python docs/examples/gallery/noisy_sensors.py

It prints

    82 corners proved; readings must leave 2.955 g/s of the flow limit
    exact       waits 846 s, 0 vehicles not finished
    with errors waits 936 s, 0 vehicles not finished
"""

from controllers import create
from station import load_scenario, parse_scenario, simulate


def main():
    """Run S1 with every error at the end of its half-width, under margins that are proved."""
    calm = load_scenario("S1")
    rough = parse_scenario({**calm.model_dump(), "disturbance": {"sensors": "corner", "plant": "corner", "seed": 7}})
    corners, margin = rough.proof.check(), rough.proof.margins["flow"]
    print(f"{corners} corners proved; readings must leave {margin:.3f} g/s of the flow limit")
    for name, scenario in (("exact", calm), ("with errors", rough)):
        found = simulate(scenario, create("minlp1")).metrics()
        print(f"{name:<11} waits {found.t_total:.0f} s, {found.vehicles_not_finished:.0f} vehicles not finished")


if __name__ == "__main__":
    main()
