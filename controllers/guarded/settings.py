"""Settings of the guarded controller: those of `switched`, and the promise it keeps."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from controllers.reserve.recovery import highest_of
from controllers.reserve.settings import SETTINGS_SIZE as RULE_SIZE
from controllers.reserve.settings import Gap, ReserveSettings, Share, full_pressures, reserve_vector
from controllers.switched.settings import SwitchedSettings, target_masses, usual_compression, usual_fill
from controllers.switched.vector import settings_vector
from station.compiled import kernel
from station.geometry import KELVIN
from station.parameters import Station
from station.planning import gas_mass
from station.whole import WHOLE

READY_SHARE = 0.9
"""A buffer is ready with this share of its initial mass, or of what a plan keeps in it if that is less, where the
station does not say: a promise of more keeps the rule in charge all day."""

WITHIN = 1.5
"""A vehicle is to be finished, and the buffers ready, within so many times what the usual one takes of dispenser and
compressor together, where the station does not say."""

Bar = Annotated[float, Field(gt=0, le=2000, allow_inf_nan=False, json_schema_extra={"unit": "bar"})]
Seconds = Annotated[int, Field(ge=1, le=86_400, json_schema_extra={"unit": "s"}), WHOLE]


class GuardedSettings(SwitchedSettings):
    """Settings of `guarded`: those of `switched`, and what has to stay in reach of the reserve rule."""

    within_s: Annotated[
        Seconds | None,
        Field(description="A vehicle is finished so long after it has connected; left out: by the usual one"),
    ] = None
    ready_s: Annotated[
        Seconds | None,
        Field(description="Buffers are ready so long after a connection, where nobody waits; left out: `within_s`"),
    ] = None
    ready_high_bar: Annotated[
        Bar | None,
        Field(
            description="A ready high buffer holds what it does at this pressure and ambient temperature; left "
            "out: 0.9 of what it holds at first, or of what a plan keeps if that is less"
        ),
    ] = None
    ready_medium_bar: Annotated[Bar | None, Field(description="The same of medium")] = None
    ready_low_bar: Annotated[Bar | None, Field(description="The same of low; left out: by what it holds at first")] = (
        None
    )
    open_bar: Annotated[
        Gap | None, Field(description="`open_bar` of the reserve rule that takes over; left out: the station's")
    ] = None
    stop_share: Annotated[
        Share | None, Field(description="`stop_share` of the reserve rule that takes over; left out: the station's")
    ] = None
    colder_k: Annotated[
        float,
        Field(
            ge=0, le=150, allow_inf_nan=False, description="How far below ambient temperature a ready buffer may be",
            json_schema_extra={"unit": "K"},
        ),
    ] = 10.0  # fmt: skip


class Promise(NamedTuple):
    """Conditions that have to stay in reach of the reserve rule."""

    within: float  # from a connection to the end of the fill [s]
    ready: float  # from a connection, or when the vehicle has left, until the buffers are ready [s]
    high: float  # least masses of ready buffers [g]
    medium: float
    low: float
    cold: float  # least temperature of a ready buffer [deg C]
    top: float  # greatest pressure of one, once it is no colder than the surroundings [bar]


PROMISE_SIZE = len(Promise._fields)
_RULE = PROMISE_SIZE
OWN = PROMISE_SIZE + RULE_SIZE
"""Entries before those of `switched`."""


def ready_masses(settings: GuardedSettings, station: Station) -> list[float]:
    """Least masses of ready buffers [g], high, medium, low."""
    ambient, model, found = station.thermal.ambient_temperature_c, station.control_constants(), []
    given = (settings.ready_high_bar, settings.ready_medium_bar, settings.ready_low_bar)
    for bar, tank, target in zip(given, station.buffers.all, target_masses(settings, station), strict=True):
        first = gas_mass(tank.initial_pressure_bar, tank.initial_temperature_c, tank.volume_m3, model)
        usual = READY_SHARE * min(first, target)
        found.append(float(usual if bar is None else gas_mass(bar, ambient, tank.volume_m3, model)))
    return found


def promise_of(settings: GuardedSettings, rule: ReserveSettings, station: Station) -> Promise:
    """The promise of a controller at a station; its greatest pressure is what the rule fills the coldest buffer to."""
    plant, full = station.constants(), full_pressures(rule, station)
    usual = WITHIN * (usual_fill(station) + usual_compression(station))
    within = float(int(usual) if settings.within_s is None else settings.within_s)
    ready = within if settings.ready_s is None else float(settings.ready_s)
    cold = station.thermal.ambient_temperature_c - settings.colder_k
    high, medium, low = ready_masses(settings, station)
    filled = max(highest_of(buffer, plant.limits.buffer_temperature_max, full[buffer], plant) for buffer in range(3))
    top = filled * (plant.ambient_temperature + KELVIN) / (cold + KELVIN)
    return Promise(within, ready, high, medium, low, cold, top)


def guarded_vector(settings: GuardedSettings, rule: ReserveSettings, station: Station) -> np.ndarray:
    """The settings the compiled controller reads: Promise, those of the reserve rule, those of `switched`."""
    promise = promise_of(settings, rule, station)
    return np.concatenate((promise, reserve_vector(rule, station), settings_vector(settings, station)))


@kernel
def promise_in(vector: np.ndarray) -> Promise:
    """The promise in the vector."""
    return Promise(vector[0], vector[1], vector[2], vector[3], vector[4], vector[5], vector[6])


@kernel
def rule_in(vector: np.ndarray) -> np.ndarray:
    """The settings of the reserve rule in the vector (RULE_SIZE,)."""
    return vector[_RULE:OWN]
