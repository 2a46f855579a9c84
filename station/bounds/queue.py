"""The queue: connected seconds under a limit on the waits, and a linear program whose dual is summed here.

Vehicle i connects at a_i + w_i and leaves tau_i later; the next connects no sooner. So
w_{i+1} >= w_i + tau_i - (a_{i+1} - a_i) and w >= 0: Lindley's recursion as inequalities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from station.bounds.spline import Floats

SAFETY = 1e-7
"""Share of a bound's terms by which it is lowered against rounding in its sum."""


@dataclass(frozen=True)
class Price:
    """One proved family of prices: vehicle i costs at least gains[k, i] - prices[k] tau_i for every k.

    The compressor-seconds of a run, restored, are at least the sum over the vehicles plus `boundary`; those up to the
    end of any service at least the sum over the vehicles served less `used_most`.
    """

    gains: Floats  # (k, n) [s]
    prices: Floats  # (k,)
    boundary: float  # [s]
    used_most: float  # [s]


@dataclass(frozen=True)
class Queue:
    """A scenario as the queue's program needs it."""

    arrival: Floats  # [s]
    shortest: Floats  # least connected seconds of each vehicle [s]
    compressors: int  # that can work at once
    horizon: float  # time limit [s]


class _Program:
    """Rows `matrix x <= bound` over tau, w and, a family, the cost of each vehicle; then the restored time."""

    def __init__(self, queue: Queue, families: list[Price]) -> None:
        self.count = len(queue.arrival)
        self.width = (2 + len(families)) * self.count + 1
        self._entries: list[tuple[int, int, float]] = []
        self.right: list[float] = []
        n = self.count
        for i in range(n - 1):
            self._row({n + i: 1, i: 1, n + i + 1: -1}, queue.arrival[i + 1] - queue.arrival[i])
        for f, family in enumerate(families):
            first = (2 + f) * n
            for gain, price in zip(family.gains, family.prices, strict=True):
                for i in range(n):
                    self._row({first + i: -1, i: -price}, -gain[i])
            total = {first + i: 1.0 for i in range(n)}
            self._row({**total, self.width - 1: -1}, -family.boundary)
            for i in range(n - 1, -1, -max(1, n // 100)):
                served = {first + j: 1.0 for j in range(i + 1)}
                most = queue.compressors * queue.arrival[i] + family.used_most
                self._row({**served, n + i: -queue.compressors, i: -queue.compressors}, most)
        top = max((float(family.gains.max()) for family in families), default=0.0)
        low = min((float((f.gains - f.prices[:, None] * queue.horizon).max(axis=0).min()) for f in families), default=0)
        self.lower = np.concatenate((queue.shortest, np.zeros(n), np.full(len(families) * n, min(low, 0.0)), [0.0]))
        self.upper = np.full(self.width, queue.horizon)
        self.upper[2 * n :] = max(top, 0.0) + 1
        self.upper[-1] = (max(top, 0.0) + 1) * n + sum(abs(f.boundary) for f in families) + 1

    def _row(self, entries: dict[int, float], right: float) -> None:
        self._entries += [(len(self.right), column, value) for column, value in entries.items()]
        self.right.append(float(right))

    def least(self, cost: Floats, wait: float | None) -> float:
        """A lower bound on the least of `cost . x`, proved by its dual; infinite if a dual proves there is no x."""
        if np.any(self.lower > self.upper):
            return float("inf")
        upper = self.upper.copy()
        entries, right = list(self._entries), list(self.right)
        if wait is not None:
            entries += [(len(right), self.count + i, 1.0) for i in range(self.count)]
            right.append(wait)
        rows, columns, values = zip(*entries, strict=True)
        matrix = csr_matrix((values, (rows, columns)), shape=(len(right), self.width))
        bounds = np.column_stack((self.lower, upper))
        found = linprog(cost, matrix, right, bounds=bounds, method="highs")
        if found.x is not None:
            return self._dual(cost, matrix, np.array(right), -found.ineqlin.marginals)
        return self._impossible(matrix, np.array(right))

    def _dual(self, cost: Floats, matrix: csr_matrix, right: Floats, multipliers: Floats) -> float:
        """The value of Lagrange's bound at any multipliers: no solver's word is taken for it."""
        y = np.maximum(multipliers, 0.0)
        reduced = cost + matrix.T @ y
        ends = np.minimum(reduced * self.lower, reduced * self.upper)
        scale = float(np.abs(ends).sum() + np.abs(y * right).sum())
        return float(ends.sum() - y @ right) - SAFETY * (scale * 1e-3 + 1)

    def _impossible(self, matrix: csr_matrix, right: Floats) -> float:
        """Infinity if the least sum of violations of the rows is proved positive, else the trivial bound."""
        extra = csr_matrix((-np.ones(len(right)), (np.arange(len(right)), np.arange(len(right)))))
        wide = csr_matrix(np.hstack((matrix.toarray(), extra.toarray()))) if len(right) < 3000 else None
        if wide is None:
            return 0.0
        bounds = [*zip(self.lower, self.upper, strict=True), *((0.0, None) for _ in right)]
        cost = np.concatenate((np.zeros(self.width), np.ones(len(right))))
        found = linprog(cost, wide, right, bounds=bounds, method="highs")
        if found.x is None:
            return 0.0
        y = np.clip(-found.ineqlin.marginals, 0.0, 1.0)
        return float("inf") if self._dual(np.zeros(self.width), matrix, right, y) > 0 else 0.0


def least_wait(queue: Queue, families: list[Price]) -> float:
    """No controller has less t_total [s]."""
    program = _Program(queue, families)
    cost = np.zeros(program.width)
    cost[program.count : 2 * program.count] = 1.0
    return max(program.least(cost, None), 0.0)


def least_restored(queue: Queue, families: list[Price], wait: float | None) -> float:
    """No controller with t_total <= wait (None: any) has less t_comp_restored [s]."""
    program = _Program(queue, families)
    cost = np.zeros(program.width)
    cost[-1] = 1.0
    return max(program.least(cost, wait), 0.0)
