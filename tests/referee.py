"""An independent referee: chapter 7 once more in plain Python, sharing no line with the code under test.

It knows one compressor, one-second steps, communication, and the largest-gap logic; enough for S1-S4.
"""

from __future__ import annotations

from itertools import product

R_OVER_M = 8.3145 / 0.002016
PAIRS = [(i, o) for i, o in product((None, 0, 1, 2), repeat=2) if i is None or i != o]


class Plant:
    """The station of a resolved scenario document."""

    def __init__(self, station: dict) -> None:
        buffers = [station["buffers"][name] for name in ("high", "medium", "low")]
        self.volumes = [buffer["volume_m3"] for buffer in buffers]
        self.starts = [buffer["initial_pressure_bar"] for buffer in buffers]
        self.heat = [buffer["inlet_heating_k_per_s"] for buffer in buffers]
        self.cool = [buffer["outlet_cooling_k_per_s"] for buffer in buffers]
        self.p_com = station["compressor"]["pressure_bar"]
        self.c_in = station["compressor"]["inlet_coefficient_g_per_s_bar"]
        self.hold = station["compressor"]["hold_pressure_bar"]
        self.c_out = station["dispenser"]["outlet_coefficient_g_per_s_bar"]
        self.flow_max = station["dispenser"]["flow_max_g_per_s"]
        self.gap_min = station["dispenser"]["outlet_gap_min_bar"]
        self.c_n = station["thermal"]["heat_exchange_per_s"]
        self.t_env = station["thermal"]["ambient_temperature_c"]
        self.t_buffer = station["thermal"]["buffer_temperature_max_c"]
        self.vehicle = station["vehicle"]
        self.volumes = [*self.volumes, self.vehicle["volume_m3"]]

    def pressure(self, mass: float, temperature: float, tank: int) -> float:
        return mass / 1000 * R_OVER_M * (temperature + 273.15) / self.volumes[tank] / 1e5

    def mass(self, pressure: float, temperature: float, tank: int) -> float:
        return pressure * 1e5 * self.volumes[tank] / (R_OVER_M * (temperature + 273.15)) * 1000

    def step(self, state: tuple, inlet: int | None, outlet: int | None) -> tuple:
        """State is (masses, temperatures, pressures) of high, medium, low, vehicle; vehicle None when absent."""
        m, t, p = (list(part) for part in state)
        rates = [self.c_n * (self.t_env - x) if x is not None else None for x in t]
        if inlet is not None:
            m[inlet] += self.c_in * (self.p_com - p[inlet])
            rates[inlet] += self.heat[inlet]
        if outlet is not None:
            flow = self.c_out * (p[outlet] - p[3])
            m[outlet] -= flow
            m[3] += flow
            rates[outlet] -= self.cool[outlet]
            rates[3] += self.vehicle["heating_k_per_s"]
        t = [x + rate if x is not None else None for x, rate in zip(t, rates, strict=True)]
        p = [self.pressure(m[k], t[k], k) if t[k] is not None else None for k in range(4)]
        return m, t, p

    def may_fill(self, state: tuple, buffer: int, previous: int | None, *, hold: bool) -> bool:
        _, t, p = state
        if p[buffer] >= self.p_com or (hold and p[buffer] > self.hold and previous != buffer):
            return False
        return t[buffer] + self.heat[buffer] + self.c_n * (self.t_env - t[buffer]) <= self.t_buffer

    def may_dispense(self, state: tuple, buffer: int) -> bool:
        _, t, p = state
        if p[3] is None or p[buffer] - p[3] < self.gap_min or self.c_out * (p[buffer] - p[3]) > self.flow_max:
            return False
        after = t[3] + self.vehicle["heating_k_per_s"] + self.c_n * (self.t_env - t[3])
        return after <= self.vehicle["temperature_max_c"]

    def admits(self, state: tuple, inlet: int | None, outlet: int | None, previous: int | None) -> bool:
        if inlet is not None and not self.may_fill(state, inlet, previous, hold=True):
            return False
        return outlet is None or self.may_dispense(state, outlet)


