"""A policy found by search in the Gymnasium environment, and the same policy as a controller of a station.

    pip install "hrs-twin[gym]"
    python docs/examples/gallery/learned_policy.py

It prints

    found: fill high to 842, medium to 836, low to 412 bar
    logic    waits  2078 s, compressor  1395 s, dispenser  1868 s: cost  4407
    switched waits  1986 s, compressor  1148 s, dispenser  1805 s: cost  4037
    learned  waits  2107 s, compressor  1217 s, dispenser  1870 s: cost  4260
"""

import gymnasium
import numpy as np

from api.bridges.gymnasium.policy import PolicyController
from controllers import create
from station import load_scenario, simulate
from station.valves import commands
from station.vector_kernels import OBSERVED

AT = list(OBSERVED).index
PRESSURES, VEHICLE, VEHICLE_PRESSURE = AT("pressure_high"), AT("vehicle"), AT("pressure_vehicle")
NAMES = ("high", "medium", "low")
START = np.array([850.0, 700.0, 500.0, 150.0, 100.0, 0.0])
"""Where the search begins: pressures to which buffers are filled, gaps that medium and low keep, and by how much more
is filled while a vehicle is connected [bar]."""

SPREAD = np.array([100.0, 150.0, 150.0, 80.0, 80.0, 150.0])
MANY, BEST, GENERATIONS, DAYS = 128, 16, 6, 20
STEPS_MAX = 20_000


def scores(shown, policy):
    """A score for each of the six valves, (runs, 6); a command is worth the sum of its open valves."""
    pressure = shown[:, PRESSURES : PRESSURES + 3]
    connected = shown[:, VEHICLE, None]
    fill = (policy[:, :3] + connected * policy[:, 5:6] - pressure) / 100
    gap = pressure - shown[:, VEHICLE_PRESSURE, None]
    kept = np.column_stack((np.zeros(len(policy)), policy[:, 3:5]))
    turn = np.array([1.0, 2.0, 3.0])  # low before medium before high
    give = np.where(gap >= kept, 10.0 + turn, 9.0 - turn)
    return np.hstack((fill, give))


def actions(shown, mask, policy, bits):
    """The best command of each run among those the limits admit, (runs,)."""
    worth = scores(shown, policy) @ bits
    return np.where(mask, worth, -np.inf).argmax(axis=1)


def bits_of(found):
    """Which valves each command opens, (6, commands)."""
    return (np.asarray(found)[None, :] >> np.arange(6)[:, None] & 1).astype(float)


def returns(environments, policy, seed):
    """The return of the first day of each environment, each under its own policy, (runs,)."""
    shown, info = environments.reset(seed=seed)
    bits = bits_of(environments.unwrapped.commands)
    total, alive = np.zeros(len(policy)), np.ones(len(policy), bool)
    for _ in range(STEPS_MAX):
        shown, reward, terminated, truncated, info = environments.step(
            actions(shown, info["action_mask"], policy, bits)
        )
        total += reward * alive
        alive &= ~(terminated | truncated)
        if not alive.any():
            break
    return total


def search():
    """The cross-entropy method: draw policies, keep the best on days drawn anew, draw around them."""
    generator = np.random.default_rng(1)
    environments = gymnasium.make_vec("hrs/Station-v0", num_envs=MANY, scenario="S1")
    mean, spread = START, SPREAD
    for generation in range(GENERATIONS):
        policy = mean + spread * generator.standard_normal((MANY, len(mean)))
        policy[0] = mean
        found = returns(environments, policy, seed=1000 * generation)
        chosen = policy[np.argsort(found)[-BEST:]]
        mean, spread = chosen.mean(axis=0), chosen.std(axis=0)
    return mean


class Learned(PolicyController):
    """The policy in the slot: what it was shown in the environment it is shown here."""

    name, about = "learned", "a score for each valve, found by search"

    def __init__(self, policy, **options):
        """A controller with six numbers."""
        super().__init__(**options)
        self.policy = policy[None, :]

    def start(self, station):
        """Prepare for a run on `station`."""
        super().start(station)
        self.bits = bits_of(commands(station.compressor.count))

    def act(self, shown, mask):
        """The best command that the limits admit."""
        return int(actions(shown[None, :], mask[None, :], self.policy, self.bits)[0])


def main():
    """Search on drawn days of S1, then compare on days that the search has not seen."""
    policy = search()
    fills = ", ".join(f"{name} to {bar:.0f}" for name, bar in zip(NAMES, policy, strict=False))
    print(f"found: fill {fills} bar")
    scenario = load_scenario("S1")
    for controller in (create("logic"), create("switched"), Learned(policy)):
        runs = [simulate(scenario, controller, replication=day, seed=7).metrics() for day in range(1, DAYS + 1)]
        waiting = np.mean([run.t_total for run in runs])
        compressing = np.mean([run.t_comp for run in runs])
        dispensing = np.mean([run.t_dis for run in runs])
        times = f"compressor {compressing:5.0f} s, dispenser {dispensing:5.0f} s"
        cost = waiting + compressing + 0.5 * dispensing
        print(f"{controller.name:<8} waits {waiting:5.0f} s, {times}: cost {cost:5.0f}")


if __name__ == "__main__":
    main()
