"""Grids on which the potentials of the bounds are defined: domains no run can leave, and the nodes on them.

A buffer is described by its temperature and its reference pressure r, the pressure [bar] its mass would have at
ambient temperature: filling and drawing move both, time alone moves only the temperature. Its pressure is r theta
with theta the ratio of absolute temperatures. A vehicle is described by its pressure and temperature. Along either
pressure a potential is a spline on a scale that runs as the time of filling does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from station.bounds.scale import Scale
from station.bounds.spline import Axis, Floats, value
from station.errors import InputError
from station.geometry import KELVIN
from station.parameters import Station
from station.plants.thesis import SPECIFIC_GAS, PlantConstants, gas_pressure, refuse_others

PAD = 1e-6
"""Kelvin and bar by which domains are wider than the argument needs, for the rounding of a simulation."""

COLDEST = -200.0
"""Buffers that could get colder than this are refused [deg C]: gas laws would break before the bound did."""


_SOFT = 0.02
"""Share of the compressor's pressure by which the scale of pressure ends above it."""


_BEYOND = 0.12
"""Width of a cell of pressure above the compressor's, as a share of that."""


@dataclass(frozen=True)
class Resolution:
    """How many cells the potentials have; any number gives a proof, more give a tighter bound."""

    reference: int = 14  # of a buffer's reference pressure
    warm: float = 16.0  # width above ambient temperature [K]
    cold: float = 16.0  # width below it [K]
    pressure: int = 14  # of a vehicle's pressure
    temperature: int = 4  # of a vehicle's temperature
    flows: int = 15  # nodes of flow at which draws are priced while potentials are looked for
    step: float = 1.25  # between the pressures at which draws are priced [bar]


FINE = Resolution()
COARSE = Resolution(reference=8, warm=40.0, cold=50.0, pressure=6, temperature=2, flows=8, step=4.0)


