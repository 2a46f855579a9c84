"""The cost of a sequence of commands by chapter 7 in plain Python, sharing no line with the code under test."""

from __future__ import annotations

import math
from itertools import product

R_OVER_M = 8.3145 / 0.002016


class Replay:
    """A station in one state; `cost` plays commands on it."""

    def __init__(self, problem) -> None:
        self.o, self.plant, self.weights = problem.observation, problem.plant, problem.objective
        self.tanks = 4 if self.o.vehicle >= 0 else 3
        self.volumes = [*self.plant.buffer_volume, self.o.vehicle_volume][: self.tanks]

    def cost(self, sequence) -> float:
        """Cost [bar2] of commands in bits of Valve; inf where one is not admissible."""
        o, total = self.o, 0.0
        p = [*o.pressure, o.vehicle_pressure][: self.tanks]
        t = [*o.temperature, o.vehicle_temperature][: self.tanks]
        m = [x * 1e5 * v / (R_OVER_M * (y + 273.15)) * 1e3 for x, y, v in zip(p, t, self.volumes, strict=True)]
        before = [bool(o.previous >> b & 1) for b in range(3)]
        for command in sequence:
            inlets = [bool(command >> b & 1) for b in range(3)]
            outlets = [bool(command >> 3 + b & 1) for b in range(3)]
            if not self.admits(p, t, inlets, outlets, before):
                return math.inf
            m, t = self.step(m, t, p, inlets, outlets)
            p = [x / 1e3 * R_OVER_M * (y + 273.15) / v / 1e5 for x, y, v in zip(m, t, self.volumes, strict=True)]
            total += self.weights.compressor * sum(inlets) + self.weights.precooler * sum(outlets)
            total += self.weights.buffers * sum((x - self.weights.target) ** 2 for x in p[:3])
            total += self.weights.vehicle * sum((x - self.weights.target) ** 2 for x in p[3:])
            before = inlets
        return total

    def admits(self, p, t, inlets, outlets, before) -> bool:
        c, period = self.plant, self.o.period
        if any(i and o for i, o in zip(inlets, outlets, strict=True)):
            return False
        if sum(inlets) > c.compressor_count or sum(outlets) > 1 or (any(outlets) and self.tanks == 3):
            return False
        for b in range(3):
            warmer = t[b] + period * (c.inlet_heating[b] + c.heat_exchange * (c.ambient_temperature - t[b]))
            held = p[b] > c.limits.hold_pressure and not before[b]
            if inlets[b] and (held or p[b] >= c.compressor_pressure or warmer > c.limits.buffer_temperature_max):
                return False
            if outlets[b]:
                gap = p[b] - p[3]
                warm = t[3] + period * (c.vehicle_heating + c.heat_exchange * (c.ambient_temperature - t[3]))
                flow = c.outlet_coefficient * gap
                if (
                    gap < c.limits.outlet_gap_min
                    or flow > c.limits.dispenser_flow_max
                    or warm > c.limits.vehicle_temperature_max
                ):
                    return False
        return True

    def step(self, m, t, p, inlets, outlets):
        c, period = self.plant, self.o.period
        m, rates = list(m), [c.heat_exchange * (c.ambient_temperature - x) for x in t]
        for b in range(3):
            if inlets[b]:
                m[b] += period * c.inlet_coefficient * (c.compressor_pressure - p[b])
                rates[b] += c.inlet_heating[b]
            if outlets[b]:
                moved = period * c.outlet_coefficient * (p[b] - p[3])
                m[b] -= moved
                m[3] += moved
                rates[b] -= c.outlet_cooling[b]
                rates[3] += c.vehicle_heating
        return m, [x + period * rate for x, rate in zip(t, rates, strict=True)]


def enumerate_best(cost, admitted, stages: int) -> tuple[float, tuple[int, ...]]:
    """Least cost of all sequences of `admitted` commands, and a sequence that has it."""
    return min((cost(sequence), sequence) for sequence in product(admitted, repeat=stages))
