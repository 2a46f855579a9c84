"""Thermometers that follow a gas late: a time constant each (a first-order lag).

What a thermometer is behind is reckoned from the temperatures that the model has gone through, and added to what it
reads. What readings correct of a temperature was wrong before, too, and so is nothing that it is behind.
"""

from __future__ import annotations

import numpy as np

from station.compiled import inlined


@inlined
def note_warming(behind: np.ndarray, tank: int, warming: float, memory: np.ndarray) -> None:
    """Note by how much the model has warmed a tank in a second [K].

    Parameters
    ----------
    behind
        (4,) how far each thermometer is behind its tank's gas [K]; counted on here.
    tank
        Which of them.
    warming
        By how much its gas has warmed [K].
    memory
        (4,) what is left of that after a second [1]; 0: nothing is.
    """
    behind[tank] = memory[tank] * (behind[tank] + warming)