@dataclass(frozen=True)
class Grid:
    """Domains and nodes of one station and its usual range of vehicles."""

    station: Station
    plant: PlantConstants
    resolution: Resolution
    reference_scale: Scale
    reference: Floats  # r, from the least to the most there can be [bar]
    temperature: Floats  # of a buffer [deg C]; ambient temperature is one of them
    pressure_scale: Scale
    pressure: Floats  # of a vehicle, up to the highest finish pressure [bar]
    vehicle_temperature: Floats  # [deg C]

    def theta(self, temperature: Floats) -> Floats:
        """Absolute temperature as a share of the ambient one."""
        return (temperature + KELVIN) / (self.plant.ambient_temperature + KELVIN)

    def bar_per_gram(self, volume: float) -> float:
        """Reference pressure that a gram adds to a tank of `volume` [m3]: kappa [bar/g]."""
        return SPECIFIC_GAS * (self.plant.ambient_temperature + KELVIN) / volume

    @property
    def kappa(self) -> tuple[float, float, float]:
        """Of the three buffers [bar/g]."""
        high, medium, low = (self.bar_per_gram(volume) for volume in self.plant.buffer_volume)
        return high, medium, low

    @property
    def flow_range(self) -> tuple[float, float]:
        """Least and largest flow through an open outlet, Eqs (7.12) and (7.11) [g/s]."""
        plant = self.plant
        return plant.outlet_coefficient * plant.limits.outlet_gap_min, plant.limits.dispenser_flow_max

    @property
    def pressure_max(self) -> float:
        """No buffer ever has more [bar].

        A second of filling leaves r theta(T) <= p_com for the T it began at, and heats by c_T_in at most. Afterwards
        time cools the buffer, or warms it to the ambient temperature if it was filled below that.
        """
        low = self.temperature[0]
        warmed = (self.plant.ambient_temperature + KELVIN) / (low + KELVIN)
        heated = 1 + (max(self.plant.inlet_heating) + PAD) / (low + KELVIN)
        exchange = 1 + self.plant.heat_exchange * (self.plant.ambient_temperature - low) / (low + KELVIN)
        return float(self.plant.compressor_pressure * warmed * heated * exchange) + PAD

    @cached_property
    def stock_axes(self) -> tuple[Axis, Axis]:
        """Splines of a buffer's potential: reference pressure on its scale, temperature, creased at the ambient one."""
        crease = int(np.argmin(np.abs(self.temperature - self.plant.ambient_temperature)))
        return Axis(self.reference_scale.position(self.reference)), Axis(self.temperature, crease)

    @cached_property
    def service_axes(self) -> tuple[Axis, Axis]:
        """Splines of a vehicle's U: pressure on its scale, temperature."""
        return Axis(self.pressure_scale.position(self.pressure)), Axis(self.vehicle_temperature)

    @property
    def ambient(self) -> int:
        """Which coefficient along a buffer's temperature is the value at the ambient temperature."""
        crease = self.stock_axes[1].crease
        return 0 if crease is None else crease + 1

    def stock_value(self, coefficients: Floats, reference: float, temperature: float) -> float:
        """A buffer's potential."""
        return value(self.stock_axes, coefficients, self._on(self.reference_scale, reference), temperature)

    def service_value(self, coefficients: Floats, pressure: float, temperature: float) -> float:
        """A vehicle's U."""
        return value(self.service_axes, coefficients, self._on(self.pressure_scale, pressure), temperature)

    @staticmethod
    def _on(scale: Scale, pressure: float) -> float:
        return float(scale.position(np.array([pressure]))[0])

    def start(self, buffer: int) -> tuple[float, float]:
        """Reference pressure and temperature a run begins with."""
        tank = self.station.buffers.all[buffer]
        temperature = tank.initial_temperature_c
        return float(tank.initial_pressure_bar / self.theta(np.array([temperature]))[0]), temperature

    def lowest(self, buffer: int) -> float:
        """No buffer's reference pressure ever falls below this [bar]."""
        drawn = _lowest_drawn(self.plant, float(self.pressure[0]), float(self.temperature[-1]))
        return min(self.start(buffer)[0], drawn)

    def restoring(self, buffer: int, reference: Floats) -> Floats:
        """Compressor-seconds that `t_comp_restored` adds for a buffer that ends at these reference pressures.

        The formula of `station.metrics`: a refill to the initial mass at 25 deg C.
        """
        kappa, plant, start = self.kappa[buffer], self.plant, self.start(buffer)[0]
        volume = plant.buffer_volume[buffer]
        bar = float(gas_pressure(1.0, 25.0, volume))
        left = plant.compressor_pressure - start / kappa * bar
        if left <= 0:
            return np.where(reference < start, np.inf, 0.0)
        missing = plant.compressor_pressure - np.minimum(reference, start) / kappa * bar
        return np.log(missing / left) / -np.log1p(-plant.inlet_coefficient * bar)

    def restoring_bend(self, buffer: int) -> float:
        """The most of the second derivative of `restoring` on the scale, on either side of the initial pressure.

        Missing pressure is q + rho exp(-z) there; its logarithm has second derivative q x / (q + x)^2 with
        x = rho exp(-z), at most 1/4, and below 0 if q is. Above the compressor's pressure it is concave.
        """
        plant = self.plant
        bar = float(gas_pressure(1.0, 25.0, plant.buffer_volume[buffer]))
        beyond = plant.compressor_pressure - bar / self.kappa[buffer] * self.reference_scale.end
        return 0.25 / -float(np.log1p(-plant.inlet_coefficient * bar)) if beyond > 0 else 0.0


