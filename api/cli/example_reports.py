"""Reports of the examples of chapters 5 and 6, a line a figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from theory.paths.closed_loop import Trajectory
from theory.paths.experiments import OneStepExperiment, PathChoice
from theory.paths.planner import Step
from theory.tubes.experiments import EdgeExperiment, Experiment
from theory.tubes.trimodal import GUARANTEE

SHOWN = 12
"""Samples of a single run that are printed."""


MISSED = "chance to break a limit or a safe distance in sight next, with the most paths met"


def _line(label: str, *parts: str) -> str:
    return f"{label:<14}{' '.join(parts)}"


def _span(values: Sequence[int]) -> str:
    low, high = min(values), max(values)
    return f"{low}" if low == high else f"{low} to {high}"


def format_dmd(found: Sequence[Experiment]) -> Iterator[str]:
    """Closed loops of Algorithm 1."""
    first = found[0]
    model, settings, prepared = first.example.model, first.example.settings, first.prepared
    excited = len(settings.excitation)
    yield _line("system", f"{model.states} states, {model.inputs} input(s), noise up to {settings.noise:g} an entry")
    yield _line("preparation", f"{prepared.steps} samples: {excited} excited, {prepared.steps - excited} regulated")
    yield _line("models", f"{prepared.models.size} at the corners of the set,",
                f"no entry of A and B uncertain by more than {prepared.models.width:.2g}")  # fmt: skip
    yield _line("tube", f"{len(first.controller.tube.shape.rows)} faces, horizon {settings.horizon} samples;",
                f"the invariant set shrinks by {first.controller.tube.contraction:.4g} a sample")  # fmt: skip
    if len(found) == 1:
        yield ""
        yield from _samples(first)
        yield ""
    entered = [item.entered for item in found if item.entered is not None]
    yield _line("true model", f"in the set in {sum(item.model_in_set for item in found)} of {len(found)} runs")
    yield _line("mode 3", f"from sample {_span(entered)} on," if entered else "never:",
                f"in {len(entered)} of {len(found)} runs")  # fmt: skip
    yield _line("limits", f"{sum(item.limits_broken for item in found)} broken,",
                f"{sum(item.tube_escapes for item in found)} escapes from a tube,",
                f"in {sum(len(item.run.actions) for item in found)} samples")  # fmt: skip
    flags = sorted(number for item in found for number in item.flagged)
    yield _line("unexplained", f"samples {', '.join(map(str, flags[:SHOWN]))}: plant or noise are not as stated"
                if flags else "none: some model of the set explains every sample")  # fmt: skip
    scenarios = [action.scenario for item in found for action in item.run.actions]
    yield _line("scenarios", ", ".join(f"{name} {scenarios.count(name)}" for name in ("S1", "S2", "S3", "S4", "S5")))
    costs = [pair for item in found for pair in item.costs]
    kept = sum(cost <= shifted * (1 + 1e-9) for cost, shifted in costs)
    yield _line(
        "cost", f"at most that of the plan before, shifted to the state reached, in {kept} of {len(costs)} steps"
    )
    yield _line("guaranteed", GUARANTEE)


def _samples(found: Experiment) -> Iterator[str]:
    states, inputs = found.example.model.states, found.example.model.inputs
    names = [f"x{i + 1}" for i in range(states)] + [f"u{i + 1}" for i in range(inputs)]
    yield "sample  mode  scenario        cost  " + " ".join(f"{name:>8}" for name in names)
    for i, action in enumerate(found.run.actions[:SHOWN]):
        cost = "" if action.plan is None else f"{action.plan.cost:.4f}"
        numbers = " ".join(f"{value:8.3f}" for value in (*found.run.states[i], *action.input))
        yield f"{found.prepared.steps + i:>6}  {action.mode:>4}  {action.scenario:<8}  {cost:>10}  {numbers}"


def format_edge(starts: Sequence[EdgeExperiment]) -> Iterator[str]:
    """Starts at the edge of the region of attraction, beside controllers that know the model."""
    solved = [item for item in starts if not item.infeasible]
    yield _line("edge", f"{len(starts)} starts, noise at its corners:", f"{len(starts) - len(solved)} infeasible,",
                f"{sum(item.limits_broken for item in solved)} limits broken")  # fmt: skip
    if not solved:
        return
    excess = 100 * np.array([item.excess for item in solved])
    total = 100 * (sum(item.cost for item in solved) / sum(item.known_cost for item in solved) - 1)
    yield _line("known model", f"total cost {total:+.3f} % of the same tube control that knows the model;",
                f"a start: median {np.median(excess):+.4f} %, worst {excess.max():+.3f} %")  # fmt: skip
    planned = [item for item in solved if not np.isnan(item.rigid_cost)]
    yield _line("rigid tube", f"(2.13) with the known model has a plan from {len(planned)} of them")


def format_paths(found: Sequence[Trajectory]) -> Iterator[str]:
    """Closed loops of Algorithm 2."""
    steps = [step for item in found for step in item.steps]
    if len(found) == 1:
        yield "sample      x1      x2      v1      v2      u1      u2  paths  programs"
        for i, step in enumerate(found[0].steps):
            numbers = " ".join(f"{value:7.2f}" for value in (*step.state, *step.input))
            yield f"{i:>6} {numbers}  {step.paths:5.0f}  {step.nodes:8d}  {_remark(step)}".rstrip()
        yield ""
    if not found[0].path_exists:
        yield _line("no path", "obstacles with their safe distance separate start and goal;",
                    "only a step across them could arrive")  # fmt: skip
    arrived = [len(item.steps) for item in found if item.arrived]
    lost = sum(item.lost for item in found)
    when = f", after {_span(arrived)} samples" if arrived else ""
    gone = f"; {lost} left the map for good" if lost else ""
    yield _line("goal", f"reached in {len(arrived)} of {len(found)} runs{when}{gone}")
    yield _line("softened", f"{sum(step.softened for step in steps)} of {len(steps)} decisions:",
                "no path satisfied all their samples")  # fmt: skip
    near = [kept for item in found for kept, close in zip(item.kept, item.near, strict=True) if close]
    if near:
        share = 100 * float(np.mean(near))
        yield _line("distance", f"kept after {share:.2f} % of {len(near)} decisions with an obstacle in sight")
    yield _line("between", f"{sum(len(item.cuts()) for item in found)} steps cut through an obstacle between samples,",
                f"{sum(len(item.cuts(safe=True)) for item in found)} through its safe distance")  # fmt: skip
    most = max((step for step in steps if step.bounds), key=lambda step: step.paths, default=None)
    for bound in most.bounds if most else ():
        yield _line("guaranteed", f"{MISSED}: {bound.statement}")
    bare = sum(not step.bounds for step in steps)
    yield _line("no guarantee", f"for {bare} of {len(steps)} decisions, which count as kept in these means")


def _remark(step: Step) -> str:
    parts = [f"softened by {step.slack:.3g}"] if step.softened else []
    if step.given_up:
        parts.append(f"gave up {len(step.given_up)} scenarios")
    return ", ".join(parts)


def format_one_step(studies: Sequence[OneStepExperiment]) -> Iterator[str]:
    """Decisions from one state."""
    yield ""
    yield "one step beside an obstacle, 2000 fresh next states a decision:"
    for study in studies:
        low, high = study.spread
        yield (
            f"  S = {study.scenarios:<3} {len(study.satisfaction)} decisions: kept {100 * study.mean:.2f} % "
            f"(standard error {100 * study.error:.2f}; 90 % of the decisions {100 * low:.1f} to {100 * high:.1f}), "
            f"expected {100 * study.expected:.1f} %"
        )


def format_choice(choices: Sequence[PathChoice]) -> Iterator[str]:
    """The choice among more and more paths."""
    yield ""
    yield f"the best of J paths that limit different coordinates, S = {choices[0].scenarios}, shared samples:"
    for item in choices:
        counted, tail = item.bounds
        verdict = "is not exceeded" if item.expected <= item.claimed else "is exceeded"
        yield (
            f"  J = {item.paths:<3} broken {100 * item.violation:.2f} % (standard error {100 * item.error:.2f}; "
            f"computed {100 * item.expected:.2f}); 2/(1+S) = {100 * item.claimed:.1f} % {verdict}; "
            f"bounds: count {100 * counted.value:.1f} %, tail {100 * tail.value:.1f} %"
        )
