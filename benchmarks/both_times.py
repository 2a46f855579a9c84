"""How near one controller can come to the least `t_comp_restored` and the least `t_dis` of the thesis's four at once.

In S3, where nobody has to wait. Beside what is proved: what an ideal station has, and settings of `switched`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from station.bounds.envelope import MARGIN
from station.bounds.grid import FINE, Resolution, make_grid
from station.bounds.proof import prove_buffer_potential
from station.bounds.proposal import Proposer
from station.bounds.queue import SAFETY
from station.bounds.service import prove_service, service_rises
from station.bounds.service_proposal import ServiceProposer
from station.parameters import Station
from station.plants.thesis import gas_mass, gas_pressure, vehicle_temperature
from station.scenario import Scenario

DESIGN_PRICES = (1.4, 1.8)
"""Compressor-seconds a dispensing second for which potentials are looked for."""

SERVICE_PRICES = (1.0, 1.12, 1.28, 1.44)
"""And for which vehicles are priced by each of them."""

TRADE_OFFS = np.geomspace(0.3, 3.0, 60)
"""Compressor-seconds that a dispensing second is worth to an ideal station."""

STEP = 0.25
"""Of an ideal station's fills [s]."""


class Times(NamedTuple):
    """What a run takes [s]."""

    compressing: float  # t_comp_restored
    dispensing: float  # t_dis

    def excess(self, least: Times) -> float:
        """The larger of its shares above the least times, each by itself."""
        return max(self.compressing / least.compressing, self.dispensing / least.dispensing) - 1.0


def proved_excess(scenario: Scenario, least: Times, resolution: Resolution = FINE) -> float:
    """No controller has both times less than this share above the least: docs/bounds.md has the proof.

    Of runs of a scenario with vehicles that are all alike, in which each leaves before the next one comes, the last one
    within the same time. Negative where the least times themselves are not excluded.
    """
    vehicles, station = scenario.vehicles(), scenario.station
    count, volume, start = len(vehicles.arrival), float(vehicles.volume[0]), float(vehicles.start_pressure[0])
    finish, warm = float(vehicles.finish_pressure[0]), float(vehicles.start_temperature[0])
    connected = count * float(np.diff(vehicles.arrival).max())
    grid = make_grid(station, resolution, (start, start), finish)
    proposer = Proposer(grid, volume, start, count, 1)
    services = ServiceProposer(grid, (volume, volume), start)
    best = -1.0
    for design in DESIGN_PRICES:
        stock = prove_buffer_potential(grid, proposer.propose((design,)))
        for price in SERVICE_PRICES:
            service = prove_service(grid, stock, services.propose(stock, price), (volume, volume))
            closed = max(float(service_rises(grid, stock, service.values, (volume, volume))[0].max()), 0.0)
            closed += MARGIN * (1.0 + closed)
            gained = count * service.gain(grid, start, warm, finish)
            sure = gained + stock.boundary - closed * connected - SAFETY * (gained + abs(stock.boundary))
            share = sure / (least.compressing + (service.price - closed) * least.dispensing)
            best = max(best, share - 1.0)
    return best


def ideal_times(station: Station, count: int, trade_off: float) -> Times:
    """Times of a station that has each gram at the gap that is best for it, from buffers at a steady temperature.

    A gram given at the gap x to a vehicle at p_v costs 1 / (c_in (p_com - p_v - x)) + w / (c_out x) seconds, w being
    the trade-off, so that the best x is a share of p_com - p_v that is the same all along.
    """
    plant, vehicle, volume = station.constants(), station.vehicle, station.vehicle.volume_m3
    root = math.sqrt(trade_off * plant.inlet_coefficient / plant.outlet_coefficient)
    least, most = plant.limits.outlet_gap_min, plant.limits.dispenser_flow_max / plant.outlet_coefficient
    pressure, temperature = vehicle.start_pressure_bar, vehicle.start_temperature_c
    mass = gas_mass(pressure, temperature, volume)
    compressing = dispensing = 0.0
    while pressure < vehicle.finish_pressure_bar:
        above = plant.compressor_pressure - pressure
        gap = min(max(above * root / (1.0 + root), least), most)
        grams = plant.outlet_coefficient * gap * STEP
        compressing += grams / (plant.inlet_coefficient * (above - gap))
        dispensing += STEP
        mass += grams
        temperature = vehicle_temperature(temperature, 1.0, plant, STEP)
        pressure = gas_pressure(mass, temperature, volume)
    return Times(count * compressing, count * dispensing)


def ideal_excess(station: Station, count: int, least: Times) -> float:
    """The least share above the least times that an ideal station has."""
    return min(ideal_times(station, count, float(trade_off)).excess(least) for trade_off in TRADE_OFFS)
