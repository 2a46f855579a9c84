"""Bounds of a scenario: prices of its station proved once, its queue solved for every limit on the waits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from station.arrivals import Vehicles
from station.bounds.grid import FINE, Grid, Resolution, make_grid
from station.bounds.proof import BufferPotential, prove_buffer_potential, time_only
from station.bounds.proposal import Proposer
from station.bounds.queue import Price, Queue, least_restored, least_wait
from station.bounds.service import Service, least_vehicle_cost, prove_service
from station.bounds.service_proposal import ServiceProposer
from station.bounds.spline import Floats
from station.errors import InputError
from station.scenario import Scenario

DESIGN_PRICES = ((0.3, 0.15, 0.0), (0.6, 0.3, 0.0), (1.2, 0.6, 0.0))
"""Compressor-seconds a connected second for which each potential is looked for, as many vehicles paying each.

A second of the first vehicle of a queue keeps all later ones waiting, a second of the last nobody: so a limit on the
sum of waits prices the seconds of a run from some most down to nothing. Few, since each costs seconds to find.
"""

SERVICE_PRICES = (0.0, 0.03, 0.08, 0.15, 0.22, 0.3, 0.4, 0.55, 0.75, 1.0, 1.3, 1.7)
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
    stocks: tuple[BufferPotential, ...]

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
        proposer = Proposer(
            grid, volume, float(np.median(starts)), max(len(v.arrival) for v in scenarios), len(DESIGN_PRICES[0])
        )
        stocks = []
        for done, mixed in enumerate(DESIGN_PRICES):
            progress(done, len(DESIGN_PRICES))
            stocks.append(prove_buffer_potential(grid, proposer.propose(mixed)))
        progress(len(DESIGN_PRICES), len(DESIGN_PRICES))
        return cls(grid, tuple(stocks))


@dataclass(frozen=True)
class _Class:
    """Vehicles whose tanks are so alike that one U prices them all."""

    members: np.ndarray
    volume: tuple[float, float]  # [m3]
    kinds: tuple[tuple[float, float, float], ...]  # start pressure, start temperature, finish pressure
    proposer: ServiceProposer

    def gains(self, grid: Grid, stock: BufferPotential, price: float) -> tuple[Service, Floats]:
        """A proved U at about `price`, and what each member gains."""
        service = prove_service(grid, stock, self.proposer.propose(stock, price), self.volume)
        known = {kind: service.gain(grid, *kind) for kind in set(self.kinds)}
        return service, np.array([known[kind] for kind in self.kinds])


def _classes(grid: Grid, vehicles: Vehicles) -> list[_Class]:
    """The classes of tank volume."""
    volumes = np.unique(vehicles.volume)
    edges = volumes if len(volumes) <= VOLUME_CLASSES else np.quantile(volumes, np.linspace(0, 1, VOLUME_CLASSES + 1))
    group = np.searchsorted(edges, vehicles.volume, side="right")
    found = []
    for number in np.unique(group):
        members = np.flatnonzero(group == number)
        span = float(vehicles.volume[members].min()), float(vehicles.volume[members].max())
        columns = vehicles.start_pressure, vehicles.start_temperature, vehicles.finish_pressure
        kinds = tuple(zip(*(column[members].tolist() for column in columns), strict=True))
        proposer = ServiceProposer(grid, span, float(np.median(vehicles.start_pressure[members])))
        found.append(_Class(members, span, kinds, proposer))
    return found


def _family(grid: Grid, stock: BufferPotential, vehicles: Vehicles, classes: list[_Class]) -> Price:
    """Every tangent of one stock, for every vehicle."""
    gains, paid = [], []
    for price in SERVICE_PRICES:
        row, highest = np.zeros(len(vehicles.arrival)), 0.0
        for item in classes:
            service, row[item.members] = item.gains(grid, stock, price)
            highest = max(highest, service.price)
        gains.append(row)
        paid.append(highest)
    columns = zip(*(column.tolist() for column in vehicles[1:]), strict=True)
    leisure = [least_vehicle_cost(grid, stock, volume, start, warm, finish) for start, warm, volume, finish in columns]
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
        for a station that has no bound; see `StationPrices.of`; for a scenario with faults of the plant.
    """
    if scenario.plant_faults:
        raise InputError("bounds", [("scenario.faults", "must hold none of the plant: bounds are proved without")])
    vehicles = scenario.vehicles(replication, seed)
    known = prices or StationPrices.of([vehicles], scenario, resolution)
    shortest = np.zeros(len(vehicles.arrival))
    classes, free = _classes(known.grid, vehicles), time_only(known.grid)
    for item in classes:
        service, gain = item.gains(known.grid, free, 1.0)
        shortest[item.members] = np.maximum(gain, 0.0) / service.price
    queue = Queue(vehicles.arrival, shortest, min(scenario.station.compressor.count, 3), scenario.time_limit_s)
    families = [_family(known.grid, stock, vehicles, classes) for stock in known.stocks]
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
