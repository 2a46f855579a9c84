"""One run: a controller on one replication of a scenario, its figures of merit and its record."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from controllers import create_from
from station import Metrics, Record, Scenario, simulate
from station.costs import COST_UNITS
from station.metrics import UNITS


@dataclass(frozen=True)
class Result:
    """One run's figures of merit."""

    scenario: str
    controller: str
    replication: int
    seed: int
    metrics: Metrics

    def as_row(self) -> dict[str, Any]:
        """A flat row for JSON and CSV; what is not finite becomes None."""
        figures = {
            name: None if value is None or not math.isfinite(value) else value for name, value in self.metrics.items()
        }
        about = {
            "scenario": self.scenario,
            "controller": self.controller,
            "replication": self.replication,
            "seed": self.seed,
        }
        return {**about, **figures}

    @classmethod
    def from_row(cls, row: dict[str, Any]) -> Result:
        """The result that `as_row` wrote down: null was infinite, but for the energy of some stations.

        What a version did not know that wrote it there was none of; figures of money stand where there is a tariff.
        """
        figures = {name: row.get(name, 0.0) for name in UNITS} | {name: row[name] for name in COST_UNITS if name in row}
        for name, value in figures.items():
            if value is None and name != "energy_kwh":
                figures[name] = math.inf
        return cls(row["scenario"], row["controller"], row["replication"], row["seed"], Metrics(**figures))


def run(scenario: Scenario, controller: str, replication: int = 0, *, seed: int = 0) -> tuple[Result, Record]:
    """Run a controller, given as a text like `minlp1:horizon=3`."""
    record = simulate(scenario, create_from(controller), replication=replication, seed=seed)
    return Result(scenario.name, controller, replication, seed, record.metrics()), record
