"""Costs of futures: the energy of each second by the tariff of its time, and stock that is missing at the end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from station.columns import VALUES
from station.costs import account_edges, bill_of, stocks_eur
from station.forecasting.fork import Fork
from station.forecasting.kernel import COUNTED, Meter, Tally
from station.geometry import BUFFERS
from station.plants.interface import M, plant_named
from station.scenario import Scenario
from station.simulation import start_run
from station.tariff import Period, Tariff

Floats = NDArray[np.float64]


def flat(price: float) -> Tariff:
    """One price of energy at all hours [EUR/kWh], for a station that has no tariff."""
    return Tariff(energy=[Period(from_h=0.0, to_h=24.0, eur_per_kwh=price)])


class Bill(NamedTuple):
    """Energy [kWh] and cost [EUR] of each future, (futures,); NaN where the station has no account of its energy."""

    energy: Floats
    cost: Floats


class Account:
    """The account of a span of seconds of a scenario's station: every future of it is billed alike.

    Stock is missing against what the buffers hold when the scenario begins, so that a controller that leaves them
    empty gains nothing by it.
    """

    def __init__(self, scenario: Scenario, fork: Fork, horizon: float, price: float) -> None:
        station = scenario.station
        tariff = station.tariff or flat(price)
        plant = plant_named(station.plant)
        self._station = station.model_copy(update={"tariff": tariff})
        self._tariff, self._horizon, self._constants = tariff, horizon, fork.parameters.plant
        self._edges = account_edges(tariff, fork.time, fork.time + horizon)
        begins = (self._edges[:-1] - fork.time).astype(np.int64)
        columns = np.array([len(VALUES) + list(plant.rates).index(name) for name in plant.powers], np.int64)
        compressor, precooler = station.powers
        self._known = bool(len(columns)) or (compressor is not None and precooler is not None)
        self.meter = Meter(columns, compressor or 0.0, precooler or 0.0, begins)
        begun, _ = start_run(scenario)
        self._first = begun.state[M : M + len(BUFFERS)]

    def tally(self, pressures: Floats) -> Tally:
        """Room for what futures leave whose `pressures` (futures, times, buffers) are wanted."""
        count = len(pressures)
        return Tally(pressures, np.zeros((count, len(self.meter.begins))), np.zeros((count, COUNTED), np.int64))

    def bill(self, spent: Floats, last: Floats, delivered: Floats) -> Bill:
        """The bill of futures.

        Parameters
        ----------
        spent
            Electric energy by span, (futures, spans) [kW s].
        last
            Masses of the buffers at the end, (futures, buffers) [g].
        delivered
            Hydrogen dispensed, (futures,) [kg].
        """
        if not self._known:
            unknown = np.full(len(spent), np.nan)
            return Bill(unknown, unknown)
        stocks = stocks_eur(self._station, self._first, last, self._constants)
        costs = [
            bill_of(self._tariff, self._edges, energy, self._horizon, stock, given)["total_eur"]
            for energy, stock, given in zip(spent / 3600, stocks.tolist(), delivered.tolist(), strict=True)
        ]
        return Bill(spent.sum(axis=1) / 3600, np.array(costs))
