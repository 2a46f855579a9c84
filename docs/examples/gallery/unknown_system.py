"""Keep the limits of a system that nobody has a model of: tube predictive control from thirteen samples.

    python docs/examples/gallery/unknown_system.py

It prints

    modes 233333333333333333333333333333
    largest state 3.15 of 5 allowed, last 0.013
    largest input 2.00 of 2 allowed
"""

import numpy as np

from theory.tubes.trimodal import Trimodal, TrimodalSettings, close_loop, prepare
from theory.tubes.tube import Limits

A, B, NOISE = np.array([[1.0, 0.3], [0.0, 1.1]]), np.array([[0.0], [1.0]]), 0.01


def main():
    """Excite the system, learn every model the samples allow, then regulate it."""
    draws = np.random.default_rng(0)

    def plant(state, inputs):
        return A @ state + B @ inputs + draws.uniform(-NOISE, NOISE, 2)

    settings = TrimodalSettings(
        limits=Limits.symmetric({0: 5.0, 1: 5.0}, {0: 2.0}, n_x=2, n_u=1),
        noise=NOISE,
        Q=np.eye(2),
        R=np.eye(1),
        excitation=np.array([[0.3], [-0.6], [0.5], [-0.4], [0.2], [-0.1]]),
    )
    learned = prepare(plant, [1.0, 0.0], settings)
    controller = Trimodal(settings, learned.models, learned.window)
    closed = close_loop(plant, controller, [3.0, 0.5], 30)
    print(f"modes {''.join(map(str, closed.modes))}")
    print(f"largest state {np.abs(closed.states).max():.2f} of 5 allowed, last {np.abs(closed.states[-1]).max():.3f}")
    print(f"largest input {np.abs(closed.inputs).max():.2f} of 2 allowed")


if __name__ == "__main__":
    main()
