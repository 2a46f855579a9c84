"""Inequalities of a plant with observer and feedback: linear in L for given K, and in K for given L."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from theory.arrays import Array
from theory.errors import InfeasibleError, NotCertifiedError, SolverError
from theory.solvers.lmi import Blocks, Indices, LmiProblem, MatrixVariable
from theory.switching.graph import Graph
from theory.switching.loops import edge_indices
from theory.switching.synthesis import GainSchedule, add_jump_inequalities, gain_keys
from theory.switching.system import Gains, SwitchedSystem

SLACKS = (1e-5, 1e-4, 1e-3)
"""Relative excesses of gamma^2 over the optimum while K or L is read off with the largest margin."""

LARGES = (None, 1e4, 1e2, 1e3)
"""Bounds of the slack matrices that are tried."""

MARGIN_MIN = 1e-9
"""Smallest margin that counts, of matrices of trace 2 n on the mean."""

Key = tuple[int, int]
Known = Mapping[Key, Array]
Inequalities = tuple[LmiProblem, Callable[[Array], dict[Key, Array]], int]
"""A problem, how L or K is read off its solution, and the place of its last unknown: gamma^2, or the margin."""


class OutputLoop:
    """The plant with its controllers xh+ = A xh + B u + L (m - M xh), u = K xh along a graph.

    Parameters
    ----------
    system
        With B and M.
    graph
        Its labels name the plant's mode, the controller's mode, and its clock.
    schedule
        The arguments of K and L.
    """

    def __init__(self, system: SwitchedSystem, graph: Graph, schedule: GainSchedule) -> None:
        self.system, self.graph, self._size = system, graph, system.size
        self._keys = gain_keys(graph, schedule)
        self._numbers = {key: number for number, key in enumerate(dict.fromkeys(self._keys.values()))}
        self._which = np.array([self._numbers[self._keys[label]] for _, label, _ in graph.edges])

    def known(self, gains: Gains) -> dict[Key, Array]:
        """K of every key."""
        return {key: gains[label[1:]] for label, key in self._keys.items() if isinstance(label, tuple)}

    def controllers(self, feedback: Known, observers: Known) -> Gains:
        """[0 K; L (A + B K - L M)] of every mode and clock, rounded as they will be certified."""
        made = {}
        for label, key in self._keys.items():
            if isinstance(label, tuple):
                mode, k, observer = self.system.floats[label[1] - 1], feedback[key], observers[key]
                own = mode["A"] + mode["B"] @ k - observer @ mode["M"]
                made[label[1:]] = np.block([[np.zeros((len(k), observer.shape[1])), k], [observer, own]])
        return Gains.rounded(made, states=self._size)

    def decaying(self, feedback: Known, rate: float) -> dict[Key, Array] | None:
        """L with which every signal decays faster than rate^k; None if there are none."""
        problem, read, margin = self.observers(feedback, rate=rate)
        try:
            values = problem.minimize({margin: -1.0}, "observer").values
        except SolverError:
            return None
        return read(values) if values[margin] > MARGIN_MIN else None

    def smallest(self, inequalities: Callable[..., Inequalities], known: Known) -> tuple[float, dict[Key, Array]]:
        """The smallest gain of `observers` or `gains`, and what is read off next to it with the largest margin.

        Where the infimum is out of the solver's reach, the smallest with bounded slack matrices.
        """
        failure: SolverError | None = None
        for large in LARGES:
            try:
                problem, _, last = inequalities(known, large=large)
                square = float(problem.minimize({last: 1.0}, "output feedback").values[last])
            except InfeasibleError as error:
                if large is None:
                    raise
                failure = error
                continue
            except SolverError as error:
                failure = error
                continue
            for slack in SLACKS:
                problem, read, last = inequalities(known, square=square * (1 + slack), large=large)
                try:
                    return math.sqrt(square), read(problem.minimize({last: -1.0}, "output feedback").values)
                except SolverError as error:
                    failure = error
        raise failure or InfeasibleError("no margin", "output feedback")

    def observers(
        self, feedback: Known, *, square: float | None = None, rate: float | None = None, large: float | None = None
    ) -> Inequalities:
        """[X + X' - P_v, X' G - Y H, X' E - Y N, 0; ., P_u, 0, C'; ., ., g^2 I, F'; ., ., ., I] > 0 of (x, x - xh).

        X = [X11 X12; 0 X22] and Y = X22' L, so that L enters by Y alone. For a rate it is [X + X' - P_v, X' G - Y H; .,
        r^2 P_u] > 0.
        """
        pieces = [self._with_feedback(*label, feedback[self._keys[label]]) for label in self._labels]
        loop, drive, seen, noise, out, direct = (np.array(parts) for parts in zip(*pieces, strict=True))
        frame, n, count = _Frame(self, square, rate), self._size, len(self._numbers)
        ahead, here = frame.ahead, frame.here
        one, beside, own = (frame.problem.full(count, n, n) for _ in range(3))
        product = frame.problem.full(count, n, seen.shape[1])
        edges = frame.edges(frame.seen.T @ (out @ here + direct @ frame.noise) if rate is None else 0.0)
        edges.congruence(frame.unknown, frame.target, ahead, -1.0)
        edges.congruence(frame.unknown, frame.source, here, 1.0 if rate is None else rate**2)
        drive, noise = drive[..., : len(frame.noise)], noise[..., : len(frame.noise)]
        through = ahead + loop @ here + drive @ frame.noise
        for unknown, left, right in ((one, through[:, :n], ahead[:n]), (beside, through[:, :n], ahead[n:]),
                                     (own, through[:, n:], ahead[n:]),
                                     (product, ahead[n:], -(seen @ here + noise @ frame.noise))):  # fmt: skip
            edges.product(unknown, self._which, left, right)
        frame.bound(large, one, beside, own, product)
        frame.close(edges, frame.enter, frame.leave)
        return frame.problem, lambda values: self._read(own.of(values), product.of(values)), frame.last

    def gains(self, observers: Known, *, square: float | None = None, large: float | None = None) -> Inequalities:
        """(3.21) and (3.22) of the loop in (xh, e) with X = [X11 0; X21 X22] and U = K X11: K enters by U alone."""
        pieces = [self._with_observer(*label, observers[self._keys[label]]) for label in self._labels]
        loop, drive, driven, out, direct, turned = (np.array(parts) for parts in zip(*pieces, strict=True))
        frame, n, count = _Frame(self, square, None), self._size, len(self._numbers)
        ahead, here, seen = frame.ahead, frame.here, frame.seen
        own, below, one = (frame.problem.full(count, n, n) for _ in range(3))
        product = frame.problem.full(count, driven.shape[2], n)
        edges = frame.edges(-(ahead.T @ drive + seen.T @ direct) @ frame.noise)
        edges.congruence(frame.unknown, frame.target, ahead).congruence(frame.unknown, frame.source, here, -1.0)
        through = here - np.swapaxes(loop, 1, 2) @ ahead - np.swapaxes(out, 1, 2) @ seen
        acting = -np.swapaxes(driven, 1, 2) @ ahead - np.swapaxes(turned, 1, 2) @ seen
        for unknown, left, right in ((own, through[:, :n], here[:n]), (below, through[:, n:], here[:n]),
                                     (one, through[:, n:], here[n:]), (product, acting, here[:n])):  # fmt: skip
            edges.product(unknown, self._which, left, right)
        frame.bound(large, one, below, own, product)
        frame.close(edges, frame.leave, frame.enter)

        def read(values: Array) -> dict[Key, Array]:
            turned_back = self._read(own.of(values), np.swapaxes(product.of(values), 1, 2))
            return {key: found.T for key, found in turned_back.items()}

        return frame.problem, read, frame.last

    @cached_property
    def _labels(self) -> list[tuple[int, int, int]]:
        return [label for _, label, _ in self.graph.edges if isinstance(label, tuple)]

    def _read(self, slacks: Array, products: Array) -> dict[Key, Array]:
        """X^-T Y of every key."""
        try:
            return {key: np.linalg.solve(slacks[k].T, products[k]) for key, k in self._numbers.items()}
        except np.linalg.LinAlgError as error:
            raise NotCertifiedError("neither gain nor observer can be read off: X is singular") from error

    def _with_feedback(self, mode: int, acting: int, _clock: int, k: Array) -> tuple[Array, ...]:
        """G, E, H, N, C, F of the loop in (x, e) but for L: the plant of a mode, the controller of another."""
        own, other, n = self.system.floats[mode - 1], self.system.floats[acting - 1], self._size
        driven, odd = own["B"] @ k, (own["B"] - other["B"]) @ k
        loop = np.block([[own["A"] + driven, -driven], [own["A"] - other["A"] + odd, other["A"] - odd]])
        seen = np.hstack([own["M"] - other["M"], other["M"]])
        drive, noise, out, turned, direct = _disturbed(own, n)
        turned = turned @ k
        return loop, np.vstack([drive, drive]), seen, noise, np.hstack([out + turned, -turned]), direct

    def _with_observer(self, mode: int, acting: int, _clock: int, observer: Array) -> tuple[Array, ...]:
        """G, E, B, C, F, D of the loop in (xh, e) but for K."""
        own, other, n = self.system.floats[mode - 1], self.system.floats[acting - 1], self._size
        odd = observer @ (own["M"] - other["M"])
        loop = np.block([[other["A"] + odd, observer @ own["M"]],
                         [own["A"] - other["A"] - odd, own["A"] - observer @ own["M"]]])  # fmt: skip
        drive, noise, out, turned, direct = _disturbed(own, n)
        pushed = np.vstack([observer @ noise, drive - observer @ noise])
        return loop, pushed, np.vstack([other["B"], own["B"] - other["B"]]), np.hstack([out, out]), direct, turned


class _Frame:
    """Rows and unknowns of the inequalities: x+, x, w, y of plant and controller; the last two for a gain alone."""

    def __init__(self, loop: OutputLoop, square: float | None, rate: float | None) -> None:
        mode, n = loop.system.floats[0], loop.system.size
        drive, _, out, *_ = _disturbed(mode, n) if rate is None else (np.zeros((n, 0)), None, np.zeros((0, n)))
        select = np.eye(4 * n + drive.shape[1] + len(out))
        self.ahead, self.here, self.noise, self.seen = np.split(select, np.cumsum([2 * n, 2 * n, drive.shape[1]]))
        self.problem = LmiProblem()
        self.unknown = self.problem.symmetric(loop.graph.nodes, 2 * n)
        self.last = self.problem.number()
        self.source, self.target, self.leave, self.enter = edge_indices(loop.graph)
        self._square, self._rate = square, rate

    def edges(self, cross: Array | float) -> Blocks:
        """The edges' inequalities: I for y, g^2 I for w, and what has no unknowns beside the diagonal.

        Parameters
        ----------
        cross
            Edges x rows x rows; its transpose is added.
        """
        cross = cross + np.zeros((len(self.source), *np.shape(self.ahead.T @ self.ahead)))
        constant = cross + np.swapaxes(cross, 1, 2) + self.seen.T @ self.seen
        constant = constant + (self._square or 0.0) * self.noise.T @ self.noise
        return self.problem.blocks(len(self.source), len(self.ahead.T), constant)

    def bound(self, large: float | None, *unknowns: MatrixVariable) -> None:
        """Keep the norms of unknown matrices below a number, if one is given."""
        if large is None:
            return
        for unknown in unknowns:
            select = np.eye(unknown.rows + unknown.columns)
            blocks = self.problem.blocks(unknown.count, len(select), large * select)
            blocks.product(unknown, np.arange(unknown.count), select[: unknown.rows], select[unknown.rows :])

    def close(self, edges: Blocks, falls: Indices, rises: Indices) -> None:
        """Add positive matrices, jumps that do not increase the function, and the last unknown."""
        add_jump_inequalities(self.problem, self.unknown, falls, rises)
        if self._square is None and self._rate is None:
            edges.scalar(self.last, self.noise.T @ self.noise)
            return
        for blocks in self.problem.every:
            blocks.scalar(self.last, -np.eye(blocks.size))
        if self._rate is not None:
            total = float(self.unknown.count * self.unknown.size)
            self.problem.blocks(1, 1, total).trace(self.unknown, -1.0)


def _disturbed(mode: Mapping[str, Array], size: int) -> tuple[Array, Array, Array, Array, Array]:
    """E, N, C, D and F of a mode, empty where it has none."""
    drive, out = mode.get("E", np.zeros((size, 0))), mode.get("C", np.zeros((0, size)))
    noise = mode.get("N", np.zeros((len(mode["M"]), drive.shape[1])))
    turned = mode.get("D", np.zeros((len(out), mode["B"].shape[1])))
    return drive, noise, out, turned, mode.get("F", np.zeros((len(out), drive.shape[1])))
