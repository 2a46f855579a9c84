"""A controller of your own in twenty lines, beside the rules that stations use today.

    python docs/examples/gallery/own_controller.py

It prints

    logic     waits 1054 s, compressor 1662 s with refilled buffers, 0 valves refused
    emptiest  waits 2116 s, compressor 1359 s with refilled buffers, 1204 valves refused
"""

from controllers import create
from controllers.base import BaseController
from station import Decision, Valve, load_scenario, simulate

INLETS = (Valve.INLET_HIGH, Valve.INLET_MEDIUM, Valve.INLET_LOW)
OUTLETS = (Valve.OUTLET_HIGH, Valve.OUTLET_MEDIUM, Valve.OUTLET_LOW)


class Emptiest(BaseController):
    """Dispenses from the emptiest buffer that can give, and fills the emptiest of the others."""

    name = "emptiest"

    def start(self, station):
        """Read from the station what the rule needs."""
        super().start(station)
        self.gap = station.dispenser.outlet_gap_min_bar
        self.full = 0.9 * station.compressor.pressure_bar

    def decide(self, observation):
        """Open at most one outlet and one inlet; the shield closes what a limit forbids."""
        order = sorted(range(3), key=lambda buffer: observation.pressure[buffer])
        give = [b for b in order if observation.pressure[b] - observation.vehicle_pressure >= self.gap]
        outlet = give[0] if observation.vehicle >= 0 and give else None
        fill = [b for b in order if b != outlet and observation.pressure[b] < self.full]
        command = OUTLETS[outlet] if outlet is not None else 0
        return Decision(command | (INLETS[fill[0]] if fill else 0))


def main():
    """Run it on S1 beside `logic`."""
    scenario = load_scenario("S1")
    for controller in (create("logic"), Emptiest()):
        record = simulate(scenario, controller)
        found = record.metrics()
        print(
            f"{controller.name:<9} waits {found.t_total:.0f} s, compressor {found.t_comp_restored:.0f} s with refilled "
            f"buffers, {found.refused_valves:.0f} valves refused"
        )


if __name__ == "__main__":
    main()
