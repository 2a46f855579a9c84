"""The ramp of a fill, chosen by the model: the largest with which the worst tank for all that is known stays cool."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from station.errors import StationError
from station.geometry import KELVIN
from station.plants.real_gas.catalog import DISPENSING, TEMPERATURE_LIMIT, TankKind, vehicle_tank
from station.plants.real_gas.fill import PERIOD, Dispenser, ends_of, run_fill
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.tables import gas_tables
from station.plants.real_gas.tank import Tank, fill_state, look, state_length

Range = tuple[float, float]

_LIMITS = DISPENSING["limits"]
_UNCERTAINTY = DISPENSING["uncertainty"]
_PER_MINUTE = 1e6 / 60
RAMP_MAX = float(_LIMITS["ramp_max_MPa_min"]) * _PER_MINUTE
"""The steepest ramp of a dispenser [Pa/s]."""

RAMP_MIN = float(_LIMITS["ramp_min_MPa_min"]) * _PER_MINUTE
"""The gentlest [Pa/s]."""

_RESOLUTION = 0.02 * _PER_MINUTE
_PRESSURE_MIN = BAR
_NOTHING = np.zeros((6, 0))


class Spread(NamedTuple):
    """Between what values the vehicle and the gas lie for all the station knows."""

    volume: Range  # [m3]
    pressure: Range  # at the start [Pa]
    ambient: Range  # [K]
    soak: Range  # of the tank against the ambient temperature [K]
    delivery: Range  # of the gas at the nozzle [K]
    cooldown: Range  # before it is so cold [s]


class Corner(NamedTuple):
    """One tank within a spread."""

    volume: float
    pressure: float
    ambient: float
    soak: float
    delivery: float
    cooldown: float


class RampChoice(NamedTuple):
    """The ramp of a fill, and why not a larger one."""

    ramp: float  # [Pa/s]
    corner: Corner  # the worst tank
    peak: float  # highest temperature of its gas with that ramp [K]
    is_bound: bool  # whether a larger ramp would be too hot for it; else the dispenser has no larger one
    fills: int  # simulated for the choice


def usual_spread(volume: float, pressure: float, ambient: float, delivery: float, cooldown: float = 0.0) -> Spread:
    """The stated uncertainty about what the station is told: volume [m3], pressure [Pa], temperatures [K], time [s]."""
    share = float(_UNCERTAINTY["volume_percent"]) / 100
    low, soak = float(_UNCERTAINTY["start_pressure_bar"]) * BAR, float(_UNCERTAINTY["soak_K"])
    air, gas = float(_UNCERTAINTY["ambient_K"]), float(_UNCERTAINTY["delivery_K"])
    return Spread(
        (volume * (1 - share), volume * (1 + share)),
        (max(pressure - low, _PRESSURE_MIN), pressure + low),
        (ambient - air, ambient + air),
        (-soak, soak),
        (delivery - gas, delivery + gas),
        (0.0, cooldown + float(_UNCERTAINTY["cooldown_s"])),
    )


def class_spread(ambient: Range, delivery: float) -> Spread:
    """Any light-duty tank at ambient temperatures between two [K]: nothing is told."""
    scope = DISPENSING["light_duty_class"]
    low, high = (float(litres) * 1e-3 for litres in scope["volume_L"])
    empty, half = (float(bar) * BAR for bar in scope["start_pressure_bar"])
    soak, gas = float(_UNCERTAINTY["soak_K"]), float(_UNCERTAINTY["delivery_K"])
    cooldown = (0.0, float(scope["cooldown_s"]))
    return Spread((low, high), (empty, half), ambient, (-soak, soak), (delivery - gas, delivery + gas), cooldown)


class _Bench:
    """Fills of the corners of a spread, at any ramp."""

    def __init__(self, kind: TankKind, spread: Spread, target: float, flow_max: float, pressure: float | None) -> None:
        self.kind = kind
        self.target = target
        self.flow_max = flow_max
        self.pressure = pressure
        self.fills = 0
        low, high = spread.volume
        self.tanks: dict[float, Tank] = {}
        for volume in sorted({low, (low + high) / 2, high}):
            self.tanks[volume] = vehicle_tank(kind._replace(volume=volume), PERIOD)
        self.corners = list(self._corners(spread))

    def _corners(self, spread: Spread) -> Iterator[Corner]:
        """Volumes also in the middle: beside the limit of flow the worst need not be the largest."""
        ends = [sorted(set(limits)) for limits in spread[1:]]
        yield from (Corner(*given) for given in product(self.tanks, *ends))

    def fill(self, corner: Corner, ramp: float, *, full: bool = False) -> tuple[float, float]:
        """Highest temperature [K] and last pressure [Pa] of a fill that no temperature ends; `full` to 100 %."""
        self.fills += 1
        gas, tank = gas_tables(), self.tanks[corner.volume]
        state = np.zeros(state_length(tank))
        kelvin = corner.ambient + corner.soak
        fill_state(state, 0, tank, corner.pressure, kelvin, kelvin, gas)
        dispenser = Dispenser(ramp, self.flow_max, corner.delivery, corner.cooldown)
        kind = self.kind._replace(volume=corner.volume)
        ends = ends_of(kind, 1.0 if full else self.target, None if full else self.pressure, np.inf)
        _, _, peak = run_fill(state, tank, dispenser, ends, corner.ambient, PERIOD, _NOTHING, gas)
        return peak, look(state, 0, tank, gas)[0]

    def peaks(self, corners: list[Corner], ramp: float) -> list[float]:
        """How hot the gas of each corner becomes at a ramp [K]."""
        return [self.fill(corner, ramp)[0] for corner in corners]


def choose_ramp(
    kind: TankKind, spread: Spread, target: float, flow_max: float, *, limit: float = TEMPERATURE_LIMIT,
    pressure_target: float | None = None,
) -> RampChoice:  # fmt: skip
    """The largest ramp with which every corner of a spread stays below a temperature.

    The worst corner alone is bisected; then those that were too hot before are filled with what was found, and where
    another one still is too hot it is bisected in turn. A corner that a steeper ramp did not heat too much stays out.

    Parameters
    ----------
    kind
        Class and nominal working pressure; the volumes are the spread's.
    spread
        What the station knows of the vehicle and of its own gas.
    target
        State of charge of the fill's end.
    flow_max
        The nozzle's limit [kg/s].
    limit
        Of the gas in the tank [K].
    pressure_target
        The pressure that ends the fill where the vehicle does not communicate [Pa].

    Raises
    ------
    StationError
        if a tank is too hot even with the gentlest ramp.
    """
    bench = _Bench(kind, spread, target, flow_max, pressure_target)
    ramp, corners = RAMP_MAX, bench.corners
    peaks = bench.peaks(corners, ramp)
    is_bound = max(peaks) >= limit
    while max(peaks) >= limit:
        ramp = _bisected(bench, corners[int(np.argmax(peaks))], ramp, limit)
        corners = [corner for corner, peak in zip(corners, peaks, strict=True) if peak >= limit]
        peaks = bench.peaks(corners, ramp)
    worst = int(np.argmax(peaks))
    return RampChoice(ramp, corners[worst], peaks[worst], is_bound, bench.fills)


def _bisected(bench: _Bench, corner: Corner, high: float, limit: float) -> float:
    """The largest ramp below `high` [Pa/s], which is too steep, that keeps a corner below a temperature [K]."""
    low = RAMP_MIN
    if bench.fill(corner, low)[0] >= limit:
        raise StationError(
            f"no ramp from {RAMP_MIN / _PER_MINUTE:g} MPa/min on keeps a {bench.kind.kind} tank of "
            f"{corner.volume * 1e3:.4g} L, filled from {corner.pressure / BAR:.4g} bar at "
            f"{corner.ambient - KELVIN:.4g} degC, below {limit - KELVIN:g} degC"
        )
    while high - low > _RESOLUTION:
        middle = (low + high) / 2
        low, high = (low, middle) if bench.fill(corner, middle)[0] >= limit else (middle, high)
    return low


def safe_pressure(kind: TankKind, spread: Spread, ramp: float, flow_max: float) -> float:
    """The pressure [Pa] at which the coldest tank of a spread is full: where a fill without communication ends."""
    bench = _Bench(kind, spread, 1.0, flow_max, None)
    return min(bench.fill(corner, ramp, full=True)[1] for corner in bench.corners)
