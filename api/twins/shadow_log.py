"""Stretches of a live twin's time for shadows: its state at their begin, and what came until their end."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from api.twins.shadow_schemas import ShadowRequest
from station.archives import arrays_under, pack

DUE_MAX = 32
"""Stretches that are over may wait so many to be taken; beyond it the oldest are left out."""

_HEAD = "shadow_"


@dataclass
class Stretch:
    """A stretch of a twin's time. A twin adds to it while it lasts; nothing changes it afterwards."""

    begin: int  # [s]
    end: int  # [s]
    controller: str  # that acted at its begin; "" where the twin does not know it
    state: bytes  # arrays of the state at its begin, packed
    came: list[tuple[float, ...]] = field(default_factory=list)  # figures of the vehicles that arrived, as `Vehicles`
    pressures: list[tuple[float, ...]] = field(default_factory=list)  # of the buffers, each minute [bar]
    changed: bool = False  # another controller decided before its end

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        return {
            "numbers": np.array([self.end, self.changed], np.int64),
            "controller": np.array(self.controller),
            "state": np.frombuffer(self.state, np.uint8),
            "came": np.array(self.came, np.float64).reshape(-1, 5),
            "pressures": np.array(self.pressures, np.float64).reshape(-1, 3),
        }

    @classmethod
    def of(cls, begin: int, kept: Mapping[str, np.ndarray]) -> Stretch:
        """The stretch that `memories` told."""
        end, changed = kept["numbers"].tolist()
        came, pressures = ([tuple(row) for row in kept[name].tolist()] for name in ("came", "pressures"))
        return cls(begin, end, str(kept["controller"]), kept["state"].tobytes(), came, pressures, bool(changed))


class ShadowLog:
    """The stretches of a twin that last, and those that are over and not taken yet.

    The twin's thread adds, others read `due`.
    """

    def __init__(self, settings: ShadowRequest | None) -> None:
        self.settings = settings
        self.lasting: deque[Stretch] = deque()  # the oldest first
        self.due: tuple[Stretch, ...] = ()  # likewise
        self.left_out = 0  # that were over when too many waited

    def restart(self, settings: ShadowRequest | None) -> None:
        """Begin with other settings: what lasted counts no more."""
        self.settings = settings
        self.lasting.clear()
        self.due = ()

    def begins(self, second: int) -> bool:
        """Whether a stretch begins with a second."""
        return self.settings is not None and second % self.settings.every_s == 0

    def open(self, second: int, controller: str, arrays: Mapping[str, np.ndarray]) -> None:
        """A stretch begins."""
        if self.settings is not None:
            self.lasting.append(Stretch(second, second + self.settings.horizon_s, controller, pack(arrays)))

    def close(self, second: int) -> None:
        """A second has been told: stretches that end with it are over."""
        while self.lasting and self.lasting[0].end <= second:
            self.due = (*self.due, self.lasting.popleft())
        if len(self.due) > DUE_MAX:
            self.left_out += len(self.due) - DUE_MAX
            self.due = self.due[-DUE_MAX:]

    def change(self) -> None:
        """Another controller decides from now on."""
        for stretch in self.lasting:
            stretch.changed = True

    def taken(self, begin: int) -> None:
        """The stretch that begins then was taken."""
        self.due = tuple(each for each in self.due if each.begin != begin)

    def memories(self) -> dict[str, np.ndarray]:
        """Arrays for a snapshot, by name."""
        if self.settings is None:
            return {}
        kept = {
            f"{_HEAD}{each.begin}_{name}": array
            for each in (*self.due, *self.lasting)
            for name, array in each.memories().items()
        }
        return {f"{_HEAD}left": np.array(self.left_out), **kept}

    def resume(self, memories: Mapping[str, Any], now: int) -> None:
        """Go on at second `now` from a snapshot; from one without shadows they begin then."""
        kept = arrays_under(memories, _HEAD)
        if self.settings is None or "left" not in kept:
            return
        self.left_out = int(kept.pop("left"))
        begins = sorted({int(name.partition("_")[0]) for name in kept})
        self.lasting = deque(Stretch.of(begin, arrays_under(kept, f"{begin}_")) for begin in begins)
        self.close(now - 1)
