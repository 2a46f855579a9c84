"""Executors of chunks: processes of this machine, or an existing cluster."""

from __future__ import annotations

from typing import Protocol

from api.jobs.pool import WorkerPool
from api.jobs.work import JobTypes
from api.metrics import ServiceMetrics
from api.settings import PROCESSES, Settings
from api.store.jobs import JobRepository
from station import InputError


class Executor(Protocol):
    """Claims chunks from the store, has them computed, and stores what comes of them."""

    def start(self) -> None:
        """Begin; what a server of this name held before is given back first."""

    def wake(self) -> None:
        """There is work."""

    @property
    def wanted(self) -> int:
        """How many workers there should be at least."""

    @property
    def alive(self) -> int:
        """How many there are."""

    def close(self) -> None:
        """End; what is not done is given back."""


def make_executor(
    settings: Settings, repository: JobRepository, types: JobTypes, metrics: ServiceMetrics | None = None
) -> Executor:  # fmt: skip
    """The executor that the settings name.

    Raises
    ------
    InputError
        if it needs a package that is not installed.
    """
    if settings.executor == PROCESSES:
        return WorkerPool(settings, repository, types, metrics)
    try:
        from api.jobs.cluster import DaskExecutor
    except ImportError:
        message = f"{settings.executor} needs the extra `dask`: pip install 'hrs-twin[dask]'"
        raise InputError("settings", [("executor", message)]) from None
    return DaskExecutor(settings, repository, types, metrics)
