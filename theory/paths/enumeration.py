"""Algorithm 2 as printed: every candidate path of Definition 6.1, one program each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from theory.arrays import Array
from theory.errors import IllPosedError, InfeasibleError, TooLargeError
from theory.paths.boxes import Boxes
from theory.paths.scenario_program import ScenarioProgram, Solved


def candidate_paths(
    visible: Sequence[Sequence[int]], steps: int, limit: int = 1_000_000
) -> Iterator[tuple[tuple[int, ...], ...]]:
    """All candidate paths of Definition 6.1: at every step a face of every obstacle, out of those given for it.

    Their number is (n_1 n_2 ... n_O)^N; raises `TooLargeError` beyond the limit. An obstacle without faces is given 0.
    """
    choices = [tuple(faces) or (0,) for faces in visible]
    number = int(np.prod([len(faces) for faces in choices], dtype=object)) ** steps
    if number > limit:
        raise TooLargeError("candidate paths", number, limit)
    here = list(product(*choices))
    return product(here, repeat=steps)


def visible_faces(position: Array, obstacles: Boxes) -> list[list[int]]:
    """The faces of each obstacle whose side a position is on: 2c + 1 below and 2c + 2 above coordinate c (from 0).

    Parameters
    ----------
    position
        (d,).
    obstacles
        O boxes in d coordinates.

    Returns
    -------
    list
        Numbers of faces, ascending, for each obstacle.
    """
    faces = []
    for low, high in zip(obstacles.low, obstacles.high, strict=True):
        below, above = np.flatnonzero(position <= low), np.flatnonzero(position >= high)
        faces.append(sorted([2 * int(c) + 1 for c in below] + [2 * int(c) + 2 for c in above]))
    return faces


def solve_path(program: ScenarioProgram, obstacles: Boxes, path: Sequence[Sequence[int]]) -> Solved:
    """The conditional program (6.5) for one candidate path; raises `InfeasibleError`.

    Parameters
    ----------
    program
        The scenario program.
    obstacles
        O boxes in d coordinates.
    path
        Faces of all obstacles, a row a step: 2c + 1 below and 2c + 2 above coordinate c (from 0), 0 for none.
    """
    if len(path) != program.steps:
        raise IllPosedError("path", f"must name faces for {program.steps} steps, given {len(path)}")
    low, high = np.tile(program.low, (program.steps, 1)), np.tile(program.high, (program.steps, 1))
    for i, faces in enumerate(path):
        if len(faces) != len(obstacles) or not all(0 <= face <= 2 * obstacles.dimension for face in faces):
            raise IllPosedError(
                "path", f"step {i + 1} must name a face from 0 to {2 * obstacles.dimension} an obstacle"
            )
        for o, face in enumerate(faces):
            c, above = divmod(face - 1, 2)
            if face and above:
                low[i, c] = max(low[i, c], obstacles.high[o, c])
            elif face:
                high[i, c] = min(high[i, c], obstacles.low[o, c])
    return program.solve(low, high)


def best_of_paths(
    program: ScenarioProgram, obstacles: Boxes, visible: Sequence[Sequence[int]]
) -> tuple[tuple[tuple[int, ...], ...], Solved]:
    """Lines 6 to 15 of Algorithm 2 as printed: solve every candidate path and keep the cheapest.

    Exponential in steps and obstacles; `search` gives the same optimum where all faces are candidates.

    Raises
    ------
    InfeasibleError
        No path has a solution.
    TooLargeError
        More candidate paths than the limit.
    """
    best: tuple[tuple[tuple[int, ...], ...], Solved] | None = None
    for path in candidate_paths(visible, program.steps):
        try:
            solved = solve_path(program, obstacles, path)
        except InfeasibleError:
            continue
        if best is None or solved.cost < best[1].cost:
            best = path, solved
    if best is None:
        raise InfeasibleError("infeasible", "all candidate paths")
    return best