class Minlp:
    """Eq. (7.25) at t = 1 by trying all 13 x 13 pairs."""

    def __init__(self, plant: Plant, settings: dict, c_eng: float, c_b: float, c_v: float) -> None:
        self.plant, self.target = plant, settings["target_pressure_bar"]
        self.w_in, self.w_out = c_eng * settings["compressor_weight_bar2"], c_eng * settings["precooler_weight_bar2"]
        self.c_b, self.c_v = c_b, c_v
        self.commands = sorted(PAIRS, key=lambda pair: pair[0] is not None)

    def cost(self, state: tuple, inlet: int | None, outlet: int | None) -> float:
        p = state[2]
        cost = self.w_in * (inlet is not None) + self.w_out * (outlet is not None)
        cost += self.c_b * sum((p[b] - self.target) ** 2 for b in range(3))
        return cost + (self.c_v * (p[3] - self.target) ** 2 if p[3] is not None else 0.0)

    def decide(self, state: tuple, previous: int | None) -> tuple:
        best, chosen = float("inf"), (None, None)
        for first in self.commands:
            if not self.plant.admits(state, *first, previous):
                continue
            middle = self.plant.step(state, *first)
            cost = self.cost(middle, *first)
            for second in self.commands:
                if self.plant.admits(middle, *second, first[0]):
                    total = cost + self.cost(self.plant.step(middle, *second), *second)
                    if total < best:
                        best, chosen = total, first
        return chosen


class Logic:
    """The largest-gap logic with refill order low, medium, high."""

    def __init__(self, plant: Plant, settings: dict) -> None:
        self.plant = plant
        self.stop = [settings["stop_pressure_bar"][name] for name in ("high", "medium", "low")]
        self.width = settings["hysteresis_bar"]
        self.needy = [False] * 3

    def decide(self, state: tuple, _previous: int | None) -> tuple:
        p = state[2]
        open_ = [b for b in range(3) if self.plant.may_dispense(state, b)]
        outlet = max(open_, key=lambda b: p[b]) if open_ else None
        for b in range(3):
            if p[b] < self.stop[b] - self.width:
                self.needy[b] = True
            elif p[b] >= self.stop[b]:
                self.needy[b] = False
        for b in (2, 1, 0):
            if self.needy[b] and b != outlet and self.plant.may_fill(state, b, None, hold=False):
                return b, outlet
        return None, outlet


def run(plant: Plant, controller: object, arrivals: list[float], limit: int) -> dict[str, float]:
    """t_total, t_comp and t_dis [s] of a run to its end."""
    t = [25.0, 25.0, 25.0, None]
    m = [plant.mass(plant.starts[b], 25.0, b) for b in range(3)] + [None]
    state = (m, t, [*plant.starts, None])
    waiting, t_total, t_comp, t_dis, previous = list(arrivals), 0.0, 0, 0, None
    for now in range(limit):
        if state[2][3] is None and waiting and waiting[0] <= now:
            t_total += now - waiting.pop(0)
            start = plant.vehicle["start_pressure_bar"]
            state = tuple(
                [*part[:3], new] for part, new in zip(state, (plant.mass(start, 25.0, 3), 25.0, start), strict=True)
            )
        if state[2][3] is None and not waiting and previous is None:
            return {"t_total": t_total, "t_comp": t_comp, "t_dis": t_dis}
        inlet, outlet = controller.decide(state, previous)
        state = plant.step(state, inlet, outlet)
        t_comp, t_dis, previous = t_comp + (inlet is not None), t_dis + (outlet is not None), inlet
        if state[2][3] is not None and state[2][3] >= plant.vehicle["finish_pressure_bar"]:
            state = tuple([*part[:3], None] for part in state)
    raise AssertionError("the run did not end")
