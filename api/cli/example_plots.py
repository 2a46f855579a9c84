"""Pictures of the examples: Figs. 5.1, 5.3, 5.4 and 6.2, 6.3 from our own computations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from theory.paths.closed_loop import Trajectory
    from theory.paths.experiments import OneStepExperiment
    from theory.tubes.experiments import Experiment

MODES = {0: "#2471a3", 1: "#d68910", 2: "#b7950b", 3: "#1e8449"}
_NAMES = {0: "preparation", 1: "mode 1", 2: "mode 2", 3: "mode 3"}
_GREY, _RED, _BLUE = "#566573", "#c0392b", "#2471a3"

DIRECTIONS = 120
"""Rays along which the edge of the region of attraction is drawn."""


def plot_dmd(found: Experiment, path: Path) -> None:
    """Draw a closed loop of Algorithm 1: sets of models and of states where they can be drawn, and series."""
    from matplotlib.figure import Figure

    flat = found.example.model.states == 2
    rows = found.example.model.states if found.prepared.models.centre.joined.shape[1] == 3 else 0
    figure = Figure(figsize=(12, 9 if flat else 5), layout="constrained")
    parts = figure.subfigures(2 if flat else 1, 1, height_ratios=[1.2, 1] if flat else None, squeeze=False)[:, 0]
    if flat:
        draw_sets(parts[0].add_subplot(1, 1 + rows, 1), found)
        for r in range(rows):
            draw_models(parts[0].add_subplot(1, 1 + rows, 2 + r, projection="3d"), found, r)
    draw_series(parts[-1].subplots(1, 2), found)
    figure.savefig(path, dpi=120)


def draw_models(axes: Any, found: Experiment, row: int) -> None:
    """Fig. 5.1: the set of a row of [A B], its centre, and the true row."""
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection
    from scipy.spatial import ConvexHull

    corners = found.prepared.models.corners[row]
    faces = [corners[simplex] for simplex in ConvexHull(corners).simplices]
    axes.add_collection3d(Poly3DCollection(faces, alpha=0.25, facecolor=_BLUE, edgecolor="#85929e", linewidths=0.4))
    centre, true = found.prepared.models.centre.joined[row], found.example.model.joined[row]
    axes.scatter(*centre, color=_GREY, s=18, label="centre")
    axes.scatter(*true, color=_RED, s=18, marker="x", label="true")
    for i, bound in enumerate(("set_xlim", "set_ylim", "set_zlim")):
        getattr(axes, bound)(corners[:, i].min(), corners[:, i].max())
    axes.set_xlabel(f"$a_{{{row + 1}1}}$")
    axes.set_ylabel(f"$a_{{{row + 1}2}}$")
    axes.set_zlabel(f"$b_{{{row + 1}}}$")
    axes.tick_params(labelsize=7)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    axes.set_title(f"models allowed: row {row + 1} of [A B]", fontsize=10)


def draw_sets(axes: Any, found: Experiment) -> None:
    """Fig. 5.3: region of attraction, invariant set, and the trajectory by mode."""
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    edge = rays * np.array([found.controller.central.reach(ray, 1e-3) for ray in rays])[:, None]
    corners = found.controller.tube.shape.corners
    corners = corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))]
    axes.fill(*edge.T, color=_BLUE, alpha=0.12, label="region of attraction")
    axes.fill(*corners.T, color=MODES[3], alpha=0.25, label="invariant set")
    states, modes = _whole(found)
    for i, mode in enumerate(modes):
        label = _NAMES[mode] if mode not in modes[:i] else None
        axes.plot(*states[i : i + 2].T, "o-", color=MODES[mode], markersize=3, linewidth=1.2, label=label)
    axes.set_xlabel("$x_1$")
    axes.set_ylabel("$x_2$")
    axes.legend(fontsize=8, frameon=False, loc="upper left")
    axes.set_title("states", fontsize=10)


def draw_series(axes: Sequence[Any], found: Experiment) -> None:
    """Fig. 5.4: states and inputs over time, with the limits."""
    states, modes = _whole(found)
    inputs = np.vstack([found.prepared.inputs, found.run.inputs])
    limits = found.example.settings.limits
    for axis, values, rows, name in ((axes[0], states, limits.F, "x"), (axes[1], inputs, limits.G, "u")):
        for i, column in enumerate(values.T):
            axis.plot(column, "o-", markersize=3, linewidth=1, label=f"${name}_{i + 1}$")
            for bound in rows[:, i][rows[:, i] != 0]:
                axis.axhline(1 / bound, color=f"C{i}", linestyle="--", linewidth=0.8)
        axis.set_xlabel("sample")
        axis.set_ylabel("state" if name == "x" else "input")
        axis.legend(fontsize=8, frameon=False, loc="upper right")
        for i, mode in enumerate(modes):
            axis.axvspan(i - 0.5, i + 0.5, color=MODES[mode], alpha=0.08, linewidth=0)
    axes[0].set_title("states (dashed: limits; background: mode)", fontsize=10)
    axes[1].set_title("inputs", fontsize=10)


def _whole(found: Experiment) -> tuple[Any, list[int]]:
    """States from the start of the preparation on, and the mode of every sample, 0 in the preparation."""
    states = np.vstack([found.prepared.states[:-1], found.run.states])
    return states, [0] * found.prepared.steps + found.run.modes


def plot_paths(found: Trajectory, studies: Sequence[OneStepExperiment], path: Path) -> None:
    """Draw a path among obstacles, its inputs, and the studies of one step."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 10 if studies else 5.5), layout="constrained")
    parts = figure.subfigures(2 if studies else 1, 1, height_ratios=[1.3, 1] if studies else None, squeeze=False)[:, 0]
    left, right = parts[0].subplots(1, 2)
    draw_path(left, found)
    draw_inputs(right, found)
    if studies:
        draw_one_step(parts[1].subplots(1, len(studies), squeeze=False)[0], studies)
    figure.savefig(path, dpi=120)


