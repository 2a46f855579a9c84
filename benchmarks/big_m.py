"""The referee of the path search: (6.4) and (6.5) as one mixed-integer program with big constants, solved by SCIP."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyscipopt as scip

from theory.paths.boxes import Boxes, free_boxes
from theory.paths.examples import mission
from theory.paths.mission import Mission
from theory.paths.scenario_program import ScenarioProgram
from theory.paths.stochastic import ScenarioSamples

BIG = 1000.0


@dataclass(frozen=True)
class Case:
    """A state among obstacles (safe distances included), with samples."""

    task: Mission
    state: np.ndarray
    samples: ScenarioSamples
    obstacles: Boxes

    def built(self) -> tuple[ScenarioProgram, Boxes]:
        """The program of the search, and the free boxes; made anew."""
        task = self.task
        program = ScenarioProgram(
            self.samples, self.state, task.goal, task.Q, task.R, task.state_limits, task.input_limits
        )
        return program, free_boxes(task.room, self.obstacles)

    @cached_property
    def program(self) -> ScenarioProgram:
        """The program, made once."""
        return self.built()[0]

    @cached_property
    def free(self) -> Boxes:
        """The free boxes, made once."""
        return self.built()[1]


def cases(count: int, horizon: int, obstacles: int, seed: int) -> list[Case]:
    """Vehicles of Sec. 6.4 that drive into a field of random obstacles."""
    rng = np.random.default_rng(seed)
    task = mission("paths", horizon=horizon)[0]
    found: list[Case] = []
    while len(found) < count:
        state = np.concatenate([rng.uniform(20, 250, 2), rng.uniform(0, 18, 2)])
        ahead = state[:2] + state[2:] * rng.uniform(0, horizon, (obstacles, 1))
        centres = ahead + rng.uniform(-20, 20, (obstacles, 2))
        half = rng.uniform(2, 10, (obstacles, 2))
        boxes = Boxes(centres - half, centres + half)
        if not boxes.inside(state[:2]).any():
            found.append(Case(task, state, task.system.draw(rng, task.scenarios, horizon), boxes))
    return found


def optimum(case: Case) -> float | None:
    """SCIP's optimum, or None where it proves that there is no path."""
    program, obstacles = case.program, case.obstacles
    model = scip.Model()
    model.hideOutput()
    model.setParams({"limits/gap": 0.0, "limits/absgap": 0.0, "numerics/feastol": 1e-9, "limits/time": 300.0})
    width = program.steps * program.m
    inputs = [model.addVar(lb=-10, ub=10) for _ in range(width)]
    cost = model.addVar(lb=None)
    quadratic = scip.quicksum(
        0.5 * program.hessian[i, j] * inputs[i] * inputs[j] for i in range(width) for j in range(width)
    )
    model.addCons(quadratic + scip.quicksum(program.linear[i] * inputs[i] for i in range(width)) <= cost)
    model.setObjective(cost)

    places = _places(program, inputs)
    for i, s, c in np.ndindex(*places.shape):
        model.addCons(places[i, s, c] <= program.high[c])
        model.addCons(places[i, s, c] >= program.low[c])
    for i, o in np.ndindex(program.steps, len(obstacles)):
        off = [model.addVar(vtype="B") for _ in range(4)]
        model.addCons(scip.quicksum(off) <= 3)
        for s, c in np.ndindex(program.scenarios, 2):
            model.addCons(places[i, s, c] <= obstacles.low[o, c] + BIG * off[2 * c])
            model.addCons(places[i, s, c] >= obstacles.high[o, c] - BIG * off[2 * c + 1])
    model.optimize()
    status = model.getStatus()
    if status == "infeasible":
        return None
    if status != "optimal":
        raise RuntimeError(f"the referee ended with {status}")
    return float(model.getObjVal()) + program.constant


def _places(program: ScenarioProgram, inputs: list[Any]) -> Any:
    """Predicted states as expressions in the inputs, N x S x n."""
    places = np.empty(program.free.shape, dtype=object)
    for spot in np.ndindex(*places.shape):
        row = program.pushed[spot]
        places[spot] = program.free[spot] + scip.quicksum(row[k] * inputs[k] for k in np.flatnonzero(row))
    return places
