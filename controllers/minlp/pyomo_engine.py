"""The MINLP (7.25) written in Pyomo and solved by SCIP: slower than the exact search, and independent of it."""

from __future__ import annotations

import math
from typing import Any

import pyomo.environ as pyo
from pyomo.contrib.solver.common.results import TerminationCondition
from pyomo.contrib.solver.solvers.scip.scip_direct import ScipDirect

from controllers.minlp.quotient import Quotient
from controllers.minlp.solvers import Answer, SolverEngine, SolverError
from controllers.minlp.symbolic import Stage, Tanks, Valves, lesser
from station.control_model import ControlModel, is_thesis
from station.controller import Observation

_BUFFERS = range(3)

SLACK = 1e-3
"""What the bounds on a state leave beyond its reach [g, K, bar], so that none ever binds by rounding."""

OPTIONS = {
    # Deviations to 1e-7 g, K and bar, so that costs agree with the plant's. At 1e-9, SCIP's own epsilon, it called
    # problems infeasible and wrong valves optimal.
    "numerics/feastol": 1e-7,
    "limits/gap": 1e-9,
    "limits/absgap": 1e-9,
}


class _Model:
    """The model for stations with or without a vehicle at the dispenser: two models by Eq. (7.14)."""

    def __init__(self, stage: Stage, stages: int) -> None:
        self.stages = stages
        self.count = 4 if stage.vehicle else 3
        m = self.model = pyo.ConcreteModel()
        m.volume = pyo.Param(mutable=True, within=pyo.Reals, initialize=1.0)
        m.period = pyo.Param(mutable=True, within=pyo.Reals, initialize=1.0)
        m.standing = pyo.Param(mutable=True, within=pyo.Reals, initialize=0.0)
        m.before = pyo.Param(_BUFFERS, mutable=True, within=pyo.Binary, initialize=0)
        self.stage = stage._replace(volume=m.volume, period=m.period, lesser=self._lesser)
        self._add_variables()
        m.chosen, m.other = pyo.VarList(domain=pyo.Binary), pyo.VarList()
        m.size = pyo.Param(pyo.Any, mutable=True, within=pyo.Reals, default=1.0)
        self._bottoms: list[Any] = []
        m.limits = pyo.ConstraintList()
        m.plant = pyo.ConstraintList()
        cost = -m.standing
        inlet_before = tuple(m.before[b] for b in _BUFFERS)
        for index in range(stages):
            cost += self._add_stage(index, inlet_before)
            inlet_before = self.valves(index).inlet
        m.cost = pyo.Objective(expr=cost)

    def _add_variables(self) -> None:
        """Valves, the present state, and how far each later state is from it.

        Written as deviations the products of the plant are small numbers: SCIP, which keeps them to an absolute
        tolerance, called some problems infeasible when mass times temperature stood for itself.
        """
        m, tanks = self.model, range(self.count)
        later = range(1, self.stages + 1)
        m.inlet = pyo.Var(range(self.stages), _BUFFERS, domain=pyo.Binary)
        if self.stage.vehicle:
            m.outlet = pyo.Var(range(self.stages), _BUFFERS, domain=pyo.Binary)
        m.present = pyo.Param(range(3), tanks, mutable=True, within=pyo.Reals, initialize=1.0)
        m.deviation = pyo.Var(range(3), later, tanks, initialize=0.0)

    def _lesser(self, one: Any, other: Any) -> Any:
        """A variable that is the lesser of two expressions: it is one of them, and above neither."""
        m, one, other = self.model, self._without_quotient(one), self._without_quotient(other)
        chosen, least = m.chosen.add(), self._variable()
        m.plant.add(least == chosen * one + (1 - chosen) * other)
        m.plant.add(least <= one)
        m.plant.add(least <= other)
        return least

    def _with_quotients(self, tanks: Tanks) -> Tanks:
        """The tanks for equations with denominators; as they are for the thesis's, which have none."""
        if not isinstance(self.stage.plant, ControlModel) or is_thesis(self.stage.plant):
            return tanks
        return Tanks(*(tuple(Quotient(value) for value in figure) for figure in tanks))

    def _defined(self, value: Any) -> Any:
        """A variable that is an expression; a number as it is."""
        if isinstance(value, int | float):
            return value
        variable = self._variable()
        self._add_equation(variable, value)
        return variable

    def _without_quotient(self, value: Any) -> Any:
        """An expression of SCIP's own; a variable for one with a denominator."""
        if not isinstance(value, Quotient):
            return value
        return value.top if value.plain else self._defined(value)

    def _variable(self) -> Any:
        """A variable of any sign; 0 where the size of an expression is asked for."""
        variable = self.model.other.add()
        variable.set_value(0.0)
        return variable

    def _add_equation(self, variable: Any, value: Any) -> None:
        """`variable == value`, multiplied out and divided by the size of the denominator at the present state.

        SCIP keeps a nonlinear equation to an absolute tolerance: so that is one of the variable.
        """
        m = self.model
        if not isinstance(value, Quotient) or value.plain:
            m.plant.add(variable == (value.top if isinstance(value, Quotient) else value))
            return
        size = m.size[len(self._bottoms)]
        self._bottoms.append(value.bottom)
        m.plant.add(variable * (value.bottom / size) == value.top / size)

    def tanks(self, index: int) -> Tanks:
        """The state before stage `index`."""
        m, tanks = self.model, range(self.count)
        return Tanks(*(
            tuple(m.present[f, k] + m.deviation[f, index, k] if index else m.present[f, k] for k in tanks)
            for f in range(3)
        ))  # fmt: skip

    def valves(self, index: int) -> Valves:
        """The variables of the valves of stage `index`."""
        m = self.model
        outlet = tuple(m.outlet[index, b] for b in _BUFFERS) if self.stage.vehicle else (0, 0, 0)
        return Valves(tuple(m.inlet[index, b] for b in _BUFFERS), outlet)

    def _add_stage(self, index: int, inlet_before: tuple[Any, ...]) -> Any:
        """Add the equations and limits of a stage; return its cost."""
        m, tanks, valves, after = self.model, self.tanks(index), self.valves(index), self.tanks(index + 1)
        before, later = self._with_quotients(tanks), self._with_quotients(after)
        drawn = self.stage.drawn(before, valves)
        if before is not tanks:
            drawn = [self._defined(flow) for flow in drawn]
        follows = (
            *zip(after.mass, self.stage.masses(before, valves, drawn), strict=True),
            *zip(after.temperature, self.stage.temperatures(before, valves, drawn), strict=True),
            *zip(after.pressure, self.stage.pressures(later.mass, later.temperature), strict=True),
        )
        for variable, value in follows:
            self._add_equation(variable, value)
        for margin in self.stage.margins(tanks, valves, inlet_before):
            m.limits.add(margin >= 0)
        return self.stage.cost(valves, after.pressure)

    def set(self, observation: Observation, present: Tanks, standing: float, allowed: int) -> None:
        """Put an observation into the model.

        A valve that a limit forbids now is fixed: the state is known, and no tolerance of the solver may open it.
        """
        m = self.model
        m.period.set_value(observation.period)
        m.standing.set_value(standing)
        if self.stage.vehicle:
            m.volume.set_value(observation.vehicle_volume)
        for figure, values in enumerate(present):
            for tank, value in enumerate(values):
                m.present[figure, tank].set_value(value)
        numbers = self.stage._replace(volume=observation.vehicle_volume, period=observation.period, lesser=lesser)
        for index, state in enumerate(numbers.reach(present, allowed, self.stages)):
            for figure, intervals in enumerate(state):
                for tank, reached in enumerate(intervals):
                    deviation, here = m.deviation[figure, index + 1, tank], present[figure][tank]
                    deviation.setlb(reached.low - here - SLACK)
                    deviation.setub(reached.high - here + SLACK)
        for place, bottom in enumerate(self._bottoms):
            m.size[place].set_value(pyo.value(bottom))
        for b in _BUFFERS:
            m.before[b].set_value(observation.previous >> b & 1)
            m.inlet[0, b].setub(allowed >> b & 1)
            if self.stage.vehicle:
                m.outlet[0, b].setub(allowed >> (3 + b) & 1)

    def commands(self, values: Any) -> list[int]:
        """The sequence of commands in a solution."""
        found = []
        for index in range(self.stages):
            valves = self.valves(index)
            command = sum(round(values[valves.inlet[b]]) << b for b in _BUFFERS)
            if self.stage.vehicle:
                command += sum(round(values[valves.outlet[b]]) << (3 + b) for b in _BUFFERS)
            found.append(command)
        return found


