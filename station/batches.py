"""A batch of measurements: samples of some tags as a source sends them, in any order."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from station.measurement import Samples, Tag, TagMap, read_samples


class Quality(IntEnum):
    """Quality of a sample, the three levels of OPC UA (Part 8)."""

    BAD = 0
    UNCERTAIN = 1
    GOOD = 2


@dataclass(frozen=True)
class Batch:
    """Samples of the tags of a map; where two have one tag and time, the later one counts."""

    tag: NDArray[np.int16]  # (k,) place among the tags of the map
    time: NDArray[np.float64]  # (k,) of the source's clock [s]
    value: NDArray[np.float64]  # (k,) as the source gives it, before scale and offset; NaN where there is none
    quality: NDArray[np.uint8]  # (k,) a Quality

    def __len__(self) -> int:
        return len(self.tag)

    def samples(self, tags: TagMap) -> list[Samples]:
        """The samples of each tag that has any, in sensors' units, in the order in which they came."""
        found = []
        for place in np.unique(self.tag):
            of_it = self.tag == place
            tag: Tag = tags.tags[place]
            quality = self.quality[of_it]
            uncertain, bad = quality == Quality.UNCERTAIN, quality == Quality.BAD
            found.append(read_samples(tag, self.time[of_it], self.value[of_it], uncertain, bad))
        return found
