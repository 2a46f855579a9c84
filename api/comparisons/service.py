"""Run every controller on every replication of every scenario, on all cores, in an order that never changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from api.jobs.cores import cores
from api.runs.service import Result, run
from controllers import create_from
from station import InputError, Scenario
from station.metrics import units_of

if TYPE_CHECKING:
    from api.store.jobs import JobRepository
    from api.store.records import Job

REPLICATIONS_MAX = 100_000
"""Ten replications of a day take a second of a core; beyond this a comparison belongs on a cluster."""


SAME = "nothing in it is drawn, so that every replication is the same: it is run once"
"""Why a scenario has one replication though more are wanted."""


def replications_of(scenario: Scenario, wanted: int) -> int:
    """How many replications of a scenario are run where so many are wanted: a recorded day is the same in each."""
    return wanted if scenario.drawn else 1


def notes(scenarios: Sequence[Scenario], wanted: int) -> list[str]:
    """A line for each scenario that has fewer replications than are wanted."""
    return [f"{each.name}: {SAME}" for each in scenarios if replications_of(each, wanted) < wanted]


def check(scenarios: Sequence[Scenario], controllers: Sequence[str], replications: int, seed: int) -> None:
    """Raise InputError unless every controller fits every station, names are unique and numbers in their limits."""
    if not 1 <= replications <= REPLICATIONS_MAX:
        raise InputError("comparison", [("replications", f"must be 1 to {REPLICATIONS_MAX}; given {replications}")])
    if seed < 0:
        raise InputError("comparison", [("seed", f"must not be negative; given {seed}")])
    _check_unique("scenarios", [scenario.name for scenario in scenarios])
    _check_unique("controllers", list(controllers))
    for name in controllers:
        for scenario in scenarios:
            create_from(name).start(scenario.known_station)


def compare(
    scenarios: Sequence[Scenario],
    controllers: Sequence[str],
    *,
    replications: int = 1,
    seed: int = 0,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Results in the order scenarios x controllers x replications, whatever the number of workers.

    A scenario in which nothing is drawn has one replication, however many there are of others.

    A controller is a name, or a text with options like `minlp1:horizon=3`. Kernels run outside the interpreter lock,
    so threads use all cores. `progress(done, total)` is called after each run.

    Raises
    ------
    InputError
        if a controller is unknown or does not fit a station; before anything runs.
    """
    check(scenarios, controllers, replications, seed)
    jobs = [
        (scenario, name, replication)
        for scenario in scenarios
        for name in controllers
        for replication in range(replications_of(scenario, replications))
    ]

    results = []
    with ThreadPoolExecutor(workers or cores()) as pool:
        for result in pool.map(lambda job: run(*job, seed=seed)[0], jobs):
            results.append(result)
            if progress:
                progress(len(results), len(jobs))
    return results


def done_of(job: Job, jobs: JobRepository) -> tuple[list[Scenario], list[Result]]:
    """A comparison's scenarios, and its results so far."""
    spec = jobs.spec(job.id) or {"scenarios": []}
    results = [Result.from_row(row) for row in jobs.results(job.id)]
    return [Scenario.model_validate(scenario) for scenario in spec["scenarios"]], results


def _check_unique(field: str, names: list[str]) -> None:
    if not names:
        raise InputError("comparison", [(field, "must name at least one")])
    for name in names:
        if names.count(name) > 1:
            raise InputError("comparison", [(field, f"{name!r} stands twice")])


def as_document(results: Sequence[Result]) -> dict[str, Any]:
    """The results as `hrs compare --json` writes them."""
    rows = [result.as_row() for result in results]
    return {"units": units_of(rows), "results": rows}