class PyomoEngine(SolverEngine):
    """SCIP through Pyomo: proves its optimum, by a method that shares only the plant with the exact engine."""

    name = "pyomo"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._models: dict[bool, _Model] = {}
        self._solver = ScipDirect()

    def _model(self, vehicle: bool) -> _Model:
        if vehicle not in self._models:
            self._models[vehicle] = _Model(Stage(self.plant, self.objective, vehicle, 0.0, 0.0), self.stages)
        return self._models[vehicle]

    def optimize(self, observation: Observation, present: Tanks, allowed: int) -> Answer:
        """SCIP's answer, with its dual bound; raises SolverError where it has no solution."""
        model = self._model(observation.vehicle >= 0)
        standing = self.stages * float(model.stage.tank_cost(present.pressure))
        model.set(observation, present, standing, allowed)
        results = self._solver.solve(
            model.model, load_solutions=False, raise_exception_on_nonoptimal_result=False,
            solver_options={**OPTIONS, "limits/nodes": self.node_limit},
        )  # fmt: skip
        if results.incumbent_objective is None:
            raise SolverError(f"SCIP has no valves at {observation.time:g} s: {results.termination_condition.name}")
        return Answer(
            commands=model.commands(results.solution_loader.get_vars()),
            cost=float(results.incumbent_objective),
            bound=-math.inf if results.objective_bound is None else float(results.objective_bound),
            proven=results.termination_condition == TerminationCondition.convergenceCriteriaSatisfied,
            seconds=float(results.timing_info.scip_time),
        )
