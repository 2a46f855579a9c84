"""What is proved of potentials, whoever proposes them: prices that hold for every state and command of a second.

A potential is bilinear on each cell. Over a second a state moves from s by d(s), and the potential changes by the
integral of its gradient at the points x of that segment times d(s). So whatever bounds gradient(x) . d(s) for all
x of a cell and all s less than a second before it bounds the change over any second. Cells are cut into smaller ones
and every factor is taken at the worst end of its interval: no sampling, and the proposal's solver is not believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.bounds.grid import Floats, Grid
from station.plant import KELVIN, exchange_rate

MARGIN = 1e-9
"""Relative safety of every proved figure against rounding in its own evaluation."""

_BIN = 1.25
"""Width of a bin of the pressure a draw comes from [bar]."""

_STOCK_PARTS = (12, 16)
"""Parts of a cell of a buffer's reference pressure and of its temperature."""

Interval = tuple[Floats, Floats]


@dataclass(frozen=True)
class Stock:
    """A proved potential of the three buffers [compressor-seconds].

    No second of filling raises a buffer's potential by more than 1, and no other second without a draw raises it.
    """

    values: tuple[Floats, Floats, Floats]  # at the nodes (pressure, temperature)
    boundary: float  # least of (final potential + restoring seconds - initial potential), all buffers
    used_most: float  # most that can be drawn from the initial stock, all buffers
    prices: Floats  # (bins, flows): least fall of the potential in a second that draws at these flows
    bins: Floats  # edges of the pressure of the buffer drawn from [bar]
    flows: Floats  # nodes [g/s]


def product(first: Interval, second: Interval) -> Interval:
    """All products of numbers of two intervals."""
    corners = [a * b for a in first for b in second]
    return np.minimum.reduce(corners), np.maximum.reduce(corners)


def refined(nodes: Floats, parts: int) -> Floats:
    """Nodes with `parts` equal cells in each cell."""
    fine = nodes[:-1, None] + np.diff(nodes)[:, None] * (np.arange(parts) / parts)
    return np.append(fine.ravel(), nodes[-1])


