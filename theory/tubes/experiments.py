"""Experiments with Algorithm 1 on its examples: many seeds, and the edge of its region of attraction."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from theory.arrays import Array
from theory.errors import InfeasibleError
from theory.tubes.examples import Unknown
from theory.tubes.models import ModelSet
from theory.tubes.mpc import RigidTube
from theory.tubes.trimodal import ClosedLoop, Plant, Prepared, Trimodal, close_loop, prepare, shifted_cost

ESCAPE = 1e-6
"""Smallest excess that counts as leaving a tube, whose limits are scaled to 1."""

INWARD = 1e-6
"""Relative distance of starts from the edge of the region of attraction, inwards."""


@dataclass(frozen=True)
class Experiment:
    """A closed loop with its example, preparation and controller, and the figures of its guarantees."""

    example: Unknown
    prepared: Prepared
    controller: Trimodal
    run: ClosedLoop

    @property
    def model_in_set(self) -> bool:
        """Whether the true model is one that the data allow."""
        return self.prepared.models.contains(self.example.model)

    @property
    def entered(self) -> int | None:
        """The sample, counted from the start of the preparation, from which on mode 3 acts."""
        return self.prepared.steps + self.run.modes.index(3) if 3 in self.run.modes else None

    @property
    def limits_broken(self) -> int:
        """Samples after the preparation at which a limit is broken."""
        limits = self.example.settings.limits
        pairs = zip(self.run.states[:-1], self.run.inputs, strict=True)
        return sum(not limits.kept(state, action) for state, action in pairs)

    @property
    def tube_escapes(self) -> int:
        """Planned steps that end outside their tube, and steps of mode 3 that leave the invariant set."""
        rows, found = self.controller.tube.shape.rows, 0
        for action, after in zip(self.run.actions, self.run.states[1:], strict=True):
            level = np.ones(len(rows)) if action.plan is None else action.plan.levels[1]
            found += bool((rows @ after > level + ESCAPE).any())
        return found

    @property
    def flagged(self) -> list[int]:
        """Samples that no model of the set explains, counted from the start of the preparation."""
        return [self.prepared.steps + number for number in self.run.flagged]

    @property
    def costs(self) -> list[tuple[float, float]]:
        """For every plan after a plan: its cost, and that of its predecessor, shifted, from the state reached."""
        actions, states = self.run.actions, self.run.states
        return [
            (after.plan.cost, shifted_cost(before, states[i + 1]))
            for i, (before, after) in enumerate(pairwise(actions))
            if before.plan is not None and after.plan is not None
        ]


def run_experiment(example: Unknown, seed: int, steps: int = 40, *, corners: bool = False) -> Experiment:
    """Prepare and close the loop for some samples, with noise from its box or from its corners.

    Parameters
    ----------
    example
        The unknown system and the controller's settings.
    seed
        Of the noise.
    steps
        Samples of the closed loop after the preparation.
    corners
        Whether the noise is drawn from the corners of its box.
    """
    plant = example.plant(seed, corners=corners)
    prepared = prepare(plant, example.start, example.settings)
    controller = Trimodal(example.settings, prepared.models, prepared.window)
    start = prepared.states[-1] if example.restart is None else example.restart
    return Experiment(example, prepared, controller, close_loop(plant, controller, start, steps))


@dataclass(frozen=True)
class EdgeExperiment:
    """One start at the edge of the region of attraction, the same noise for all controllers."""

    start: Array
    infeasible: bool
    limits_broken: int
    cost: float
    known_cost: float
    """Cost of the same tube control with the true model as its only one."""
    rigid_cost: float
    """Cost of the rigid tube (2.13) with the true model; NaN where it has no plan."""

    @property
    def excess(self) -> float:
        """Relative to the controller that knows the model."""
        return self.cost / self.known_cost - 1


def run_edge_experiments(
    found: Experiment,
    starts: int = 60,
    steps: int = 60,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> list[EdgeExperiment]:
    """Start evenly around the edge, in the plane of the first two states, with noise from the corners of its box.

    Parameters
    ----------
    found
        A closed loop, whose set of models the controllers use.
    starts
        Number of directions, evenly spaced.
    steps
        Samples from each start.
    seed
        Of the noise.
    progress
        Receives the number of starts done and the number of all.
    """
    example, settings = found.example, found.example.settings
    fixed = replace(settings, adaptive=False)
    rigid = RigidTube(
        example.model, settings.limits, settings.noise, settings.Q, settings.R, settings.horizon, settings.contraction
    )  # fmt: skip
    seeds, results = np.random.SeedSequence(seed).spawn(starts), []
    for i in range(starts):
        if progress:
            progress(i, starts)
        direction = np.zeros(example.model.states)
        direction[:2] = np.cos(2 * np.pi * i / starts), np.sin(2 * np.pi * i / starts)
        start = (1 - INWARD) * found.controller.central.reach(direction) * direction
        noise = np.random.default_rng(seeds[i]).choice([-settings.noise, settings.noise], (steps, len(start)))
        known = Trimodal(fixed, ModelSet.exact(example.model), deepcopy(found.prepared.window))
        ours = Trimodal(settings, found.prepared.models, deepcopy(found.prepared.window))
        try:
            closed = close_loop(_replayed(example, noise), ours, start, steps)
        except InfeasibleError:
            results.append(EdgeExperiment(start, True, 0, np.nan, np.nan, np.nan))
            continue
        broken = Experiment(example, found.prepared, ours, closed).limits_broken
        theirs = close_loop(_replayed(example, noise), known, start, steps).cost(settings.Q, settings.R)
        cost, last = closed.cost(settings.Q, settings.R), _rigid(example, rigid, start, noise)
        results.append(EdgeExperiment(start, False, broken, cost, theirs, last))
    return results


def _replayed(example: Unknown, noise: Array) -> Plant:
    left = iter(noise)
    return lambda state, action: example.model.after(state, action) + next(left)


def _rigid(example: Unknown, controller: RigidTube, start: Array, noise: Array) -> float:
    settings, state, total = example.settings, start, 0.0
    for disturbance in noise:
        try:
            action, _ = controller.decide(state)
        except InfeasibleError:
            return float("nan")
        total += float(state @ settings.Q @ state + action @ settings.R @ action)
        state = example.model.after(state, action) + disturbance
    return total
