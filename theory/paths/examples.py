"""The example of chapter 6: a vehicle among obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np

from theory.arrays import Array
from theory.example_data import data, example_table
from theory.paths.boxes import Boxes
from theory.paths.mission import Mission
from theory.paths.stochastic import RandomSystem


def mission(reading: str = "paths", **changes: Any) -> tuple[Mission, Array]:
    """The example of Sec. 6.4, in the reading that works (`paths`) or as printed (`paths_printed`), and its start."""
    found = {**data()["paths_common"], **example_table(reading, ("paths", "paths_printed"))}
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
