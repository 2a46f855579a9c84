"""Linear matrix inequalities, many at a time: assembled as arrays, solved by Clarabel.

Trap: Clarabel takes the upper triangle column by column, with sqrt(2) off the diagonal. Inequalities of size 1 and 2 go
to it as linear and second-order cones, which are far cheaper: [[a, b], [b, c]] >= 0 if and only if (a + c, a - c, 2 b)
lies in the second-order cone.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import clarabel
import numpy as np
import numpy.typing as npt
from scipy import sparse

from theory.arrays import Array
from theory.errors import InfeasibleError, SolverError, TooLargeError

ENTRIES_MAX = 30_000_000
"""Nonzero coefficients; estimated before they are made. 30 million take some 1 GB."""

TOLERANCES = (1e-8, 1e-7, 1e-6)
"""Tolerances of the status "Solved", tried in turn: the first may be out of reach where an optimum is approached but
not attained. A certificate is proved exactly afterwards, whatever the tolerance."""

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class SymmetricVariable:
    """`count` unknown symmetric matrices of one size, by their upper triangles."""

    offset: int
    count: int
    size: int

    @property
    def entries(self) -> int:
        """Unknowns of one matrix."""
        return self.size * (self.size + 1) // 2

    def of(self, values: Array) -> Array:
        """The matrices in a solution: count x size x size.

        Parameters
        ----------
        values
            All unknowns of the problem, as in `LmiSolution.values`.

        Returns
        -------
        Array
            count x size x size.
        """
        packed = values[self.offset : self.offset + self.count * self.entries].reshape(self.count, self.entries)
        found = np.zeros((self.count, self.size, self.size))
        rows, columns = np.triu_indices(self.size)
        found[:, rows, columns] = packed
        found[:, columns, rows] = packed
        return found


@dataclass(frozen=True)
class MatrixVariable:
    """`count` unknown matrices without structure."""

    offset: int
    count: int
    rows: int
    columns: int

    @property
    def entries(self) -> int:
        """Unknowns of one matrix."""
        return self.rows * self.columns

    def of(self, values: Array) -> Array:
        """The matrices in a solution: count x rows x columns.

        Parameters
        ----------
        values
            All unknowns of the problem, as in `LmiSolution.values`.

        Returns
        -------
        Array
            count x rows x columns.
        """
        return values[self.offset : self.offset + self.count * self.entries].reshape(
            self.count, self.rows, self.columns
        )


@dataclass(frozen=True)
class LmiSolution:
    """A point with the status "Solved"; any other status raises."""

    values: Array
    objective: float
    iterations: int
    seconds: float


@dataclass
class Blocks:
    """`count` inequalities of one size: constant + the terms of `congruence`, `product`, `scalar` and `trace` >= 0."""

    problem: LmiProblem
    count: int
    size: int
    constant: Array
    terms: list[tuple[Indices, Indices, Array]] = field(default_factory=list)  # block, unknown, coefficient triangle

    def congruence(
        self,
        unknown: SymmetricVariable,
        which: Indices,
        factor: Array,
        weight: float | Array = 1.0,
        into: Indices | None = None,
    ) -> Blocks:
        """Add weight M' X M, with X the `which`-th unknown and M of shape (terms, n, size).

        There is a term a block, or as many as `into` names blocks.

        Parameters
        ----------
        unknown
            The unknown matrices X, n x n.
        which
            Number of the matrix in each term.
        factor
            M, terms x n x size or one for all terms.
        weight
            A number, or one a term.
        into
            Number of the block of each term; by default term k belongs to block k.
        """
        self.problem.check(len(which) * unknown.entries * self.size**2)
        factor = np.broadcast_to(factor, (len(which), unknown.size, self.size))
        first, second = np.triu_indices(unknown.size)
        one, two = factor[:, first, :], factor[:, second, :]
        outer = one[:, :, :, None] * two[:, :, None, :]
        outer = outer + np.swapaxes(outer, 2, 3)
        outer[:, first == second] *= 0.5
        outer *= np.broadcast_to(weight, (len(which),))[:, None, None, None]
        columns = unknown.offset + which[:, None] * unknown.entries + np.arange(unknown.entries)
        return self._add(columns, outer, into)

    def product(self, unknown: MatrixVariable, which: Indices, left: Array, right: Array) -> Blocks:
        """Add L' X R + R' X' L, with L of shape (count, rows, size) and R of shape (count, columns, size).

        Parameters
        ----------
        unknown
            The unknown matrices X, rows x columns.
        which
            Number of the matrix in each block.
        left, right
            L, count x rows x size, and R, count x columns x size, or one for all blocks.
        """
        self.problem.check(self.count * unknown.entries * self.size**2)
        left = np.broadcast_to(left, (self.count, unknown.rows, self.size))
        right = np.broadcast_to(right, (self.count, unknown.columns, self.size))
        outer = left[:, :, None, :, None] * right[:, None, :, None, :]
        outer = (outer + np.swapaxes(outer, 3, 4)).reshape(self.count, unknown.entries, self.size, self.size)
        columns = unknown.offset + which[:, None] * unknown.entries + np.arange(unknown.entries)
        return self._add(columns, outer, None)

    def scalar(self, unknown: int, matrix: Array) -> Blocks:
        """Add x F, with F of shape (size, size) or (count, size, size).

        Parameters
        ----------
        unknown
            Place of x among the unknowns, as `LmiProblem.number` gives it.
        matrix
            F, symmetric: size x size for all inequalities alike, or count x size x size.

        Returns
        -------
        Blocks
            These inequalities.
        """
        matrix = np.broadcast_to(matrix, (self.count, self.size, self.size))
        return self._add(np.full((self.count, 1), unknown), matrix[:, None], None)

    def trace(self, unknown: SymmetricVariable, weight: float) -> Blocks:
        """Add weight times the sum of all traces to a single inequality of size 1."""
        diagonal = np.flatnonzero(np.equal(*np.triu_indices(unknown.size)))
        columns = (unknown.offset + np.arange(unknown.count)[:, None] * unknown.entries + diagonal).reshape(1, -1)
        return self._add(columns, np.full((*columns.shape, 1, 1), weight), None)

    def _add(self, columns: Indices, matrices: Array, into: Indices | None) -> Blocks:
        blocks = np.broadcast_to((np.arange(self.count) if into is None else into)[:, None], columns.shape)
        upper = _triangle(matrices)
        self.terms.append((blocks.ravel(), columns.ravel(), upper.reshape(-1, upper.shape[-1])))
        return self


class LmiProblem:
    """Unknowns, inequalities and a linear objective to be minimised."""

    def __init__(self) -> None:
        self._unknowns = 0
        self._blocks: list[Blocks] = []
        self._entries = 0

    def symmetric(self, count: int, size: int) -> SymmetricVariable:
        """New symmetric unknowns."""
        made = SymmetricVariable(self._unknowns, count, size)
        self._unknowns += count * made.entries
        return made

    def full(self, count: int, rows: int, columns: int) -> MatrixVariable:
        """New unknowns without structure."""
        made = MatrixVariable(self._unknowns, count, rows, columns)
        self._unknowns += count * made.entries
        return made

    def number(self) -> int:
        """A new unknown number; its place among the unknowns."""
        self._unknowns += 1
        return self._unknowns - 1

    def blocks(self, count: int, size: int, constant: Array | float = 0.0) -> Blocks:
        """New inequalities.

        Parameters
        ----------
        count, size
            Number of inequalities, and rows of each.
        constant
            Their part without unknowns, size x size or count x size x size.

        Returns
        -------
        Blocks
            The inequalities, each >= 0, to which terms are added.
        """
        made = Blocks(self, count, size, np.broadcast_to(constant, (count, size, size)).astype(float))
        self._blocks.append(made)
        return made

    @property
    def every(self) -> list[Blocks]:
        """All inequalities so far."""
        return list(self._blocks)

    def check(self, entries: int) -> None:
        """Count coefficients before they are made."""
        self._entries += entries
        if self._entries > ENTRIES_MAX:
            raise TooLargeError("coefficients of the inequalities", self._entries, ENTRIES_MAX)

    def feasible(self, what: str) -> LmiSolution:
        """Some point that satisfies the inequalities, well inside where they are homogeneous."""
        return self.minimize({}, what, refine=False)

    def minimize(self, weights: dict[int, float], what: str, *, refine: bool = True) -> LmiSolution:
        """Solve. Anything but "Solved" raises: `InfeasibleError`, or `SolverError` with the solver's word for it.

        Without `refine` the first try does not refine its linear systems, which takes a fifth of the time off.

        Parameters
        ----------
        weights
            Of the unknown numbers in the objective, by their places.
        what
            The name of the problem in errors.
        refine
            Whether the first try refines its linear systems.
        """
        started = time.perf_counter()
        matrix, right, cones = self._assembled()
        cost = np.zeros(self._unknowns)
        for unknown, weight in weights.items():
            cost[unknown] = weight
        nothing = sparse.csc_matrix((self._unknowns, self._unknowns))
        status = ""
        for tolerance in TOLERANCES:
            settings = clarabel.DefaultSettings()
            settings.verbose = False
            settings.max_iter = 300
            settings.direct_solve_method = "faer"  # half the time of qdldl where successors are many
            settings.max_threads = 1
            settings.iterative_refinement_enable = refine or tolerance != TOLERANCES[0]
            settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
            answer = clarabel.DefaultSolver(nothing, cost, matrix, right, cones, settings).solve()
            status = str(answer.status)
            if status == "PrimalInfeasible":
                raise InfeasibleError(status, what)
            if status == "Solved":
                took = time.perf_counter() - started
                return LmiSolution(np.array(answer.x), float(answer.obj_val), int(answer.iterations), took)
        raise SolverError(status, what)

    def _assembled(self) -> tuple[sparse.csc_matrix, Array, list[object]]:
        rows, columns, values, right, cones = [], [], [], [], []
        height = 0
        for blocks in self._blocks:
            if not blocks.count:
                continue
            tall = blocks.size * (blocks.size + 1) // 2
            turn, cone = _cone(blocks.size, blocks.count)
            cones += cone
            right.append((_triangle(blocks.constant) @ turn).ravel())
            for block, unknown, triangle in blocks.terms:
                part = -(triangle @ turn)
                where, place = np.nonzero(part)
                rows.append(height + block[where] * tall + place)
                columns.append(unknown[where])
                values.append(part[where, place])
            height += blocks.count * tall
        matrix = sparse.coo_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (height, self._unknowns)
        )
        return matrix.tocsc(), np.concatenate(right), cones


def _triangle(matrices: Array) -> Array:
    """Upper triangles column by column, with sqrt(2) off the diagonal: the last two axes become one."""
    columns, rows = np.tril_indices(matrices.shape[-1])
    return matrices[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0))


def _cone(size: int, count: int) -> tuple[Array, list[object]]:
    """The matrix that maps triangles to the coordinates of their cone, and the cones."""
    if size == 1:
        return np.eye(1), [clarabel.NonnegativeConeT(count)]
    if size == 2:
        turn = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)], [1.0, -1.0, 0.0]])
        return turn, [clarabel.SecondOrderConeT(3)] * count
    return np.eye(size * (size + 1) // 2), [clarabel.PSDTriangleConeT(size)] * count