def make_grid(station: Station, resolution: Resolution, start: tuple[float, float], finish: float) -> Grid:
    """The grid for vehicles that start within `start` [bar] and finish at `finish` [bar] at most.

    A buffer's temperature T becomes (1 - c_Tn) T + c_Tn T_env plus at least -c_T_out, so it never falls below
    T_env - c_T_out / c_Tn (nor below its initial one); filling ends at T_bmax by Eq. (7.15). An inlet is open only
    below the compressor's pressure and a second cannot overshoot it at constant temperature
    (`Station._check_filling`), so r theta(T) <= p_com at the temperature of that second.

    Raises
    ------
    InputError
        if buffers that are drawn from could get colder than COLDEST.
    PlantError
        for a station with another plant than the thesis's.
    """
    refuse_others(station.plant, "bounds")
    plant = station.constants()
    ambient, exchange = plant.ambient_temperature, plant.heat_exchange
    cooling = max(plant.outlet_cooling)
    coldest = ambient - (cooling / exchange if exchange > 0 else np.inf if cooling > 0 else 0.0)
    if coldest < COLDEST:
        least = cooling / (ambient - COLDEST)
        problem = f"must be at least {least:.3g} 1/s for a bound, or drawing could cool a buffer below {COLDEST:g} degC"
        raise InputError("bound", [("station.thermal.heat_exchange_per_s", f"{problem}; given {exchange:g}")])
    low = min(coldest, ambient - 1.0, *(tank.initial_temperature_c for tank in station.buffers.all)) - PAD
    high = max(plant.limits.buffer_temperature_max, ambient + 1.0) + PAD
    warm = max(2, 1 + round((high - ambient) / resolution.warm))
    cold = max(2, 1 + round((ambient - low) / resolution.cold))
    temperature = np.concatenate((np.linspace(low, ambient, cold)[:-1], np.linspace(ambient, high, warm)))
    scale = Scale(plant.compressor_pressure * (1 + _SOFT), plant.compressor_pressure * _SOFT)
    top = plant.compressor_pressure * (ambient + KELVIN) / (low + KELVIN) + PAD
    usual = station.vehicle.start_temperature_c
    vehicle_low = min(usual, ambient) - PAD
    vehicle_high = max(plant.limits.vehicle_temperature_max, ambient, usual, vehicle_low + 1.0) + PAD
    least = start[0] * (vehicle_low + KELVIN) / (usual + KELVIN) - PAD
    begins = [
        tank.initial_pressure_bar * (ambient + KELVIN) / (tank.initial_temperature_c + KELVIN)
        for tank in station.buffers.all
    ]
    bottom = max(0.0, min(_lowest_drawn(plant, least, high), *begins) - PAD)
    return Grid(
        station,
        plant,
        resolution,
        scale,
        _references(scale, plant.compressor_pressure, bottom, top, resolution.reference),
        temperature,
        replace(scale, end=scale.end - plant.limits.outlet_gap_min),
        _spaced(replace(scale, end=scale.end - plant.limits.outlet_gap_min), least, finish, resolution.pressure),
        np.linspace(vehicle_low, vehicle_high, resolution.temperature + 1),
    )


def _lowest_drawn(plant: PlantConstants, least: float, hottest: float) -> float:
    """Reference pressure below which no draw brings a buffer [bar], `least` being the lowest pressure of a vehicle.

    A draw needs a vehicle and a gap, and a second moves less than the whole gap (`Station.check_tank`), so the buffer
    stays above the vehicle at the temperature of that second.
    """
    return 0.98 * least * (plant.ambient_temperature + KELVIN) / (hottest + KELVIN)


def _references(scale: Scale, compressor: float, bottom: float, top: float, cells: int) -> Floats:
    """Knots up to `top`: what no compressor reaches is reached by warming alone, and needs few."""
    beyond = min(int(np.ceil((top - compressor) / (_BEYOND * compressor))), cells // 3)
    filled = _spaced(scale, bottom, compressor, cells - beyond)
    return np.concatenate((filled, np.linspace(compressor, top, beyond + 1)[1:]))


def _spaced(scale: Scale, first: float, last: float, cells: int) -> Floats:
    """Nodes at equal distances on a scale [bar]."""
    ends = scale.position(np.array([first, last]))
    nodes = scale.pressure(np.linspace(ends[0], ends[1], cells + 1))
    nodes[0], nodes[-1] = first, last
    return nodes
