"""Costs of futures: the energy of each second by the tariff of its time, and stock that is missing at the end."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.columns import CODES, VALUES
from station.costs import account_edges, bill_of, stock_eur
from station.forecasting.fork import Fork
from station.geometry import BUFFERS, VALVES
from station.plants.interface import M, plant_named
from station.scenario import Scenario
from station.simulation import start_run
from station.tariff import Period, Tariff

Floats = NDArray[np.float64]

_VALVES = [list(CODES).index(valve) for valve in VALVES]
INLETS, OUTLETS = slice(_VALVES[0], _VALVES[2] + 1), slice(_VALVES[3], _VALVES[5] + 1)
"""Where the valves of inlets and outlets stand in the block of codes."""


def flat(price: float) -> Tariff:
    """One price of energy at all hours [EUR/kWh], for a station that has no tariff."""
    return Tariff(energy=[Period(from_h=0.0, to_h=24.0, eur_per_kwh=price)])


class Bill(NamedTuple):
    """Energy [kWh] and cost [EUR] of a future; NaN where the station has no account of its energy."""

    energy: float
    cost: float


class Account:
    """The account of a span of seconds of a scenario's station: every future of it is billed alike.

    Stock is missing against what the buffers hold when the scenario begins, so that a controller that leaves them
    empty gains nothing by it.
    """

    def __init__(self, scenario: Scenario, fork: Fork, horizon: float, price: float) -> None:
        station = scenario.station
        tariff = station.tariff or flat(price)
        plant = plant_named(station.plant)
        self._priced = scenario.model_copy(update={"station": station.model_copy(update={"tariff": tariff})})
        self._tariff, self._horizon, self._constants = tariff, horizon, fork.parameters.plant
        self._edges = account_edges(tariff, fork.time, fork.time + horizon)
        self._rows = (self._edges[:-1] - fork.time).astype(np.int64)
        self._meters = [len(VALUES) + list(plant.rates).index(name) for name in plant.powers]
        self._powers = station.powers
        begun, _ = start_run(scenario)
        self._first = begun.state[M : M + len(BUFFERS)].tolist()

    def bill(self, values: Floats, codes: NDArray[np.uint8], last: Floats, delivered: float) -> Bill:
        """The bill of a future from its rows, a row a second and none for the end.

        `last` holds the masses of the buffers at the end [g], `delivered` is the hydrogen dispensed [kg].
        """
        power = self._power(values, codes)
        if power is None:
            return Bill(np.nan, np.nan)
        spent = np.add.reduceat(power, self._rows) / 3600
        stock = stock_eur(self._priced, self._first, last.tolist(), self._constants)
        bill = bill_of(self._tariff, self._edges, spent, self._horizon, stock, delivered)
        return Bill(float(spent.sum()), bill["total_eur"])

    def _power(self, values: Floats, codes: NDArray[np.uint8]) -> Any:
        """Electric power in each second [kW]; None where the station does not tell."""
        if self._meters:
            return values[self._meters].sum(axis=0)
        compressor, precooler = self._powers
        if compressor is None or precooler is None:
            return None
        running: Any = codes[INLETS].sum(axis=0, dtype=np.float64)
        return compressor * running + precooler * codes[OUTLETS].any(axis=0)
