"""The examples of chapter 5: a system that the controller does not know, and the controller's settings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from theory.arrays import Array
from theory.example_data import example_table
from theory.tubes.models import LinearModel
from theory.tubes.trimodal import Plant, TrimodalSettings
from theory.tubes.tube import Limits


@dataclass(frozen=True)
class Unknown:
    """An example of chapter 5: the system, which the controller does not see, and the controller's settings."""

    model: LinearModel
    settings: TrimodalSettings
    start: Array
    restart: Array | None = None
    """Initial state of the closed loop, if not the last state of the preparation."""

    def plant(self, seed: int, *, corners: bool = False) -> Plant:
        """The system with noise drawn from its box, or from its corners."""
        rng, noise = np.random.default_rng(seed), self.settings.noise

        def after(state: Array, action: Array) -> Array:
            drawn = rng.choice([-noise, noise], len(state)) if corners else rng.uniform(-noise, noise, len(state))
            return self.model.after(state, action) + drawn

        return after


def unknown(name: str = "dmd") -> Unknown:
    """The example of Sec. 5.6 (`dmd`), or one with three states and two inputs (`dmd_three_states`)."""
    found = example_table(name, ("dmd", "dmd_three_states"))
    model = LinearModel(np.array(found["A"]), np.array(found["B"]))
    limits = Limits.symmetric(
        {int(i) - 1: bound for i, bound in found["state_limits"].items()},
        {int(i) - 1: bound for i, bound in found["input_limits"].items()}, model.states, model.inputs,
    )  # fmt: skip
    settings = TrimodalSettings(
        limits,
        found["noise"],
        np.array(found["Q"]),
        np.array(found["R"]),
        np.broadcast_to(np.array(found["excitation"]), (found["window"], model.inputs)),
        found["horizon"],
        found["contraction"],
    )
    return Unknown(
        model, settings, np.array(found["start"]), np.array(found["restart"]) if "restart" in found else None
    )