def _between(values: Floats, nodes: Floats, at: Floats, axis: int) -> Floats:
    """Linear interpolation along an axis."""
    cell = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    share = (at - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    shape = [1] * values.ndim
    shape[axis] = len(at)
    share = share.reshape(shape)
    return (1 - share) * np.take(values, cell, axis) + share * np.take(values, cell + 1, axis)


def _ends(values: Floats, axis: int) -> Interval:
    """Least and largest of neighbours along an axis."""
    count = values.shape[axis]
    low, high = np.take(values, range(count - 1), axis), np.take(values, range(1, count), axis)
    return np.minimum(low, high), np.maximum(low, high)


def slopes(values: Floats, first: Floats, second: Floats, parts: tuple[int, int]) -> tuple[Interval, Interval]:
    """Intervals of both partial derivatives on each part of each cell."""
    along = np.repeat(np.diff(values, axis=0) / np.diff(first)[:, None], parts[0], axis=0)
    across = np.repeat(np.diff(values, axis=1) / np.diff(second), parts[1], axis=1)
    fine_first, fine_second = refined(first, parts[0]), refined(second, parts[1])
    return _ends(_between(along, second, fine_second, 1), 1), _ends(_between(across, first, fine_first, 0), 0)


def _drift(grid: Grid, heating: float, low: Floats, high: Floats) -> Interval:
    """Change of temperature in a second [K] at `heating` [K/s] from temperatures between `low` and `high`."""
    plant = grid.plant
    return heating + exchange_rate(high, plant), heating + exchange_rate(low, plant)


def _step_of_temperature(grid: Grid, heating: float, nodes: Floats) -> float:
    """The largest change of temperature in a second on a domain [K]."""
    plant = grid.plant
    away = max(plant.ambient_temperature - nodes[0], nodes[-1] - plant.ambient_temperature)
    return heating + plant.heat_exchange * float(away)


def tidy(values: Floats, grid: Grid) -> Floats:
    """The least potential above a proposal that time cannot raise and that grows with mass.

    Temperature only ever moves towards the ambient one while the valves are closed, mass stays.
    """
    tidied, middle = values.copy(), grid.ambient
    tidied[:, middle:] = np.maximum.accumulate(values[:, middle:], axis=1)
    tidied[:, : middle + 1] = np.maximum.accumulate(values[:, middle::-1], axis=1)[:, ::-1]
    return np.asarray(np.maximum.accumulate(tidied, axis=0))


@dataclass(frozen=True)
class _Boxes:
    """Parts of the cells of one buffer, and the gradient of its potential on them, (reference, temperature)."""

    reference: Floats  # edges [bar]
    cold: Floats  # where seconds that pass a part may be, at the least [deg C]
    warm: Floats  # and at the most
    temperature: Floats  # edges [deg C]
    along: Interval  # a unit of the scale of reference pressure
    heat: Interval  # by the drift of temperature, a second

    @classmethod
    def of(cls, grid: Grid, values: Floats, heating: float) -> _Boxes:
        """The boxes of a potential in seconds that heat a buffer by `heating` [K/s], a draw by less than 0."""
        along, across = slopes(values, grid.z, grid.temperature, _STOCK_PARTS)
        t = refined(grid.temperature, _STOCK_PARTS[1])
        step = _step_of_temperature(grid, abs(heating), grid.temperature)
        cold = np.maximum(t[:-1] - step, grid.temperature[0])
        warm = np.minimum(t[1:] + step, grid.temperature[-1])
        heat = product(across, _drift(grid, heating, cold, warm))
        r = grid.reference_scale.pressure(refined(grid.z, _STOCK_PARTS[0]))
        return cls(r, cold, warm, t, along, heat)


def filling_gains(grid: Grid, buffer: int, values: Floats) -> Floats:
    """Most by which a second of filling raises the potential, for every admissible state; an array over the cells.

    A point of the segment lies above its start by at most what the second fills. At one temperature speed on the
    scale is monotone in pressure on either side of the bend, so it is largest at an end of a part or there.
    """
    plant, scale = grid.plant, grid.reference_scale
    boxes = _Boxes.of(grid, values, plant.inlet_heating[buffer])
    rate, top = grid.kappa[buffer] * plant.inlet_coefficient, plant.compressor_pressure
    theta, low, high = grid.theta(boxes.cold), boxes.reference[:-1, None], boxes.reference[1:, None]
    far = np.maximum(low - rate * top, 0.0)
    moved = rate * np.maximum(top - far * theta, 0.0)
    bend = np.clip(scale.end - scale.width, low, high)
    gaps = [np.maximum(top - (r - moved) * theta, 0.0) * scale.rate(r) for r in (low, high, bend)]
    speed = rate * np.maximum.reduce(gaps)
    gain = np.where(speed > 0, boxes.along[1] * speed + boxes.heat[1], -np.inf)
    parts = _STOCK_PARTS
    shape = len(grid.reference) - 1, parts[0], len(grid.temperature) - 1, parts[1]
    return np.asarray(gain.reshape(shape).max(axis=(1, 3)))


def _least(values: Floats, low: NDArray[np.int64], high: NDArray[np.int64]) -> Floats:
    """Least of rows low to high (inclusive) of `values`, a row of the result for each pair."""
    best = values[low]
    for offset in range(1, int((high - low).max()) + 1):
        best = np.minimum(best, values[np.minimum(low + offset, high)])
    return best


def draw_prices(grid: Grid, buffer: int, values: Floats, bins: Floats, flows: Floats) -> Floats:
    """Least fall of one buffer's potential in a second that draws from it, (bins of its pressure, flows).

    At a point of the segment whose pressure lies in a bin, a second at flow f takes f kappa of reference pressure
    and moves the temperature, so the rate of fall is at least gamma f - delta. The least over temperatures is concave
    in f: between nodes it lies above the straight line.
    """
    boxes = _Boxes.of(grid, values, -grid.plant.outlet_cooling[buffer])
    rate = grid.reference_scale.rate(boxes.reference[:-1, None])
    taken, heat = grid.kappa[buffer] * boxes.along[0] * rate, boxes.heat[1]
    theta, edges = grid.theta(boxes.temperature), boxes.reference
    best, count = np.full((len(bins) - 1, len(flows)), np.inf), len(edges) - 1
    for j in range(taken.shape[1]):
        low = np.searchsorted(edges, bins[:-1] / theta[j + 1], side="right") - 1
        high = np.searchsorted(edges, bins[1:] / theta[j], side="left") - 1
        reached = low < count
        low, high = np.clip(low, 0, count - 1), np.clip(np.maximum(high, low), 0, count - 1)
        price = taken[:, j : j + 1] * flows - heat[:, j : j + 1]
        best = np.minimum(best, np.where(reached[:, None], _least(price, low, high), np.inf))
    return best


def prove_stock(grid: Grid, proposed: list[Floats]) -> Stock:
    """A proved potential from proposed node values: made monotone, divided by the most a second of filling gains."""
    flows = np.geomspace(*grid.flow_range, 33) if grid.flow_range[0] > 0 else np.linspace(*grid.flow_range, 33)
    flows[0], flows[-1] = grid.flow_range
    bins = np.arange(0.0, grid.pressure_max + _BIN, _BIN)
    proved, boundary, used = [], 0.0, 0.0
    prices = np.full((len(bins) - 1, len(flows)), np.inf)
    for buffer in range(3):
        values = tidy(proposed[buffer], grid)
        values = values / (max(float(filling_gains(grid, buffer, values).max()), 1e-3) * (1 + MARGIN))
        proved.append(values)
        initial = grid.stock_value(values, *grid.start(buffer))
        boundary += _least_final(grid, buffer, values) - initial
        used += initial - _least_value(grid, buffer, values)
        prices = np.minimum(prices, draw_prices(grid, buffer, values, bins, flows))
    return Stock((proved[0], proved[1], proved[2]), boundary, used, prices, bins, flows)


def _least_final(grid: Grid, buffer: int, values: Floats) -> float:
    """Least of a buffer's final potential and its restoring seconds.

    Mass raises the potential and lowers the restoring seconds: each at the worst end of a part.
    """
    z = refined(grid.z, 64)
    potential = _between(values, grid.z, z[:-1], 0).min(axis=1)
    return float((potential + grid.restoring(buffer, grid.reference_scale.pressure(z[1:]))).min())


def _least_value(grid: Grid, buffer: int, values: Floats) -> float:
    """Least a buffer's potential ever is."""
    return min(grid.stock_value(values, grid.lowest(buffer), float(node)) for node in grid.temperature)


def time_only(grid: Grid) -> Stock:
    """The potential that is zero: a second that draws costs nothing, so that only time is priced."""
    nothing = np.zeros((len(grid.reference), len(grid.temperature)))
    stock = prove_stock(grid, [nothing, nothing, nothing])
    return Stock(stock.values, 0.0, 0.0, np.maximum(stock.prices, 0.0), stock.bins, stock.flows)


@dataclass(frozen=True)
class Service:
    """A proved price of filling vehicles of a range of volumes: compressor-seconds >= gain - price x seconds.

    `seconds` are those a vehicle is connected, `gain` is of its start and finish.
    """

    values: Floats  # U at the nodes (vehicle pressure, vehicle temperature), 0 at the highest finish pressure
    price: float  # compressor-seconds a connected second

    def gain(self, grid: Grid, start: float, temperature: float, finish: float) -> float:
        """U at the finish pressure, whatever the temperature, less U at the start."""
        end = min(grid.service_value(self.values, finish, float(node)) for node in grid.vehicle_temperature)
        return end - grid.service_value(self.values, start, temperature)


def prove_service(grid: Grid, stock: Stock, proposed: Floats, volume: tuple[float, float]) -> Service:
    """The least price of a connected second for which U never rises by more than stock falls plus that price.

    `volume` is the range of the vehicles' tanks [m3].
    """
    values = tidy_service(proposed)
    closed, drawn = service_rises(grid, stock, values, volume)
    # Past the highest finish pressure U stays 0 to the end of the second.
    past = stock.prices[stock.bins[1:] >= 0.9 * grid.pressure[-1]]
    price = max(float(closed.max()), float(drawn.max()), -float(past[np.isfinite(past)].min()), 0.0)
    return Service(values, price * (1 + MARGIN) + MARGIN)


def tidy_service(values: Floats) -> Floats:
    """A U above a proposal that grows with pressure and is 0 at the highest finish pressure."""
    tidied = np.minimum(np.maximum.accumulate(values, axis=0), 0.0)
    tidied[-1] = 0.0
    return np.asarray(tidied)


def service_rises(grid: Grid, stock: Stock, values: Floats, volume: tuple[float, float]) -> tuple[Floats, Floats]:
    """Most by which a tidy U rises in a second with closed outlets, and above the fall of the stock in one that draws.

    Arrays over the cells of the vehicle's pressure.
    """
    shape = len(grid.pressure) - 1, _PARTS[0]
    closed, drawn = _closed(grid, values), _open(grid, stock, values, volume)
    return closed.reshape(shape).max(axis=1), drawn.reshape(shape).max(axis=1)


def leisure_gain(grid: Grid, stock: Stock, volume: float, start: float, temperature: float, finish: float) -> float:
    """What a vehicle costs at least, however long it stays [compressor-seconds]; 0 or a little less.

    Closed seconds never raise the stock. Open ones do by at most what its lowest price falls short of 0, and they are
    few: each brings the flow at the least gap, and before the last the vehicle lies below its finish pressure.
    """
    drawn = stock.prices[stock.bins[1:] >= 0.9 * grid.pressure[0]]
    short = max(0.0, -float(drawn[np.isfinite(drawn)].min()))
    kappa, flow = grid.bar_per_gram(volume), grid.flow_range[0]
    cold = float(grid.theta(grid.vehicle_temperature[:1])[0])
    grams = finish / (kappa * cold) - start / (kappa * float(grid.theta(np.array([temperature]))[0]))
    if short == 0:
        return 0.0
    return -short * (grams / flow + 1) * (1 + MARGIN) if flow > 0 else -np.inf


_PARTS = (16, 10)


def _vehicle_parts(grid: Grid) -> Floats:
    """Edges of the parts of a vehicle's pressure [bar]."""
    return grid.pressure_scale.pressure(refined(grid.y, _PARTS[0]))


def _service_slopes(grid: Grid, values: Floats) -> tuple[Interval, Interval]:
    """Intervals of both partial derivatives of U, a bar and a kelvin; U does not fall as pressure rises."""
    along, across = slopes(values, grid.y, grid.vehicle_temperature, _PARTS)
    rate = grid.pressure_scale.rate(_vehicle_parts(grid))[:, None]
    return product(along, (rate[:-1], rate[1:])), across


def _cells(grid: Grid, heating: float) -> tuple[Interval, Interval, Interval]:
    """Pressure of the points x, temperature of their starts s and relative warming, a column and two rows."""
    v, w = _vehicle_parts(grid), refined(grid.vehicle_temperature, _PARTS[1])
    step = _step_of_temperature(grid, abs(heating), grid.vehicle_temperature)
    cold = np.maximum(w[:-1] - step, grid.vehicle_temperature[0])
    warm = np.minimum(w[1:] + step, grid.vehicle_temperature[-1])
    drift = _drift(grid, heating, cold, warm)
    relative = product(drift, (1 / (warm + KELVIN), 1 / (cold + KELVIN)))
    return (v[:-1, None], v[1:, None]), drift, relative


def _closed(grid: Grid, values: Floats) -> Floats:
    """Most by which U rises in a connected second with closed outlets, for parts of the vehicle's pressure."""
    along, across = _service_slopes(grid, values)
    pressure, drift, relative = _cells(grid, 0.0)
    slack = 1.0 / (1.0 - min(0.5, np.abs(relative).max()))  # p(s) is p(x) up to the change of one second
    moved = product((pressure[0] / slack, pressure[1] * slack), relative)
    return np.asarray((product(along, moved)[1] + product(across, drift)[1]).max(axis=1))


def _open(grid: Grid, stock: Stock, values: Floats, volume: tuple[float, float]) -> Floats:
    """Most by which U rises above the fall of the stock in a second that draws, for parts of the vehicle's pressure."""
    heating = grid.plant.vehicle_heating
    along, across = _service_slopes(grid, values)
    pressure, drift, relative = _cells(grid, heating)
    flow = grid.flow_range[1]
    warmest = float(grid.theta(grid.vehicle_temperature[-1:])[0]) * (1 + float(np.abs(relative).max()))
    kappa = grid.bar_per_gram(volume[0]) * warmest, grid.bar_per_gram(volume[1])
    reach = float(np.abs(relative).max()) * grid.pressure[-1] + kappa[0] * flow
    before = np.maximum(pressure[0] - reach, grid.pressure[0]), np.minimum(pressure[1] + reach, grid.pressure[-1])
    warming = product(before, relative)
    theta = grid.theta(refined(grid.vehicle_temperature, _PARTS[1]))
    step = _step_of_temperature(grid, heating, grid.vehicle_temperature)
    stretch = (1 + step / (grid.vehicle_temperature[0] + KELVIN)) * (1 + np.maximum(relative[1], 0.0))
    hot = grid.bar_per_gram(volume[0]) * theta[1:] * stretch
    heat = product(across, drift)[1]
    least, most = _flows(grid, stock, pressure, volume)
    worst = np.full(pressure[0].shape[0], -np.inf)
    for end in (least, most):
        prices = _priced(stock, end)
        allowed = (least <= most) & np.isfinite(prices)
        # (pressure cells, temperature cells, bins): U rises at most along . dp + across . dT
        for row in range(pressure[0].shape[0]):
            f = end[row][allowed[row]]
            if f.size == 0:
                continue
            rise = hot[:, None] * f + warming[1][row][:, None]
            gain = np.maximum(along[1][row][:, None] * rise, along[0][row][:, None] * rise) + heat[row][:, None]
            worst[row] = max(worst[row], float((gain - prices[row][allowed[row]]).max()))
    return worst


def _flows(grid: Grid, stock: Stock, pressure: Interval, volume: tuple[float, float]) -> Interval:
    """Flows of the seconds whose segment passes a pressure cell of the vehicle and a bin of the buffer.

    The gap of the second's start is that of the point, less what both pressures moved since: by drawing, a share of
    the flow, by temperature a little.
    """
    plant = grid.plant
    hottest = float(grid.theta(grid.temperature[-1:])[0])
    vehicle = float(grid.theta(grid.vehicle_temperature[-1:])[0])
    step = _step_of_temperature(grid, max(plant.outlet_cooling), grid.temperature) / (grid.temperature[0] + KELVIN)
    vehicle_step = _step_of_temperature(grid, plant.vehicle_heating, grid.vehicle_temperature)
    vehicle_step /= grid.vehicle_temperature[0] + KELVIN
    share = plant.outlet_coefficient * (
        max(grid.kappa) * hottest * (1 + step) + grid.bar_per_gram(volume[0]) * vehicle * (1 + vehicle_step)
    )
    top = stock.bins[1:]
    thermal = top * step + grid.pressure[-1] * vehicle_step
    least = plant.outlet_coefficient * (stock.bins[:-1] - pressure[1] - thermal)
    most = plant.outlet_coefficient * (top - pressure[0] + thermal) / (1 - share) if share < 1 else least + np.inf
    most = np.broadcast_to(most, least.shape)
    least, most = np.maximum(least, grid.flow_range[0]), np.minimum(most, grid.flow_range[1])
    return least, most


def _priced(stock: Stock, flow: Floats) -> Floats:
    """Prices of every bin at flows (rows, bins), by the straight line below the concave least."""
    cell = np.clip(np.searchsorted(stock.flows, flow, side="right") - 1, 0, len(stock.flows) - 2)
    share = np.clip((flow - stock.flows[cell]) / (stock.flows[cell + 1] - stock.flows[cell]), 0.0, 1.0)
    bins = np.arange(stock.prices.shape[0])
    low, high = stock.prices[bins, cell], stock.prices[bins, cell + 1]
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(low), (1 - share) * low + share * high, np.inf)
