"""Whether a station's readings fit better were one of its valves stuck: filters side by side, each with a hypothesis.

Where valves move every few seconds no balance of a command lasts long enough. A filter that takes a valve for what it
is foretells readings that one that takes it for what it is told does not: their likelihoods are compared (Magill 1965,
doi:10.1109/TAC.1965.1098191; Willsky and Jones 1976, doi:10.1109/TAC.1976.1101146), over a block of seconds, and only
where readings do not fit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from station.archives import refuse_other_shapes
from station.errors import InputError
from station.estimation.interface import CAP, ROBUST, EstimationModel
from station.estimation.noise import LOUD
from station.estimation.valves.judging import suppose, would_matter
from station.estimation.valves.memory import FIRST_VALVE, ValveMemory, valves_of_nothing
from station.frames import Frames, kept_frames
from station.geometry import BUFFERS, VALVES
from station.measurement import kind_of
from station.parameters import Station
from station.plants.interface import filled_to
from station.sensor_names import ANALOG, BANK_SENSORS

BLOCK = 240
"""Seconds of a block."""

SETTLING = 60
"""A filter that begins learns so long [s]."""

MISFIT = 100.0
"""Squares of a channel's innovations beyond what noise makes of them, from which a block does not fit [1]."""

GAIN, LEAD = 100.0, 30.0
"""What twice the logarithm of the likelihood must gain by a valve that is stuck, and by how much it must lead any."""

LARGE, MOST = 1000.0, 0.5
"""One by which readings do not all fit must gain so much, and so large a part of what there is to be gained [1]."""

WORKS = 3000.0
"""That one works again must gain so much: where pressures are alike it is the filter that takes gas astray [1]."""

APART = 0.5
"""And no other one may gain more than this part of it less [1]."""

PASSES = 2
"""Filters, one after the other, that let pressures say which buffer is filled."""

SURE = 10
"""A valve that is found to be stuck surely let gas through otherwise than it was told for so long [s]."""

JUMP, JUMPS, AROUND = 7.0, 2, 3
"""A pressure whose sensor is off all at once moves in a second by more than in AROUND before and behind it [standard
deviations], and does so once or twice."""

SPOKEN = 0.25
"""Of so large a part of the seconds a sensor of a buffer tells something new, if it speaks [1]."""

CHANNELS = np.array([place for place, sensor in enumerate(ANALOG) if kind_of(sensor) != "temperature"])
"""Channels that are compared; a thermometer may be slow."""

_TOLD = slice(FIRST_VALVE, FIRST_VALVE + len(VALVES))


class Rival(NamedTuple):
    """A valve that may be stuck, and how well readings fit if it is."""

    valve: int
    position: float  # 1: stuck open, -1: closed; 0: it works again
    gain: float  # of twice the logarithm of the likelihood, against that of valves as they are told [1]
    lead: float  # that it needs to be told [1]; inf where too much is still not explained


