"""What is proved of the vehicles: the price of a connected second at which U never outgrows the fall of the stock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from station.bounds.grid import Floats, Grid
from station.bounds.intervals import MARGIN, Interval, drift_range, largest_drift, product, refined, slopes
from station.bounds.proof import Stock
from station.plant import KELVIN

_PARTS = (16, 10)
"""Parts of a cell of a vehicle's pressure and of its temperature."""


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
    step = largest_drift(grid, abs(heating), grid.vehicle_temperature)
    cold = np.maximum(w[:-1] - step, grid.vehicle_temperature[0])
    warm = np.minimum(w[1:] + step, grid.vehicle_temperature[-1])
    drift = drift_range(grid, heating, cold, warm)
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
    step = largest_drift(grid, heating, grid.vehicle_temperature)
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
    step = largest_drift(grid, max(plant.outlet_cooling), grid.temperature) / (grid.temperature[0] + KELVIN)
    vehicle_step = largest_drift(grid, plant.vehicle_heating, grid.vehicle_temperature)
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
