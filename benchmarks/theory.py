"""What certificates cost: deciding many small inequalities against CVXPY in the same run, and checking them exactly."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.measure import Bar, Row, repeated
from theory import Certificate, DwellTime, PersistentDwellTime, Representation, SwitchedSystem, verify
from theory.arrays import Array
from theory.switching import gain, stability
from theory.switching.examples import example
from theory.switching.graph import Graph

NODES = 800
"""Matrices; two successors each make 1600 inequalities besides the 800 that each is positive."""


def rows(repeats: int) -> Iterator[Row]:
    """Every row, measured when asked for."""
    yield from _many_small(max(3, repeats // 3))
    yield from _sizes(max(3, repeats // 3))
    yield from _checking(repeats)
    yield from _examples(repeats)


def random_graph(nodes: int = NODES, seed: int = 0, size: int = 2, norm: float = 0.8) -> tuple[Graph, Array]:
    """Nodes with two random successors and a map of that size and norm each."""
    chance = np.random.default_rng(seed)
    maps = chance.normal(size=(nodes, size, size))
    maps *= (norm / np.linalg.norm(maps, 2, axis=(1, 2)))[:, None, None]
    successors = chance.integers(0, nodes, (nodes, 2))
    edges = tuple((u, 1, int(v)) for u in range(nodes) for v in successors[u])
    return Graph(nodes, edges), np.repeat(maps, 2, axis=0)


def _sizes(repeats: int) -> Iterator[Row]:
    """Larger matrices: contracting maps, livelier ones, and ones for which a program has to decide."""
    for size, nodes, bar, lively in ((8, 60, 5, 1.4), (12, 24, 3, 1.4), (20, 8, 2, 1.6)):
        for norm in (0.8, 1.3, lively):
            yield from _decided(repeats, size, nodes, norm, Bar("at least", bar))


def _decided(repeats: int, size: int, nodes: int, norm: float, bar: Bar) -> Iterator[Row]:
    graph, maps = random_graph(nodes, size=size, norm=norm)
    ours = repeated(lambda: stability.feasible(graph, maps), repeats, time.process_time)
    what = f"{nodes} matrices of size {size} x 2 successors, maps of norm {norm:g}"
    yield Row(f"{what} (CPU)", ours, "s")
    theirs = _referee(graph, maps, repeats)
    if theirs is not None:
        ratios = tuple(b / a for a, b in zip(ours, theirs, strict=True))
        yield Row(f"CVXPY / ours, {what} (CPU)", ratios, "times", bar)


def _many_small(repeats: int) -> Iterator[Row]:
    graph, maps = random_graph()
    ours = repeated(lambda: stability.feasible(graph, maps), repeats, time.process_time)
    yield Row(f"{NODES} matrices x 2 successors: assemble and solve (CPU)", ours, "s")
    theirs = _referee(graph, maps, repeats)
    if theirs is None:
        return
    yield Row("the same with CVXPY and Clarabel (CPU)", theirs, "s")
    ratios = tuple(b / a for a, b in zip(ours, theirs, strict=True))
    yield Row("CVXPY / ours (CPU)", ratios, "times", Bar("at least", 25))


def _referee(graph: Graph, maps: Array, repeats: int) -> tuple[float, ...] | None:
    """Seconds that CVXPY takes with the same solver; None where the extra `test` is not installed."""
    try:
        import cvxpy as cp
    except ImportError:
        return None

    def referee() -> None:
        size = maps.shape[-1]
        unknown = [cp.Variable((size, size), symmetric=True) for _ in range(graph.nodes)]
        identity = np.eye(size)
        limits = [item >> identity for item in unknown]
        limits += [unknown[u] - maps[k].T @ unknown[v] @ maps[k] >> identity for k, (u, _, v) in enumerate(graph.edges)]
        problem = cp.Problem(cp.Minimize(0), limits)
        problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]  # CVXPY has no types
        if problem.status != "optimal":
            raise RuntimeError(f"the referee ended with {problem.status}")

    return repeated(referee, repeats, time.process_time)


def wide_certificate() -> Certificate:
    """A certificate with 243 edge inequalities of size 6."""
    chance = np.random.default_rng(3)
    halves = chance.normal(size=(3, 5, 5))
    maps = 0.6 * halves / np.linalg.norm(halves, 2, axis=(1, 2))[:, None, None]
    system = SwitchedSystem(
        A=np.round(maps, 4), C=np.round(chance.normal(size=(3, 1, 5)), 3), E=np.round(chance.normal(size=(3, 5, 1)), 3)
    )
    return gain.certify(system, DwellTime(1, modes=3), representation=Representation(lift=4))


def _checking(repeats: int) -> Iterator[Row]:
    document = wide_certificate().document
    share = 1500 / len(document["proof"]["edges"])
    times = repeated(lambda: verify(document), repeats, time.process_time)
    yield Row(
        "checking 1500 inequalities of size 6 exactly, plain Python (CPU)", tuple(share * item for item in times), "s",
        Bar("at most", 0.3),
    )  # fmt: skip


def _examples(repeats: int) -> Iterator[Row]:
    system, language = example("example_4_3"), PersistentDwellTime(1, 1, modes=2)
    four = Representation(lift=4)
    yield Row(
        "Example 4.3: decay rate with 4 letters looked ahead, certified (CPU)",
        repeated(lambda: stability.decay_rate(system, language, representation=four), repeats, time.process_time), "s",
    )  # fmt: skip
