"""A station that dispenses worse than its file says: `adaptive` finds out and plans with what it found.

    python docs/examples/gallery/adaptive.py

It prints

    outlets give 0.0491 g/(s bar) in the file, 0.0417 in the plant
    switched  waits 1479 s, compressor 1581 s with refilled buffers
    adaptive  waits 1398 s, compressor 1601 s with refilled buffers
    identified: 0.0417, for certain between 0.0417 and 0.0420
"""

from controllers import create
from controllers.adaptive.controller import constants_of
from station import load_scenario, parse_scenario, simulate
from station.readings import observations


def main():
    """Run S1 on a plant whose outlets give 15 % less, with noisy sensors."""
    calm = load_scenario("S1")
    disturbance = {
        "uncertainty": {"parameters": 0.15, "pressure_bar": 1.0, "temperature_k": 0.5},
        "sensors": "uniform",
        "plant": "nominal",
        "shares": {"outlet_coefficient": -1.0},
        "seed": 7,
    }
    scenario = parse_scenario({**calm.model_dump(), "disturbance": disturbance})
    told = scenario.station.constants().outlet_coefficient
    true = scenario.plant(0).outlet_coefficient
    print(f"outlets give {told:.4f} g/(s bar) in the file, {true:.4f} in the plant")
    for name in ("switched", "adaptive"):
        record = simulate(scenario, create(name))
        found = record.metrics()
        print(f"{name:<9} waits {found.t_total:.0f} s, compressor {found.t_comp_restored:.0f} s with refilled buffers")
    follower = create("adaptive")
    follower.start(scenario.known_station)
    for observation in observations(record):
        follower.decide(observation)
    least, estimate, greatest = constants_of(follower.memory)["outlet_coefficient"]
    print(f"identified: {estimate:.4f}, for certain between {least:.4f} and {greatest:.4f}")


if __name__ == "__main__":
    main()
