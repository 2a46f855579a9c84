"""A lower bound on the cost of the stages still to come, from how high pressures can rise at most.

Three facts make it a bound. Filled n times, a buffer holds the most if it never dispenses and is as cold as it can
get when the compressor sees it, and shows the highest pressure if it is as hot as it can get when it is priced.
In i stages the compressors fill i * n_com times in all, shared as suits the cost best. The vehicle gains the most
from a buffer at the highest of those pressures. All maps involved are increasing, so the steps compose. What a ramp
lets in is the most while the vehicle is as empty and as hot as it can be.
"""

from __future__ import annotations

import numpy as np

from controllers.minlp.objective import Objective, buffer_cost, vehicle_cost
from controllers.minlp.pair import Search
from station.compiled import uncounted
from station.geometry import VEHICLE
from station.planning import coldest_vehicle, gas_pressure, hottest_vehicle, inlet_flow, most_dispensed
from station.plants.thesis import buffer_temperature, next_mass, outlet_flow


@uncounted
def bound_work(horizon: int) -> int:
    """Entries of scratch memory `cost_to_go` needs for up to `horizon` stages."""
    return 3 * (horizon + 1) + 2 * (3 * horizon + 1) + (horizon + 1)


@uncounted
def _below(pressure: float, objective: Objective) -> float:
    """A buffer's cost if its pressure may lie anywhere up to `pressure`."""
    return buffer_cost(min(pressure, objective.target), objective)


@uncounted
def _buffer_ceilings(
    buffer: int, mass: float, temperature: float, stages: int, search: Search, ceiling: np.ndarray
) -> None:
    """Highest pressures [bar] after n = 0..stages fillings, into `ceiling`."""
    model, period = search.model, search.period
    volume = model.buffer_volume[buffer]
    coldest = min(temperature, model.ambient_temperature) - stages * period * model.outlet_cooling[buffer]
    hottest = max(temperature, model.ambient_temperature)
    cap = max(hottest, model.limits.buffer_temperature_max)
    ceiling[0] = gas_pressure(mass, hottest, volume, model)
    for n in range(1, stages + 1):
        flow = max(0.0, inlet_flow(gas_pressure(mass, coldest, volume, model), model))
        mass = next_mass(mass, flow, 0.0, period)
        hottest = min(cap, buffer_temperature(buffer, hottest, 1.0, 0.0, model, period))
        ceiling[n] = gas_pressure(mass, hottest, volume, model)


@uncounted
def _buffers_to_go(ceilings: np.ndarray, stages: int, search: Search, work: np.ndarray) -> float:
    """Sum over the stages of the least c_b J_2, each stage with the fillings it can have had by then."""
    objective = search.objective
    compressors = min(3, search.model.compressor_count)
    width = compressors * stages + 1
    two, three = work[:width], work[width : 2 * width]
    for total in range(width):
        two[total] = np.inf
        for n in range(max(0, total - stages), min(stages, total) + 1):
            cost = _below(ceilings[0, n], objective) + _below(ceilings[1, total - n], objective)
            two[total] = min(two[total], cost)
    for total in range(width):
        three[total] = np.inf
        for n in range(max(0, total - width + 1), min(stages, total) + 1):
            three[total] = min(three[total], two[total - n] + _below(ceilings[2, n], objective))
    sum_of_stages = 0.0
    least = three[0]
    done = 0
    for stage in range(1, stages + 1):
        while done < stage * compressors:
            done += 1
            least = min(least, three[done])
        sum_of_stages += least
    return sum_of_stages


@uncounted
def _vehicle_to_go(mass: float, temperature: float, highest: np.ndarray, stages: int, search: Search) -> float:
    """Sum over the stages of the least c_v J_3, filled each stage from a buffer at pressure `highest`."""
    model, period, volume, objective = search.model, search.period, search.volume, search.objective
    coldest = coldest_vehicle(temperature, model)
    hottest = max(temperature, model.ambient_temperature)
    cap = max(hottest, model.limits.vehicle_temperature_max)
    least, lowest = mass, gas_pressure(mass, coldest, volume, model)
    total = 0.0
    for stage in range(stages):
        flow = outlet_flow(highest[stage], gas_pressure(mass, coldest, volume, model), model)
        flow = min(max(flow, 0.0), model.limits.dispenser_flow_max)
        flow = min(flow, most_dispensed(least, hottest, lowest, volume, model, period))
        mass = next_mass(mass, flow, 0.0, period)
        hottest = hottest_vehicle(hottest, cap, least, flow, volume, model, period)
        total += vehicle_cost(min(gas_pressure(mass, hottest, volume, model), objective.target), objective)
    return total


@uncounted
def cost_to_go(state: np.ndarray, stages: int, search: Search, work: np.ndarray) -> float:
    """A lower bound on the cost of `stages` more stages from a state: masses, temperatures, pressures (12,)."""
    ceilings = work[: 3 * (stages + 1)].reshape((3, stages + 1))
    rest = work[3 * (stages + 1) :]
    for buffer in range(3):
        _buffer_ceilings(buffer, state[buffer], state[4 + buffer], stages, search, ceilings[buffer])
    total = 0.0
    if search.objective.buffers != 0.0:
        total += _buffers_to_go(ceilings, stages, search, rest)
    if search.vehicle:
        highest = rest[:stages]
        for stage in range(stages):
            highest[stage] = max(ceilings[0, stage], ceilings[1, stage], ceilings[2, stage])
        total += _vehicle_to_go(state[VEHICLE], state[4 + VEHICLE], highest, stages, search)
    return total