class Hypotheses:
    """Compare what each valve may be, block by block.

    Parameters
    ----------
    station : Station
        The station as it is known.
    model : EstimationModel
        Of its plant.
    """

    def __init__(self, station: Station, model: EstimationModel) -> None:
        self._station, self._model = station, model
        self._constants = model.constants_of(station)
        self._full = full_of(self._constants)
        self._seconds: Frames | None = None  # of this block and what filters need before it; valves as they were told
        self._fresh = 0  # how many are of this block
        self._position = np.zeros(len(VALVES))  # of the valves, as it was known when the block began

    def take(self, told: Frames, judged: Frames) -> None:
        """Keep seconds: valves as they were told, and all else as it was judged to be."""
        values = judged.values.copy()
        values[:, _TOLD] = told.values[:, _TOLD]
        seconds = replace(judged, values=values, raw=None)
        kept = seconds if self._seconds is None else self._seconds.followed_by(seconds)
        self._fresh += len(seconds)
        self._seconds = kept.part(max(0, len(kept) - self._fresh - SETTLING), len(kept))

    def end_block(self, m: ValveMemory) -> Rival | None:
        """End a block, and give the valve that is otherwise than was thought by what no other explains, if any.

        While one is known to be stuck none other is looked for, but whether it works again.
        """
        seconds, fresh, before = self._seconds, self._fresh, self._position
        self._fresh, self._position = 0, m.position.copy()
        same = bool((before == m.position).all()) and not m.untold.any()
        if seconds is None or fresh < BLOCK or not same or m.doubt[1] > 0.0:
            return None
        if not any(self._would_matter(seconds, valve, m.filled) for valve in range(len(VALVES))):
            return None
        told = self._follow(seconds)
        if m.position.any():
            return self._works_again(seconds, told, m)
        if _fits(told) or _is_loud(told) or _jumps(seconds) or not _all_speak(seconds):
            return None
        return _leader([self._rival(seconds, told, v, to, m.filled) for v in range(len(VALVES)) for to in (1.0, -1.0)])

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays."""
        kept = {} if self._seconds is None else self._seconds.arrays()
        return {"fresh": np.array(self._fresh), "position": self._position, **kept}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go on from the arrays of one of the same station.

        Raises
        ------
        InputError
            naming what none could have written.
        """
        refuse_other_shapes(arrays, {"fresh": np.array(0), "position": self._position})
        seconds, fresh = kept_frames(arrays), int(arrays["fresh"])
        if not 0 <= fresh <= (0 if seconds is None else len(seconds)):
            raise InputError("snapshot", [("fresh", f"cannot be read: of so many seconds none were kept: {fresh}")])
        self._seconds, self._fresh, self._position = seconds, fresh, arrays["position"].copy()

    def _follow(self, seconds: Frames) -> NDArray[np.float64]:
        """Innovations and errors of a filter that takes valves as they are told, (2, seconds, len(ANALOG))."""
        s = self._model.begin(seconds, self._station, ROBUST, self._constants)
        found = self._model.advance(seconds, len(seconds), s, self._station, ROBUST, self._constants)
        return np.stack((found.innovations, found.errors))

    def _would_matter(self, seconds: Frames, valve: int, filled: NDArray[np.float64]) -> bool:
        """Whether gas may have gone otherwise than it was told for a while, were a valve stuck open."""
        noise, m = np.ascontiguousarray(seconds.noise), _stuck(valve, 1.0, filled)
        return would_matter(seconds.values, noise, self._full, max(len(seconds) - BLOCK, 0), SURE, m)

    def _supposed(
        self, seconds: Frames, valve: int, position: float, filled: NDArray[np.float64], pressures: NDArray[np.float64]
    ) -> NDArray[np.float64]:  # fmt: skip
        """The values of a block if a valve is stuck; see `suppose`."""
        values, m = seconds.values.copy(), _stuck(valve, position, filled)
        suppose(values, np.ascontiguousarray(seconds.noise), self._full, pressures, m)
        return values

    def _suppose(
        self, seconds: Frames, valve: int, position: float, filled: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], bool]:  # fmt: skip
        """What `_follow` gives if a valve is stuck, and whether that surely lets gas through otherwise than was told.

        Which of two buffers is filled through one inlet or the other is a matter of their pressures. Where readings
        cannot tell it nobody knows at first; then what that filter makes of them tells it.
        """
        pressures = np.full((len(seconds), len(BUFFERS)), np.nan)
        for _ in range(PASSES if position > 0.0 and valve < len(BUFFERS) else 1):
            values = self._supposed(seconds, valve, position, filled, pressures)
            followed = self._follow(replace(seconds, values=values))
            pressures = values[:, : len(BUFFERS)] - followed[1][:, : len(BUFFERS)]
        surely = (values != seconds.values) & np.isfinite(values)
        return followed, bool(surely[-BLOCK:, _TOLD].any(axis=1).sum() >= SURE)

    def _rival(
        self, seconds: Frames, told: NDArray[np.float64], valve: int, position: float, filled: NDArray[np.float64]
    ) -> Rival:
        """How well a block fits if a valve is stuck."""
        followed, surely = self._suppose(seconds, valve, position, filled)
        if not surely:
            return Rival(valve, position, -np.inf, np.inf)
        gain = _gain(told, followed)
        if _fits(followed):
            return Rival(valve, position, gain, LEAD)
        return Rival(valve, position, gain, APART * gain if gain > max(LARGE, MOST * _excess(told)) else np.inf)

    def _works_again(self, seconds: Frames, told: NDArray[np.float64], m: ValveMemory) -> Rival | None:
        """The valve that alone was known to be stuck open, where a block fits as it was told, and not if it is."""
        valve = int(np.argmax(m.position))
        if np.abs(m.position).sum() != 1.0 or m.position[valve] != 1.0 or not _fits(told):
            return None
        followed, surely = self._suppose(seconds, valve, 1.0, m.filled)
        gain = _gain(followed, told)
        return Rival(valve, 0.0, gain, LEAD) if surely and gain > WORKS and not _fits(followed) else None


