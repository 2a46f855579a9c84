"""The thesis's examples: systems of chapters 3 and 4, Table 3.3, the controllers of Secs. 5.6 and 6.4."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from theory.boxes import Boxes
from theory.errors import IllPosedError
from theory.mission import Mission
from theory.models import LinearModel
from theory.stochastic import RandomSystem
from theory.system import NAMES, Array, SwitchedSystem
from theory.trimodal import Plant, Settings
from theory.tube import Limits

TABLE_3_3_TAU = 3
"""Dwell time of Table 3.3 [samples]; the thesis never states it."""


@dataclass(frozen=True)
class Printed:
    """A cell of Table 3.3: the l2 gain for a delay and a lift."""

    delay: int
    lift: int
    gain: float


def example(name: str) -> SwitchedSystem:
    """The system of an example: `example_3_1`, `example_3_2`, `example_4_3` or `example_4_4`."""
    found = _data().get(name)
    if not isinstance(found, dict):
        raise IllPosedError("example", f"{name!r} is none of {', '.join(examples())}")
    return SwitchedSystem(**{key: found[key] for key in NAMES if key in found})


def examples() -> list[str]:
    """Names of the examples."""
    return [name for name in _data() if name.startswith("example")]


def table_3_3() -> list[Printed]:
    """The printed l2 gains."""
    return [Printed(**row) for row in _data()["table_3_3"]]


@dataclass(frozen=True)
class Unknown:
    """An example of chapter 5: the system, which the controller does not see, and the controller's settings."""

    model: LinearModel
    settings: Settings
    start: Array
    restart: Array | None = None
    """Where the loop is closed from, if not from where the preparation ends."""

    def plant(self, seed: int, *, corners: bool = False) -> Plant:
        """The system with noise drawn from its box, or from its corners."""
        rng, noise = np.random.default_rng(seed), self.settings.noise

        def after(state: Array, action: Array) -> Array:
            drawn = rng.choice([-noise, noise], len(state)) if corners else rng.uniform(-noise, noise, len(state))
            return self.model.after(state, action) + drawn

        return after


def unknown(name: str = "dmd") -> Unknown:
    """The example of Sec. 5.6 (`dmd`), or one with three states and two inputs (`dmd_three_states`)."""
    found = _section(name, ("dmd", "dmd_three_states"))
    model = LinearModel(np.array(found["A"]), np.array(found["B"]))
    limits = Limits.symmetric(
        {int(i) - 1: bound for i, bound in found["state_limits"].items()},
        {int(i) - 1: bound for i, bound in found["input_limits"].items()}, model.states, model.inputs,
    )  # fmt: skip
    settings = Settings(
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


def mission(reading: str = "paths", **changes: Any) -> tuple[Mission, Array]:
    """The example of Sec. 6.4, in the reading that works (`paths`) or as printed (`paths_printed`), and its start."""
    found = {**_data()["paths_common"], **_section(reading, ("paths", "paths_printed"))}
    n, m = len(found["A"]), len(found["B"][0])
    term = np.zeros((1, n, n))
    term[0, 0, 0] = 1.0
    deviation = np.array([found["variance"] ** 0.5] * 2 + [0.0] * (n - 2))
    low, high = found["theta"]
    system = RandomSystem(
        np.array(found["A"]), np.array(found["B"]), deviation, term, np.array([low]), np.array([high])
    )
    chosen: dict[str, Any] = {
        "system": system, "goal": np.array(found["goal"]), "Q": found["Q"] * np.eye(n), "R": found["R"] * np.eye(m),
        "state_limits": Boxes.of((found["state_low"], found["state_high"])),
        "input_limits": Boxes.of(([-found["input"]] * m, [found["input"]] * m)),
        "obstacles": Boxes.of(*found["obstacles"]),
        **{key: found[key] for key in ("safe_distance", "perception", "horizon", "scenarios", "reached")},
    }  # fmt: skip
    return Mission(**{**chosen, **changes}), np.array(found["start"])


def _section(name: str, names: tuple[str, ...]) -> dict[str, Any]:
    if name not in names:
        raise IllPosedError("example", f"{name!r} is none of {', '.join(names)}")
    return dict(_data()[name])


@cache
def _data() -> dict[str, Any]:
    return tomllib.loads((files("theory") / "data" / "examples.toml").read_text(encoding="utf-8"))
