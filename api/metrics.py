"""Metrics of the service for Prometheus: counters that grow here, gauges that are read when it scrapes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from prometheus_client import CollectorRegistry, Counter, GCCollector, Histogram, PlatformCollector, ProcessCollector
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})

_ANSWER_S = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
"""A poll takes a millisecond, a question to a controller's certificate seconds [s]."""

_CHUNK_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3600.0)
"""A run of S1 takes 10 ms, `chunk_max_s` ends what takes longer than an hour [s]."""


@dataclass(frozen=True)
class Gauge:
    """A gauge as scraped: a figure for each combination of labels."""

    name: str
    about: str
    values: Mapping[Any, float]  # by the labels' values, a tuple
    labels: tuple[str, ...] = ()


class ServiceMetrics:
    """A registry of its own: two services in one process do not mix."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        for collector in (ProcessCollector, PlatformCollector, GCCollector):
            collector(registry=self.registry)
        self._requests = self._counter("hrs_http_requests", "Requests answered", "method", "route", "status")
        self._seconds = Histogram(
            "hrs_http_answer_seconds", "From a request to the beginning of its answer", ("method", "route"),
            buckets=_ANSWER_S, registry=self.registry,
        )  # fmt: skip
        self._known: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}
        self._chunks = Histogram(
            "hrs_chunk_seconds", "From the claim of a chunk to its end", ("kind", "outcome"), buckets=_CHUNK_S,
            registry=self.registry,
        )  # fmt: skip
        self._takeovers = self._counter("hrs_lease_takeovers", "Chunks that ended behind their first lease")
        self.workers_replaced = self._counter("hrs_workers_replaced", "Worker processes that died")
        self.late_ticks = self._counter("hrs_twin_late_ticks", "Ticks of live twins over 0.1 s late")
        self.samples_dropped = self._counter("hrs_samples_dropped", "Samples zenoh did not take")
        self.connections_ended = self._counter("hrs_connections_ended", "Connections the server ended", "reason")
        self.database_errors = self._counter("hrs_database_errors", "Transactions the database did not do")

    def _counter(self, name: str, about: str, *labels: str) -> Counter:
        return Counter(name, about, labels, registry=self.registry)

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """A request's answer has begun."""
        known = self._known.get((method, route, status))
        if known is None:
            method_ = method if method in _METHODS else "OTHER"
            known = self._requests.labels(method_, route, status), self._seconds.labels(method_, route)
            if method in _METHODS:
                self._known[method, route, status] = known
        known[0].inc()
        known[1].observe(seconds)

    def chunk_ended(self, kind: str, seconds: float, attempt: int, outcome: str) -> None:
        """A worker is done with a chunk."""
        self._chunks.labels(kind, outcome).observe(seconds)
        if attempt > 1:
            self._takeovers.inc()

    def show(self, gauges: Callable[[], Iterator[Gauge]]) -> None:
        """Read these whenever somebody asks."""
        self.registry.register(_Read(gauges))


class _Read(Collector):
    def __init__(self, gauges: Callable[[], Iterator[Gauge]]) -> None:
        self._gauges = gauges

    def describe(self) -> Iterator[GaugeMetricFamily]:
        """Nothing before it is asked: the database may not be there yet."""
        return iter(())

    def collect(self) -> Iterator[GaugeMetricFamily]:
        """The gauges as they are now."""
        for gauge in self._gauges():
            family = GaugeMetricFamily(gauge.name, gauge.about, labels=gauge.labels)
            for given, value in gauge.values.items():
                family.add_metric(given, value)
            yield family