def full_of(constants: Any) -> tuple[float, float, float]:
    """The pressures below which buffers lie that are filled [bar], by the constants of a plant."""
    high, medium, low = (float(filled_to(bank, constants)) for bank in range(len(BUFFERS)))
    return high, medium, low


def _stuck(valve: int, position: float, filled: NDArray[np.float64]) -> ValveMemory:
    """The memory of valves of which one was stuck from the start."""
    m = valves_of_nothing()
    m.position[valve], m.filled[:] = position, filled
    return m


def _squares(followed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squares of a block's innovations in the channels that are compared."""
    return np.minimum(followed[0][-BLOCK:, CHANNELS] ** 2, CAP)


def _excess(followed: NDArray[np.float64]) -> float:
    """How much larger they are, all in all, than noise makes them."""
    return float(np.nansum(_squares(followed) - 1.0))


def _fits(followed: NDArray[np.float64]) -> bool:
    """Whether the readings of each channel are about as far off as noise makes them."""
    return bool((np.nansum(_squares(followed) - 1.0, axis=0) <= MISFIT).all())


def _gain(thought: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """What twice the logarithm of the likelihood gains by a hypothesis, of readings that both foretell.

    By innovations (Schweppe 1965, doi:10.1109/TIT.1965.1053737).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        scales = [2.0 * np.log(np.abs(each[1] / each[0]))[-BLOCK:, CHANNELS] for each in (thought, other)]
    worse = _squares(thought) + scales[0] - _squares(other) - scales[1]
    return float(worse[np.isfinite(worse)].sum())


def _jumps(seconds: Frames) -> bool:
    """Whether a buffer's pressure moves in a second as in none around it, once or twice: its sensor is off."""
    block = seconds.part(max(0, len(seconds) - BLOCK), len(seconds))
    moves = np.diff(block.values[:, : len(BUFFERS)], axis=0) / block.noise[1:, : len(BUFFERS)]
    around = sliding_window_view(np.pad(moves, ((AROUND, AROUND), (0, 0)), mode="edge"), 2 * AROUND + 1, axis=0)
    usual = np.median(np.nan_to_num(around), axis=2)
    jumps = (np.abs(moves - usual) > JUMP).sum(axis=0)
    return bool(((jumps > 0) & (jumps <= JUMPS)).any())


def _is_loud(followed: NDArray[np.float64]) -> bool:
    """Whether one channel is noisier than its tag says; see `station.estimation.noise`.

    A valve that moves often and is stuck makes more than one seem so.
    """
    changes = np.diff(np.clip(followed[0][-BLOCK:, CHANNELS], -CAP, CAP), axis=0) ** 2 / 2.0
    return int((np.nansum(changes, axis=0) > LOUD**2 * np.isfinite(changes).sum(axis=0)).sum()) == 1


def _all_speak(seconds: Frames) -> bool:
    """Whether no sensor of a buffer is left out, silent, frozen, or told again and again."""
    values = seconds.values[-BLOCK:, [ANALOG.index(sensor) for sensor in BANK_SENSORS]]
    return all(len(np.unique(column[np.isfinite(column)])) >= SPOKEN * BLOCK for column in values.T)


def _leader(rivals: list[Rival]) -> Rival | None:
    """The hypothesis that gains most, if it gains enough, leads all others, and explains what was read.

    A valve that is stuck closed is told by `station.estimation.valves.silence`, or not at all: a machine that fails
    looks like one.
    """
    first, second = sorted(rivals, key=lambda rival: rival.gain, reverse=True)[:2]
    surely = first.position > 0.0 and first.gain > GAIN
    return first if surely and first.gain - max(second.gain, 0.0) > first.lead else None
