"""One buffer stays able to begin a fill: Eq. (7.11) keeps an empty vehicle from gas of a buffer that is too full.

Nothing but a vehicle empties a buffer. Where all are too full for the one that has come it gets no gas for good.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from station.compiled import formula, inlined
from station.geometry import KELVIN
from station.limits import start_limit
from station.plants.interface import Constants
from station.plants.thesis import PlantConstants

START_SHARE = 0.95
"""Who looks at pressures alone does not fill low beyond this share of `start_limit`, so that a fill can begin whatever
a vehicle holds: once as warm as its surroundings a cold low has risen by less than the rest."""

FILLED_SHARE, ABLE_SHARE = 0.99, 0.995
"""Who looks at temperatures too does not fill the last buffer able to begin a fill beyond the first of these shares,
and counts another as able up to the second: a second's filling is less than what lies between, and than the rest."""


class Starts(NamedTuple):
    """The rule that keeps a buffer for the next fill to begin; see `starts_for`."""

    filled: float = np.inf  # from here on the last buffer able to begin a fill is not filled [bar]; infinite: it may be
    able: float = np.inf  # up to here another buffer is able to [bar]
    ambient: float = 25.0  # towards which closed buffers go [deg C]


@formula
def full_low(plant: Constants) -> float:
    """Pressure up to which low is filled by who looks at pressures alone [bar]."""
    return START_SHARE * start_limit(plant)


def starts_for(emptiest: float | None, plant: Constants, ambient: float) -> Starts:
    """The rule for vehicles that come with `emptiest` [bar] or more, in surroundings of `ambient` [deg C].

    Without `emptiest` there is none.
    """
    if emptiest is None:
        return Starts()
    limit = float(start_limit(plant))
    return Starts(FILLED_SHARE * limit + emptiest, ABLE_SHARE * limit + emptiest, ambient)


def may_bar(starts: Starts, plant: PlantConstants) -> bool:
    """Whether the rule can ever keep an inlet closed: a buffer as full and as cold as can be would warm beyond it."""
    coldest = plant.ambient_temperature - max(plant.outlet_cooling) / max(plant.heat_exchange, 1e-12)
    if coldest <= -KELVIN:
        return starts.filled < np.inf
    return bool(starts.filled < rested(plant.compressor_pressure, coldest, plant.ambient_temperature))


@inlined
def rested(pressure: float, temperature: float, ambient: float) -> float:
    """The highest pressure of a closed buffer from now on [bar]: what is cold warms."""
    return pressure * (max(temperature, ambient) + KELVIN) / (temperature + KELVIN)


@inlined
def barred_inlets(pressure: tuple[float, float, float], temperature: tuple[float, float, float], starts: Starts) -> int:
    """The inlet of the last buffer that is able to begin a fill, once it is filled as far as it may be; or 0."""
    if starts.filled == np.inf:
        return 0
    lowest, least, others = -1, np.inf, np.inf
    for buffer in range(3):
        found = rested(pressure[buffer], temperature[buffer], starts.ambient)
        if found < least:
            lowest, least, others = buffer, found, least
        else:
            others = min(others, found)
    return 1 << lowest if least >= starts.filled and others > starts.able else 0
