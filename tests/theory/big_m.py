"""The referee of the path search: (6.4) and (6.5) as one mixed-integer program with big constants, solved by SCIP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyscipopt as scip

from theory.boxes import Boxes, free_boxes
from theory.examples import mission
from theory.path_planner import Mission
from theory.scenario_program import ScenarioProgram

BIG = 1000.0


@dataclass(frozen=True)
class Case:
    """A state among obstacles, with samples."""

    state: np.ndarray
    program: ScenarioProgram
    obstacles: Boxes
    free: Boxes


def cases(count: int, horizon: int, obstacles: int, seed: int) -> list[Case]:
    """Vehicles of Sec. 6.4 that drive into a field of random obstacles, safe distances included."""
    rng = np.random.default_rng(seed)
    task: Mission = mission("paths", horizon=horizon)[0]
    found: list[Case] = []
    while len(found) < count:
        state = np.concatenate([rng.uniform(20, 250, 2), rng.uniform(0, 18, 2)])
        ahead = state[:2] + state[2:] * rng.uniform(0, horizon, (obstacles, 1))
        centres = ahead + rng.uniform(-20, 20, (obstacles, 2))
        half = rng.uniform(2, 10, (obstacles, 2))
        boxes = Boxes(centres - half, centres + half)
        if boxes.inside(state[:2]).any():
            continue
        samples = task.system.draw(rng, task.scenarios, horizon)
        program = ScenarioProgram(samples, state, task.goal, task.Q, task.R, task.state_limits, task.input_limits)
        found.append(Case(state, program, boxes, free_boxes(task.room, boxes)))
    return found


def optimum(case: Case) -> float | None:
    """SCIP's optimum, or None where it proves that there is no path."""
    program, obstacles = case.program, case.obstacles
    model = scip.Model()
    model.hideOutput()
    for name, value in (
        ("limits/gap", 0.0),
        ("limits/absgap", 0.0),
        ("numerics/feastol", 1e-9),
        ("limits/time", 300.0),
    ):
        model.setParam(name, value)
    width = program.steps * program.m
    inputs = [model.addVar(lb=-10, ub=10) for _ in range(width)]
    value = model.addVar(lb=None)
    quadratic = scip.quicksum(
        0.5 * program.hessian[i, j] * inputs[i] * inputs[j] for i in range(width) for j in range(width)
    )
    model.addCons(quadratic + scip.quicksum(program.linear[i] * inputs[i] for i in range(width)) <= value)
    model.setObjective(value)

    def coordinate(i: int, s: int, c: int) -> scip.Expr:
        row = program.pushed[i, s, c]
        return program.free[i, s, c] + scip.quicksum(row[k] * inputs[k] for k in range(width) if row[k] != 0)

    for i in range(program.steps):
        for s in range(program.scenarios):
            for c in range(program.n):
                model.addCons(coordinate(i, s, c) <= program.high[c])
                model.addCons(coordinate(i, s, c) >= program.low[c])
        for low, high in zip(obstacles.low, obstacles.high, strict=True):
            off = [model.addVar(vtype="B") for _ in range(4)]
            model.addCons(scip.quicksum(off) <= 3)
            for s in range(program.scenarios):
                for c in range(2):
                    model.addCons(coordinate(i, s, c) <= low[c] + BIG * off[2 * c])
                    model.addCons(coordinate(i, s, c) >= high[c] - BIG * off[2 * c + 1])
    model.optimize()
    status = model.getStatus()
    if status == "infeasible":
        return None
    assert status == "optimal", status
    return float(model.getObjVal()) + program.constant
