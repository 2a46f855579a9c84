"""Steps a second of the Gymnasium environments: `python -m benchmarks.environments`.

Actions are drawn beforehand: what is timed is the environment. One core, since the kernels have no threads.
"""

from __future__ import annotations

import time
from statistics import median

import gymnasium
import numpy as np

from api.bridges.gymnasium import ID
from station import Scenario, load_scenario, load_station

MANY = 1024
STEPS = 1000
ROUNDS = 7


def single(scenario: str | Scenario) -> list[float]:
    """Steps a second of one environment, a figure a round."""
    environment = gymnasium.make(ID, scenario=scenario)
    actions = np.random.default_rng(1).integers(environment.action_space.n, size=STEPS).tolist()  # type: ignore[attr-defined]
    rates = []
    for _ in range(ROUNDS):
        environment.reset(seed=1)
        began = time.perf_counter()
        for action in actions:
            environment.step(action)
        rates.append(STEPS / (time.perf_counter() - began))
    return rates


def many(scenario: str | Scenario, *, steps: int = STEPS) -> list[float]:
    """Steps a second of all environments of a batch together, a figure a round."""
    environments = gymnasium.make_vec(ID, num_envs=MANY, scenario=scenario)
    actions = np.random.default_rng(1).integers(environments.single_action_space.n, size=(steps, MANY))  # type: ignore[attr-defined]
    environments.reset(seed=1)
    rates = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for chosen in actions:
            environments.step(chosen)
        rates.append(steps * MANY / (time.perf_counter() - began))
    return rates


def _say(what: str, rates: list[float]) -> None:
    print(f"{what:<40} median {median(rates):>11,.0f} steps/s, {min(rates):,.0f} to {max(rates):,.0f}")


def main() -> None:
    """Print each figure with its spread over the rounds."""
    _say("single, S1", single("S1"))
    _say(f"batch of {MANY}, S1", many("S1"))
    _say(f"batch of {MANY}, S3", many("S3"))
    faithful = load_scenario("S1").on(load_station("h70-light"))
    _say("single, S1 with real gas", single(faithful))
    _say(f"batch of {MANY}, S1 with real gas", many(faithful, steps=STEPS // 10))


if __name__ == "__main__":
    main()
