"""A record whose valves are told as they are: those that stick are found, and told so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.archives import arrays_under, refuse_other_shapes
from station.estimation.interface import EstimationModel
from station.estimation.valves.hypotheses import BLOCK, Hypotheses, full_of
from station.estimation.valves.judging import judge_valves
from station.estimation.valves.memory import (
    KNOWN,
    METERS,
    STUCK,
    ValveMemory,
    find_stuck,
    valves_of_nothing,
    works_again,
)  # fmt: skip
from station.frames import Frames
from station.geometry import VALVES
from station.parameters import Station


class ValveWatch:
    """Look for valves that stick, second by second.

    Parameters
    ----------
    station : Station
        The station as it is known.
    model : EstimationModel
        Of its plant.
    compares : bool
        Whether what readings do not fit is followed again with a valve that is stuck; a soft filter lets all fit.
    """

    def __init__(self, station: Station, model: EstimationModel, *, compares: bool = True) -> None:
        self._grams, self._full = model.grams_of(station), full_of(model.constants_of(station))
        self._memory = valves_of_nothing()
        self._hypotheses = Hypotheses(station, model)
        self._compares = compares

    def advance(self, frames: Frames) -> tuple[Frames, NDArray[np.float64]]:
        """Judge the seconds that follow; they with the valves as they are, and what was found, (seconds, STUCK)."""
        if not self._compares:
            return self._judge(frames)
        parts = [self._advance(part) for part in frames.blocks(BLOCK)]
        judged, found = zip(*parts, strict=True)
        return Frames.joined(judged), np.concatenate(found)

    def _advance(self, frames: Frames) -> tuple[Frames, NDArray[np.float64]]:
        """Judge seconds of one block; at its end which valve's being stuck would explain them."""
        judged, found = self._judge(frames)
        self._hypotheses.take(frames, judged)
        ends = len(frames) > 0 and (frames.start + len(frames)) % BLOCK == 0
        if ends and (rival := self._hypotheses.end_block(self._memory)):
            if rival.position:
                find_stuck(self._memory, rival.valve, rival.position, float(BLOCK), found[-1])
                found[-1, : len(VALVES)] = self._memory.position
            else:
                works_again(self._memory, rival.valve)
        return judged, found

    def _judge(self, frames: Frames) -> tuple[Frames, NDArray[np.float64]]:
        values, found = frames.values.copy(), np.zeros((len(frames), STUCK))
        judge_valves(values, np.ascontiguousarray(frames.noise), self._grams, self._full, self._memory, found)
        meters = slice(METERS, METERS + 2)
        off = np.nan_to_num(frames.values[:, meters] - values[:, meters])
        noise = frames.noise.copy()  # what is taken off a meter's readings was read with noise as well
        noise[:, meters] = np.hypot(noise[:, meters], frames.relative[meters] * off)
        raw = np.hstack([frames.values[:, meters], found[:, KNOWN : KNOWN + 2]])
        return replace(frames, values=values, noise=noise, raw=raw), found

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays."""
        compared = {f"compared_{name}": each for name, each in self._hypotheses.snapshot().items()}
        return {**self._memory._asdict(), **compared}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of a watch of the same station.

        Raises
        ------
        InputError
            naming what none could have written; the watch is as it was.
        """
        fresh = valves_of_nothing()
        refuse_other_shapes(arrays, fresh._asdict())
        self._hypotheses.restore(arrays_under(arrays, "compared_"))
        self._memory = ValveMemory(*(arrays[name].copy() for name in ValveMemory._fields))
