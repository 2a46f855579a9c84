"""A running service: submit runs and comparisons, start and find twins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from api.client.jobs import Comparison, Run
from api.client.transport import Client
from api.client.twin import Twin
from station import Scenario

Wanted = str | Mapping[str, Any] | Scenario
"""A scenario: the name of one that the service knows, a whole one as a mapping, or a Scenario."""


class Service(Client):
    """A client that gives jobs and twins as objects.

    Examples
    --------
    >>> with Service(url="http://127.0.0.1:8000") as service:  # doctest: +SKIP
    ...     run = service.run("S1", "minlp1").wait()
    ...     pressures = run.series(["pressure_high"], step_s=60).pandas()
    """

    def run(
        self, scenario: Wanted, controller: str = "logic", *, replication: int = 0, seed: int = 0, record: str = "full"
    ) -> Run:  # fmt: skip
        """Submit a run; `record` says what is stored of it: full, vehicles or none."""
        asked = {
            "scenario": _said(scenario), "controller": controller, "replication": replication, "seed": seed,
            "record": record,
        }  # fmt: skip
        return Run(self, self.post("/v1/runs", asked))

    def compare(
        self, scenarios: Sequence[Wanted], controllers: Sequence[str], *, replications: int = 1, seed: int = 0,
        record: str = "none",
    ) -> Comparison:  # fmt: skip
        """Submit a comparison of controllers on scenarios; `record` as of a run."""
        asked = {
            "scenarios": [_said(scenario) for scenario in scenarios], "controllers": list(controllers),
            "replications": replications, "seed": seed, "record": record,
        }  # fmt: skip
        return Comparison(self, self.post("/v1/comparisons", asked))

    def runs(self) -> Iterator[Run]:
        """Every run, the newest first."""
        return (Run(self, document) for document in self.pages("/v1/runs"))

    def comparisons(self) -> Iterator[Comparison]:
        """Every comparison, the newest first."""
        return (Comparison(self, document) for document in self.pages("/v1/comparisons"))

    def start(self, scenario: Wanted, **order: Any) -> Twin:
        """Start a live twin; `order` has the fields of `POST /v1/twins`: id, controller, speed, at_end, ..."""
        return Twin(self.post("/v1/twins", {"scenario": _said(scenario), **order})["id"], self)

    def twin(self, name: str) -> Twin:
        """The twin of that id; whether there is one shows when it is asked."""
        return Twin(name, self)

    def twins(self) -> Iterator[Twin]:
        """Every twin, the oldest first."""
        return (Twin(document["id"], self) for document in self.pages("/v1/twins"))


def _said(scenario: Wanted) -> Any:
    """A scenario as requests have it."""
    return scenario.model_dump(mode="json", exclude_none=True) if isinstance(scenario, Scenario) else scenario
