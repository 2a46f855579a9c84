"""Jobs of a service as objects: runs, comparisons and forecasts, awaited and read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Self

from api.client.series import Series, selection
from api.client.transport import Client, ServiceError

Progress = Callable[[dict[str, Any]], None]


class JobError(ServiceError):
    """A job failed or was cancelled; `problem` is what the service says of it."""

    def __init__(self, job: str, state: str, problem: dict[str, Any] | None) -> None:
        self.problem = problem or {}
        about = f": {self.problem.get('title', '')}: {self.problem.get('detail', '')}".rstrip(": ")
        super().__init__(f"{job} {state}{about}")


def _quiet(_job: dict[str, Any]) -> None:
    """Nothing to say."""


class Job:
    """A job of a service, with the document that was last read of it.

    Parameters
    ----------
    client
        Of the service.
    document
        The job as the service answers it.
    """

    kind: ClassVar[str]

    def __init__(self, client: Client, document: dict[str, Any]) -> None:
        self.client = client
        self.document = document

    @property
    def id(self) -> str:
        """Id; later jobs have later ids."""
        return str(self.document["id"])

    @property
    def state(self) -> str:
        """State when it was last read: queued, running, succeeded, failed or cancelled."""
        return str(self.document["state"])

    @property
    def path(self) -> str:
        """Place of the job in the service."""
        return f"/v1/{self.kind}/{self.id}"

    def refresh(self) -> Self:
        """Read the job again."""
        self.document = self.client.get(self.path)
        return self

    def wait(self, progress: Progress = _quiet) -> Self:
        """Wait until it has ended; `progress` is shown its document several times a second.

        Raises
        ------
        JobError
            if it failed or was cancelled.
        """
        self.document = self.client.wait(self.path, progress)
        if self.state != "succeeded":
            raise JobError(self.id, self.state, self.document.get("problem"))
        return self

    def cancel(self) -> Self:
        """End it where it stands; one that has ended stays as it is."""
        self.document = self.client.post(f"{self.path}/cancel")
        return self

    def delete(self) -> None:
        """Have it forgotten; it must have ended."""
        self.client.delete(self.path)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.id}, {self.state})"


class Run(Job):
    """A run of a controller on a scenario."""

    kind = "runs"

    @property
    def metrics(self) -> dict[str, float]:
        """Figures of merit; those of `station.metrics.UNITS`, empty until it has succeeded."""
        return dict(self.document.get("metrics") or {})

    def series(
        self, columns: Sequence[str] = (), *, from_s: float | None = None, to_s: float | None = None,
        step_s: float | None = None, extremes: bool = False,
    ) -> Series:  # fmt: skip
        """The record, or the columns, span [s] and step [s] of it that are asked for; `time` comes first.

        With `extremes` each step is two rows, the least and the greatest of every column.
        """
        query = selection(list(columns), from_s, to_s, step_s, extremes=extremes)
        return Series(self.client.read(f"{self.path}/series", **query))

    def vehicles(self) -> Series:
        """The table of vehicles, a row each."""
        return Series(self.client.read(f"{self.path}/vehicles", format="parquet"))


class Comparison(Job):
    """Controllers on replications of scenarios."""

    kind = "comparisons"

    def results(self) -> Series:
        """Figures of merit of every run done so far, a row each."""
        return Series(self.client.read(f"{self.path}/results", format="parquet"))

    def figures(self) -> dict[str, Any]:
        """Mean and standard deviation of each figure by scenario and controller."""
        found: dict[str, Any] = self.client.get(f"{self.path}/figures")
        return found

    def tables(self) -> dict[str, Any]:
        """The tables that `hrs compare` prints."""
        found: dict[str, Any] = self.client.get(f"{self.path}/table")
        return found

    def report(self) -> str:
        """The self-contained page that `hrs compare --html` writes."""
        return self.client.read(f"{self.path}/report").decode()


class Forecast(Job):
    """What controllers will make of the time to come at a live twin."""

    kind = "forecasts"

    @property
    def answer(self) -> dict[str, Any]:
        """Bands, ranking and advice; empty until it has succeeded."""
        return dict(self.document.get("answer") or {})
