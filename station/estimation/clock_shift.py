"""Seconds of sources whose clocks are apart, put side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from station.archives import arrays_under, refuse_other_shapes
from station.errors import InputError
from station.frames import Frames, as_kept_now, kept_frames, told_each_second
from station.measurement import TagMap
from station.sensor_names import ANALOG, SENSORS

SKEW_MAX = 6
"""Largest skew that is looked for [s], in whole seconds."""


class ClockShift:
    """Let seconds through, those of a source whose clock is fast from so many seconds later.

    Parameters
    ----------
    tags : TagMap
        What is measured, by sources.
    """

    def __init__(self, tags: TagMap) -> None:
        _, *others = tags.sources
        self._told = told_each_second(tags.tags)
        self._columns = {source: columns_of(tags, source) for source in others}
        self.skew = dict.fromkeys(others, 0)
        self._kept: Frames | None = None  # seconds let through that may be needed once more, and those that wait
        self._through = 0  # how many of them were let through

    def push(self, frames: Frames) -> Frames:
        """Take the seconds that follow, and give those whose readings are all there."""
        kept = frames if self._kept is None else self._kept.followed_by(frames)
        return self._let(kept, max(self._through, len(kept) - max(0, 0, *self.skew.values())))

    def close(self) -> Frames | None:
        """The seconds that wait, whose later readings do not come; None where none came at all."""
        return None if self._kept is None else self._let(self._kept, len(self._kept))

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything needed to go on, as arrays."""
        kept = {} if self._kept is None else {f"kept_{name}": each for name, each in self._kept.arrays().items()}
        return {"skew": np.array([*self.skew.values()], np.int64), "through": np.array(self._through), **kept}

    def restore(self, arrays: dict[str, np.ndarray], *, renewed: bool = False) -> None:
        """Go on from the arrays of one of the same tags; `renewed`: of another version.

        Raises
        ------
        InputError
            naming what none could have written.
        """
        refuse_other_shapes(arrays, {"skew": np.zeros(len(self.skew), np.int64), "through": np.array(0)})
        seconds = arrays_under(arrays, "kept_")
        kept, through = kept_frames(as_kept_now(seconds) if renewed else seconds, self._told), int(arrays["through"])
        if not 0 <= through <= (0 if kept is None else len(kept)):
            raise InputError("snapshot", [("through", f"cannot be read: so many seconds were not kept: {through}")])
        self._kept, self._through = kept, through
        self.skew = dict(zip(self.skew, arrays["skew"].tolist(), strict=True))

    def _let(self, kept: Frames, until: int) -> Frames:
        ready = kept
        for source, skew in self.skew.items():
            ready = shifted(ready, self._columns[source], skew)
        found = ready.part(self._through, until)
        first = max(0, until - SKEW_MAX)
        self._kept, self._through = kept.part(first, len(kept)), until - first
        return found


def columns_of(tags: TagMap, source: str) -> NDArray[np.int64]:
    """Places in SENSORS of the sensors of a source."""
    return np.array([SENSORS.index(tag.sensor) for tag in tags.tags if tag.source == source], np.int64)


def shifted(frames: Frames, columns: NDArray[np.int64], shift: int) -> Frames:
    """The seconds with these columns as they were told so much later: what a clock that is fast stamped.

    Parameters
    ----------
    frames : Frames
        As their clocks tell them.
    columns : ndarray, shape (k,)
        Places in SENSORS.
    shift : int
        By how much the clock is fast [s]; where it reaches beyond the seconds nothing is known.
    """
    if shift == 0:
        return frames
    later = np.arange(len(frames)) + shift
    there = ((later >= 0) & (later < len(frames)))[:, None]
    later = np.clip(later, 0, max(len(frames) - 1, 0))
    analog = columns[columns < len(ANALOG)]
    values, noise = frames.values.copy(), frames.noise.copy()
    values[:, columns] = np.where(there, values[np.ix_(later, columns)], np.nan)
    noise[:, analog] = np.where(there, noise[np.ix_(later, analog)], noise[:, analog])
    return replace(frames, values=values, noise=noise)
