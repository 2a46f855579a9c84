"""One stage of the MINLP (7.25) on symbols, for every solver's model: what follows, what it costs, what limits it.

States and valves are numbers, intervals, or symbols of CasADi or Pyomo; the equations are those of
station.planning, the margins those of station.limits, the costs those of objective.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from controllers.minlp.interval import Interval
from controllers.minlp.objective import Objective, buffer_cost, energy_cost, vehicle_cost
from station.control_model import ControlModel, ramp_flow
from station.geometry import KELVIN, VEHICLE
from station.limits import Situation, check_covered, state_limits
from station.planning import Model, gas_pressure, inlet_flow, vehicle_temperature
from station.plants.interface import Number
from station.plants.thesis import buffer_temperature, next_mass, outlet_flow


def lesser(one: Number, other: Number) -> Number:
    """The lesser of two numbers or intervals."""
    if isinstance(one, Interval):
        return one.least(other)
    return other.least(one) if isinstance(other, Interval) else min(one, other)


class Tanks(NamedTuple):
    """Figures of high, medium, low and, in the model with a vehicle, of the vehicle."""

    mass: tuple[Number, ...]  # [g]
    temperature: tuple[Number, ...]  # [deg C]
    pressure: tuple[Number, ...]  # [bar]


class Valves(NamedTuple):
    """The valves of a stage, high, medium and low, each 0 or 1."""

    inlet: tuple[Number, ...]
    outlet: tuple[Number, ...]  # zeros without a vehicle, Eq. (7.14)


class Stage(NamedTuple):
    """Constants of every stage of a model."""

    plant: Model
    objective: Objective
    vehicle: bool  # Condition 1 or 2 of Sec. 7.3
    volume: Number  # of the vehicle's tank [m3]
    period: Number  # [s]
    lesser: Callable[[Number, Number], Number] = lesser  # of two numbers or symbols

    def drawn(self, tanks: Tanks, valves: Valves) -> list[Number]:
        """Flow [g/s] out of each buffer."""
        if not self.vehicle:
            return [0.0, 0.0, 0.0]
        flows = [outlet_flow(tanks.pressure[b], tanks.pressure[VEHICLE], self.plant) for b in range(3)]
        most = self._most_dispensed(tanks)
        if most is not None:
            flows = [self.lesser(flow, most) for flow in flows]
        # No outlet opens towards a higher pressure, Eq. (7.12): of an interval only what flows out can be.
        flows = [flow.within(0.0, math.inf) if isinstance(flow, Interval) else flow for flow in flows]
        return [flow * outlet for flow, outlet in zip(flows, valves.outlet, strict=True)]

    def _most_dispensed(self, tanks: Tanks) -> Number | None:
        """Flow [g/s] that nozzle and ramp let into the vehicle; `station.control_model.most_dispensed`. None: any."""
        plant = self.plant
        if not isinstance(plant, ControlModel) or plant.ramp == plant.nozzle_flow == math.inf:
            return None
        if plant.ramp == math.inf:
            return plant.nozzle_flow
        mass, temperature, pressure = (figure[VEHICLE] for figure in tanks)
        flow = ramp_flow(mass, temperature, pressure, self.volume, plant, self.period)
        if plant.nozzle_flow < math.inf:
            flow = self.lesser(flow, plant.nozzle_flow)
        return -self.lesser(-flow, 0.0)

    def masses(self, tanks: Tanks, valves: Valves, drawn: list[Number]) -> tuple[Number, ...]:
        """Masses [g] after the stage, Eqs (7.1) and (7.6); `drawn` is the stage's."""
        after = [
            next_mass(tanks.mass[b], inlet_flow(tanks.pressure[b], self.plant) * valves.inlet[b], drawn[b], self.period)
            for b in range(3)
        ]
        if self.vehicle:
            after.append(next_mass(tanks.mass[VEHICLE], sum(drawn), 0.0, self.period))
        return tuple(after)

    def temperatures(self, tanks: Tanks, valves: Valves, drawn: list[Number]) -> tuple[Number, ...]:
        """Temperatures [deg C] after the stage, Eqs (7.4), (7.5), (7.9) and (7.10), or by energy."""
        after = [
            buffer_temperature(b, tanks.temperature[b], valves.inlet[b], valves.outlet[b], self.plant, self.period)
            for b in range(3)
        ]
        if self.vehicle:
            mass, temperature, outlets = tanks.mass[VEHICLE], tanks.temperature[VEHICLE], sum(valves.outlet)
            flow, plant = sum(drawn), self.plant
            after.append(vehicle_temperature(temperature, outlets, mass, flow, self.volume, plant, self.period))
        return tuple(after)

    def pressures(self, masses: tuple[Number, ...], temperatures: tuple[Number, ...]) -> tuple[Number, ...]:
        """Pressures [bar] of the tanks, Eqs (7.3) and (7.8), with the covolume where the model has one."""
        volumes = (*self.plant.buffer_volume, self.volume)
        return tuple(gas_pressure(m, t, v, self.plant) for m, t, v in zip(masses, temperatures, volumes, strict=False))

    def reach(self, present: Tanks, allowed: int, stages: int) -> list[Tanks]:
        """Intervals of the states after 1, 2, ... stages, the first with the valves `allowed` (bits of Valve)."""
        found: list[Tanks] = []
        tanks = present
        for index in range(stages):
            may = [allowed >> valve & 1 if index == 0 else 1 for valve in range(6)]
            inlet, outlet = ([Interval(0.0, float(high)) for high in side] for side in (may[:3], may[3:]))
            valves = Valves(tuple(inlet), tuple(outlet) if self.vehicle else (0, 0, 0))
            drawn = self.drawn(tanks, valves)
            masses, temperatures = self.masses(tanks, valves, drawn), self._reached(tanks, valves, drawn)
            tanks = Tanks(masses, temperatures, self.pressures(masses, temperatures))
            found.append(tanks)
        return found

    def _reached(self, tanks: Tanks, valves: Valves, drawn: list[Number]) -> tuple[Number, ...]:
        """Intervals of the temperatures [deg C] after a stage.

        By energy the vehicle's is a mean of its own, that of the gas delivered and the ambient one.
        """
        after, plant = self.temperatures(tanks, valves, drawn), self.plant
        if not (self.vehicle and isinstance(plant, ControlModel) and plant.delivered_temperature):
            return after
        before, others = tanks.temperature[VEHICLE], (plant.delivered_temperature - KELVIN, plant.ambient_temperature)
        low, high = (before.low, before.high) if isinstance(before, Interval) else (before, before)
        return (*after[:VEHICLE], after[VEHICLE].within(min(low, *others), max(high, *others)))

    def margins(self, tanks: Tanks, valves: Valves, inlet_before: tuple[Number, ...]) -> list[Number]:
        """Margins that must not be negative: Eqs (7.11)-(7.13) and (7.15)-(7.19), and p < p_com where an inlet opens.

        A limit on a state binds through its valve, as Eq. (7.12) does. Eq. (7.16) stands as printed, times its M.
        That a buffer lies strictly below p_com no solver can say: they get `not above`.
        """
        plant, found = self.plant, []
        check_covered("solver models", ("hold", *(limit.name for limit in state_limits() if not limit.of_closed)))
        inlets, outlets = state_limits("inlet", plant), state_limits("outlet", plant) if self.vehicle else []
        span = 2.0 * plant.compressor_pressure - plant.limits.hold_pressure  # M of Eq. (7.16): no buffer gets so far
        for b in range(3):
            inlet, outlet = valves.inlet[b], valves.outlet[b]
            vehicle = (tanks.pressure[VEHICLE], tanks.temperature[VEHICLE]) if self.vehicle else (0.0, 0.0)
            at = Situation(b, tanks.pressure[b], tanks.temperature[b], *vehicle)
            found += [limit.margin(at, plant, self.period) * inlet for limit in inlets if not limit.of_closed]
            free = span * (1 + inlet_before[b] - inlet)
            found += [limit.margin(at, plant, self.period) + free for limit in inlets if limit.of_closed]
            found += [limit.margin(at, plant, self.period) * outlet for limit in outlets]
            if self.vehicle:
                found.append(1 - inlet - outlet)
        found.append(plant.compressor_count - sum(valves.inlet))
        if self.vehicle:
            found.append(1 - sum(valves.outlet))
        return found

    def tank_cost(self, pressure: tuple[Number, ...]) -> Number:
        """c_b J_2 + c_v J_3 at these pressures [bar2]."""
        cost = sum(buffer_cost(pressure[b], self.objective) for b in range(3))
        return cost + vehicle_cost(pressure[VEHICLE], self.objective) if self.vehicle else cost

    def cost(self, valves: Valves, pressure_after: tuple[Number, ...]) -> Number:
        """Cost [bar2] of a stage, a term of Eq. (7.24)."""
        return energy_cost(sum(valves.inlet), sum(valves.outlet), self.objective) + self.tank_cost(pressure_after)
