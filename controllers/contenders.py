"""Controllers as forecasts run them: by the compiled loop, each with its shield and its liveness."""

from __future__ import annotations

from typing import Any

import numpy as np

from controllers.slot import create, parse
from station.errors import InputError
from station.forecasting.futures import Contender
from station.kernels import CLOSED_CONTROLLER
from station.scenario import Scenario
from station.simulation import liveness_of

BRIEF: dict[str, dict[str, Any]] = {"switched": {"width": 24, "blocks": 8, "follow": 6, "bound": False}}
"""Options with which hundreds of futures are planned where a text has none of its own: a fourth of the work for a day
whose waits and compressor time are the same within a hundredth or two (`benchmarks.brief_plans`)."""


def contender(
    text: str, scenario: Scenario, memory: np.ndarray | None = None, fallback_memory: np.ndarray | None = None, *,
    brief: bool = False,
) -> Contender:  # fmt: skip
    """The controller that a text like `minlp1:horizon=3` describes, on a scenario's station.

    `memory`: what it remembers, and `fallback_memory` what its fallback does; else its futures begin with fresh ones.
    `brief`: with the options of `BRIEF`, where the text does not say others.

    Raises
    ------
    InputError
        if there is none, its options are wrong, or it is called from Python second by second.
    """
    name, options = parse(text)
    controller = create(name, **{**(BRIEF.get(name, {}) if brief else {}), **options})
    station = scenario.known_station
    controller.start(station)
    compiled = controller.compiled() if hasattr(controller, "compiled") else None
    if compiled is None:
        raise InputError(
            "controllers", [(text, "is called from Python, and cannot be forecast: thousands of hours are")]
        )
    if memory is not None and memory.shape == compiled.memory.shape:
        compiled = compiled._replace(memory=memory.copy())
    fallback, behind = getattr(controller, "fallback", None), CLOSED_CONTROLLER
    if fallback is not None:
        fallback.start(station)
        behind = fallback.compiled()
        if fallback_memory is not None and fallback_memory.shape == behind.memory.shape:
            behind = behind._replace(memory=fallback_memory.copy())
    return Contender(text, compiled, behind, liveness_of(controller, scenario.station))