def draw_path(axes: Any, found: Trajectory) -> None:
    """Fig. 6.2 (a): map, obstacles with their safe distance, samples of the path."""
    mission, places = found.mission, found.positions
    _boxes(axes, mission.grown, {"facecolor": "none", "linestyle": "--"})
    _boxes(axes, mission.obstacles, {"facecolor": "#d5d8dc"})
    kept = np.array([True, *found.kept])
    axes.plot(*places.T, color=_BLUE, linewidth=0.8)
    axes.plot(*places[kept].T, "o", color=_BLUE, markersize=4, label="sample")
    if not kept.all():
        axes.plot(*places[~kept].T, "o", color=_RED, markersize=5, label="too near or past a limit")
    soft = np.array([step.softened for step in found.steps])
    if soft.any():
        axes.plot(*places[:-1][soft].T, "s", color=MODES[1], markersize=8, fillstyle="none", label="softened decision")
    axes.plot(*np.asarray(mission.goal)[:2], "*", color=MODES[3], markersize=12, label="goal")
    axes.set_xlim(mission.room.low[0, 0] - 5, mission.room.high[0, 0] + 5)
    axes.set_ylim(mission.room.low[0, 1] - 5, mission.room.high[0, 1] + 5)
    axes.set_aspect("equal")
    axes.set_xlabel("$x^{(1)}$")
    axes.set_ylabel("$x^{(2)}$")
    axes.legend(fontsize=8, frameon=False, loc="lower right")
    axes.set_title(f"path, S = {mission.scenarios}", fontsize=10)


def draw_inputs(axes: Any, found: Trajectory) -> None:
    """Fig. 6.2 (b): the inputs."""
    for i, column in enumerate(np.array([step.input for step in found.steps]).T):
        axes.step(range(len(column)), column, where="post", label=f"$u^{{({i + 1})}}$")
    for bound in (found.mission.input_limits.low[0, 0], found.mission.input_limits.high[0, 0]):
        axes.axhline(bound, color=_GREY, linestyle="--", linewidth=0.8)
    axes.set_xlabel("sample")
    axes.set_ylabel("input")
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    axes.set_title("inputs (dashed: limits)", fontsize=10)


def draw_one_step(row: Sequence[Any], studies: Sequence[OneStepExperiment]) -> None:
    """Fig. 6.3: one next state a decision, at the safe distance of the first obstacle."""
    low = min(study.following[:, 0].min() for study in studies) - 0.1
    high = max(study.following[:, 0].max() for study in studies) + 0.1
    for axes, study in zip(row, studies, strict=True):
        kept = study.kept.astype(bool)
        axes.plot(*study.following[kept, :2].T, ".", color=_BLUE, markersize=3)
        axes.plot(*study.following[~kept, :2].T, ".", color=_RED, markersize=4)
        axes.axvline(95, color=_GREY, linestyle="--", linewidth=0.8)
        axes.set_xlim(low, high)
        axes.set_xlabel("$x^{(1)}$")
        axes.set_title(
            f"S = {study.scenarios}: {100 * study.mean:.1f} ± {100 * study.error:.1f} % kept, "
            f"expected {100 * study.expected:.1f} %", fontsize=9,
        )  # fmt: skip
    row[0].set_ylabel("$x^{(2)}$")


def _boxes(axes: Any, boxes: Any, style: dict[str, Any]) -> None:
    from matplotlib.patches import Rectangle

    for low, high in zip(boxes.low, boxes.high, strict=True):
        axes.add_patch(Rectangle(low, *(high - low), linewidth=0.8, edgecolor=_GREY, **style))
