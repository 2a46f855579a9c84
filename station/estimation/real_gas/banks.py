"""A bank begins, and begins anew where nobody told for long what it gave and was given."""

from __future__ import annotations

import numpy as np

from station.compiled import uncounted
from station.estimation.interface import BLIND
from station.estimation.jumps import forget_jumps
from station.estimation.real_gas.slopes import T, look_at
from station.estimation.real_gas.states import BANK_ENERGY, BANK_WALL, BIASED, Scratch, coordinate_of, tank_place
from station.estimation.real_gas.visits import begin_tank, tie
from station.geometry import KELVIN, VEHICLE
from station.plants.real_gas.entries import INSIDE, RealGasConstants, connected_tank
from station.plants.real_gas.hydrogen import BAR
from station.plants.real_gas.layout import BANKS, bank_at
from station.plants.real_gas.tank import fill_state
from station.sensor_names import ANALOG, SENSORS

_WALL = 5.0  # standard deviation between a bank's gas and its wall at the beginning [K]
_UNREAD = 10.0  # and of the temperature of one that begins anew without a thermometer [K]
_CONNECTED, _OUTLETS, _FLOW_D = SENSORS.index("vehicle"), SENSORS.index("outlet_high"), ANALOG.index("flow_dispenser")


@uncounted
def begin_bank(s: Scratch, bank: int, pressure: float, kelvin: float, plant: RealGasConstants) -> None:
    """The covariance of a bank from errors of its first readings [Pa], [K]."""
    look_at(s, bank, bank_at(bank, plant.station).volume, plant.station, plant.gas)
    _, _, m_t, e_t = begin_tank(s, bank, BANK_ENERGY + bank, bank, pressure, kelvin)
    variance, wall = kelvin * kelvin, BANK_WALL + bank
    tie(s, wall, bank, m_t * variance)
    tie(s, wall, BANK_ENERGY + bank, e_t * variance)
    s.cov[wall, wall] = variance + _WALL * _WALL


@uncounted
def begin_anew(s: Scratch, read: np.ndarray, noise: np.ndarray, plant: RealGasConstants) -> None:
    """Begin banks anew by their readings of a second, of which nobody knows what they gave and were given before."""
    inside = s.state[INSIDE:]
    for bank in range(BANKS):
        s.anew[bank] = 0.0
        if s.blind[bank] < BLIND or np.isnan(read[bank]):
            continue
        s.anew[bank] = 1.0
        forget_jumps(s.jumps, bank)
        tank, at = bank_at(bank, plant.station), tank_place(bank, plant.station)
        look_at(s, bank, tank.volume, plant.station, plant.gas)
        kelvin, error = read[4 + bank] + KELVIN + s.behind[bank], noise[4 + bank]
        if np.isnan(kelvin):
            kelvin, error = s.gas[bank, T], _UNREAD
        wall = coordinate_of(inside, BANK_WALL + bank, connected_tank(s.state), plant.station)
        fill_state(inside, at, tank, max(read[bank], 1.0) * BAR, kelvin, wall, plant.gas)
        for place in (bank, BANK_ENERGY + bank, BANK_WALL + bank):
            for other in range(BIASED):
                tie(s, place, other, 0.0)
        begin_bank(s, bank, noise[bank] * BAR, error, plant)


@uncounted
def note_blind(s: Scratch, read: np.ndarray, then: float) -> None:
    """Count the seconds in a row in which nobody told what a tank gave and was given; after `read_valves`.

    Nobody told who is connected, and an outlet may be open: it may have given something to somebody. A vehicle of which
    that holds begins again with its next readings.
    """
    unknown = np.isnan(read[_CONNECTED]) and then != s.vehicle[0] and read[_FLOW_D] != 0.0
    given = False
    for bank in range(BANKS):
        out = s.unseen[3 + bank] > 0.0 or (unknown and not read[_OUTLETS + bank] < 0.5)
        given = given or out
        if s.unseen[bank] > 0.0 or out:
            s.blind[bank] += 1.0
        elif s.blind[bank] < BLIND or s.anew[bank] != 0.0:
            s.blind[bank] = 0.0
    s.blind[VEHICLE] = s.blind[VEHICLE] + 1.0 if given else 0.0
    if s.blind[VEHICLE] >= BLIND and s.vehicle[0] >= 0.0:
        s.unread[0] = 1.0
