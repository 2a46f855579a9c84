"""Bounds of a scenario: prices of its station proved once, its queue solved for every limit on the waits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from station.arrivals import Vehicles
from station.bounds.grid import FINE, Floats, Grid, Resolution, make_grid
from station.bounds.proof import Service, Stock, leisure_gain, prove_service, prove_stock, time_only
from station.bounds.proposal import Proposer, propose_service
from station.bounds.queue import Price, Queue, least_restored, least_wait
from station.scenario import Scenario

DESIGN_PRICES = (0.2, 0.35)
"""Compressor-seconds a connected second for which potentials are looked for: few, since each costs seconds to find."""

SERVICE_PRICES = (0.02, 0.06, 0.12, 0.17, 0.21, 0.25, 0.29, 0.33, 0.4, 0.55, 0.8, 1.2)
"""Prices of a connected second at which a proved potential prices vehicles: tangents of the trade-off."""

VOLUME_CLASSES = 6
"""Vehicles of unequal tanks are priced in so many classes, each for its whole range of volumes."""


@dataclass(frozen=True)
class Point:
    """One point below the trade-off: with t_total <= wait, t_comp_restored >= restored (infinite: no controller)."""

    wait: float  # [s]; infinite where the waits are free
    restored: float  # [s]


@dataclass(frozen=True)
class Bounds:
    """Lower bounds for every controller, on runs in which every vehicle is filled."""

    scenario: str
    station: str
    replication: int
    vehicles: int
    t_total: float  # [s]
    t_comp_restored: float  # whatever the waits [s]
    trade_off: tuple[Point, ...]

    def document(self) -> dict[str, Any]:
        """As JSON takes it: infinite figures are null, units are in the names."""
        return {
            "scenario": self.scenario,
            "station": self.station,
            "replication": self.replication,
            "vehicles": self.vehicles,
            "t_total_s": self.t_total,
            "t_comp_restored_s": self.t_comp_restored,
            "trade_off": [
                {f"{name}_s": value if np.isfinite(value) else None for name, value in asdict(point).items()}
                for point in self.trade_off
            ],
        }


@dataclass(frozen=True)
class StationPrices:
    """Proved potentials of one station; they serve every scenario whose vehicles lie within its ranges."""

    grid: Grid
    stocks: tuple[Stock, ...]

    @classmethod
    def of(
        cls,
        scenarios: Sequence[Vehicles],
        station: Scenario,
        resolution: Resolution = FINE,
        progress: Callable[[int, int], None] = lambda _done, _total: None,
    ) -> StationPrices:
        """Look for and prove potentials for the station of `station` and the vehicles of some scenarios.

        Raises
        ------
        InputError
            for a station whose buffers could get too cold; see `station.bounds.grid.make_grid`.
        """
        starts = np.concatenate([vehicles.start_pressure for vehicles in scenarios])
        finish = max(float(vehicles.finish_pressure.max()) for vehicles in scenarios)
        grid = make_grid(station.station, resolution, (float(starts.min()), float(starts.max())), finish)
        volume = float(np.median(np.concatenate([vehicles.volume for vehicles in scenarios])))
        proposer = Proposer(grid, volume, float(np.median(starts)), max(len(v.arrival) for v in scenarios))
        stocks = []
        for done, price in enumerate(DESIGN_PRICES):
            progress(done, len(DESIGN_PRICES))
            stocks.append(prove_stock(grid, proposer.propose(price)))
        progress(len(DESIGN_PRICES), len(DESIGN_PRICES))
        return cls(grid, tuple(stocks))


def _classes(vehicles: Vehicles) -> list[np.ndarray]:
    """Indices of the vehicles of each class of tank volume."""
    volumes = np.unique(vehicles.volume)
    edges = volumes if len(volumes) <= VOLUME_CLASSES else np.quantile(volumes, np.linspace(0, 1, VOLUME_CLASSES + 1))
    group = np.searchsorted(edges, vehicles.volume, side="right")
    return [np.flatnonzero(group == number) for number in np.unique(group)]


def _gains(grid: Grid, stock: Stock, price: float, vehicles: Vehicles) -> list[tuple[np.ndarray, Service, Floats]]:
    """Classes of vehicles, their proved service prices, and what each vehicle gains."""
    found = []
    for members in _classes(vehicles):
        volumes, starts = vehicles.volume[members], vehicles.start_pressure[members]
        span = float(volumes.min()), float(volumes.max())
        proposed = propose_service(grid, stock, price, span[1], float(np.median(starts)))
        service = prove_service(grid, stock, proposed, span)
        kinds = list(zip(starts, vehicles.start_temperature[members], vehicles.finish_pressure[members], strict=True))
        known = {kind: service.gain(grid, *map(float, kind)) for kind in set(kinds)}
        found.append((members, service, np.array([known[kind] for kind in kinds])))
    return found


def _family(prices: StationPrices, stock: Stock, vehicles: Vehicles) -> Price:
    """Every tangent of one stock, for every vehicle."""
    gains, paid = [], []
    for price in SERVICE_PRICES:
        row = np.zeros(len(vehicles.arrival))
        found = _gains(prices.grid, stock, price, vehicles)
        for members, _, gain in found:
            row[members] = gain
        gains.append(row)
        paid.append(max(service.price for _, service, _ in found))
    kinds = zip(*(column.tolist() for column in vehicles[1:]), strict=True)
    leisure = [leisure_gain(prices.grid, stock, volume, start, warm, finish) for start, warm, volume, finish in kinds]
    if np.all(np.isfinite(leisure)):
        gains.append(np.array(leisure))
        paid.append(0.0)
    return Price(np.array(gains), np.array(paid), stock.boundary, stock.used_most)


def bounds(
    scenario: Scenario,
    waits: Sequence[float] = (),
    *,
    prices: StationPrices | None = None,
    replication: int = 0,
    seed: int = 0,
    resolution: Resolution = FINE,
) -> Bounds:
    """Bounds of one replication of a scenario, and of the trade-off at these limits on t_total [s].

    `prices` are those of its station if they are known already.

    Raises
    ------
    InputError
        for a station that has no bound; see `StationPrices.of`.
    """
    vehicles = scenario.vehicles(replication, seed)
    known = prices or StationPrices.of([vehicles], scenario, resolution)
    shortest = np.zeros(len(vehicles.arrival))
    for members, service, gain in _gains(known.grid, time_only(known.grid), 1.0, vehicles):
        shortest[members] = np.maximum(gain, 0.0) / service.price
    queue = Queue(vehicles.arrival, shortest, min(scenario.station.compressor.count, 3), scenario.time_limit_s)
    families = [_family(known, stock, vehicles) for stock in known.stocks]
    points = tuple(Point(float(wait), least_restored(queue, families, wait)) for wait in waits)
    return Bounds(
        scenario=scenario.name,
        station=scenario.station.name,
        replication=replication,
        vehicles=len(vehicles.arrival),
        t_total=least_wait(queue, families),
        t_comp_restored=least_restored(queue, families, None),
        trade_off=points,
    )
