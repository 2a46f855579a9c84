"""Figures 3.3, 3.4 and 4.3-4.6, drawn from our own computations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from theory import ArbitrarySwitching, Asynchronous, DoubleClock, EllipsoidalTube, PersistentDwellTime, Representation
from theory.arrays import Array
from theory.switching import baselines, reach, stability, synthesis
from theory.switching.examples import example
from theory.switching.synthesis import Design
from theory.switching.system import SwitchedSystem, mode_of

_COLORS = ("#2471a3", "#c0392b", "#1e8449", "#d68910", "#7d3c98", "#566573")
_ARBITRARY = PersistentDwellTime(1, 1, modes=2)
_START = np.array([-10.0, 1.8])
_STEPS = 25


def figure_3_3(folder: Path) -> dict[str, str]:
    """The l2 gain over dwell time and delay, and the size of the problems."""
    system = example("example_3_1")
    figure, axes = _panels(1, 3, (11, 3.4))
    for delay in (0, 1, 2):
        taus = range(delay + 1, 11)
        printed, ours, unknowns, sizes = [], [], [], []
        for tau in taus:
            language = Asynchronous(tau, delay, modes=2)
            graph = language.words(1).graph()
            printed.append(
                synthesis.minimize_gain(
                    system, language, symmetric=True, representation=Representation("words", 1)
                ).bound
            )
            ours.append(
                synthesis.minimize_gain(system, language, representation=Representation(lift=1)).certificate.value
            )
            unknowns.append(3 * graph.nodes)  # Table 3.2, statement (b)
            sizes.append(2 * graph.inequalities)
        axes[0].plot(taus, printed, "o-", color=_COLORS[delay], label=f"delay {delay}, symmetric X, W = 1")
        axes[0].plot(taus, ours, "x:", color=_COLORS[delay], label=f"delay {delay}, our certificate")
        axes[1].plot(taus, unknowns, "o-", color=_COLORS[delay], label=f"delay {delay}")
        axes[2].plot(taus, sizes, "o-", color=_COLORS[delay], label=f"delay {delay}")
    for axis, label in zip(axes, ("l2 gain", "unknowns", "rows of the inequalities"), strict=True):
        axis.set_xlabel("dwell time tau [samples]")
        axis.set_ylabel(label)
        axis.legend(fontsize=7, frameon=False)
    axes[0].set_ylim(1.5, 8)
    return _saved(figure, folder, "theory-3-3", "Fig. 3.3: the l2 gain of Example 3.1 falls with the dwell time and "
                  "grows with the delay; numbers of unknowns and rows after Table 3.2")  # fmt: skip


def figure_3_4(folder: Path) -> dict[str, str]:
    """Example 3.2: synchronous switching against the rivals, and asynchronous switching."""
    system, taus = example("example_3_2"), range(1, 9)
    figure, axes = _panels(1, 3, (11, 3.4))
    mode, common = baselines.mode_dependent_gain(system), baselines.mode_dependent_gain(system, common=True)
    axes[0].axhline(common.bound, color=_COLORS[5], ls="--", label="one gain")
    axes[0].axhline(mode.bound, color=_COLORS[3], ls="--", label="a gain a mode")
    alphas, mus = [0.8, 0.9, 0.95, 0.98, 0.99, 0.994, 0.997], [1.0001, 1.001, 1.01, 1.03, 1.1]
    tuned = [baselines.quasi_time_dependent_gain(system, tau, alphas, mus).value for tau in taus]
    axes[0].plot(taus, tuned, "s-", color=_COLORS[1], label="quasi-time-dependent, tuned")
    for delay, axis in enumerate(axes):
        own = [tau for tau in taus if tau > delay]
        for lift, mark in ((1, "o-"), (2, "x:")):
            if lift == 2 and delay == 2:
                own = own[:4]  # beyond, some thousand inequalities a point
            values = [
                synthesis.minimize_gain(
                    system, Asynchronous(tau, delay, modes=2), representation=Representation("words", lift)
                ).bound
                for tau in own
            ]
            axis.plot(own, values, mark, color=_COLORS[0], label=f"Theorem 3.3, W = {lift}")
        axis.set_title(f"delay {delay}", fontsize=9, loc="left")
        axis.set_xlabel("dwell time tau [samples]")
        axis.set_ylabel("l2 gain")
        axis.legend(fontsize=7, frameon=False, loc=(0.42, 0.42) if delay == 0 else "upper right")
    return _saved(figure, folder, "theory-3-4", "Fig. 3.4: Example 3.2 as printed, against the rivals whose "
                  "inequalities are public")  # fmt: skip


def figure_4_3(folder: Path) -> dict[str, str]:
    """Example 4.3: a hundred random signals, and the Lyapunov function along one."""
    system = example("example_4_3")
    representation = Representation("words", 2)
    graph = representation.graph(_ARBITRARY)
    matrices = stability.certify(system, _ARBITRARY, representation=representation).matrices
    figure, axes = _panels(1, 3, (11, 3.4))
    for seed in range(100):
        word = _ARBITRARY.random(300, seed)
        states = _run(system, word, np.array([1.0, 1.0]))
        axes[0].plot(states[:, 0], lw=0.4, color=_COLORS[0], alpha=0.4)
        axes[1].plot(states[:, 1], lw=0.4, color=_COLORS[1], alpha=0.4)
    word = _ARBITRARY.random(300, 0)
    states = _run(system, word, np.array([1.0, 1.0]))
    nodes = _path(graph, word)
    values = [float(np.sqrt(x @ matrices[node] @ x)) for x, node in zip(states, nodes, strict=False)]
    axes[2].plot(values, color=_COLORS[2])
    for axis, label in zip(axes, ("z_1", "z_2", "V(z) of (4.18)"), strict=True):
        axis.set_xlabel("k [samples]")
        axis.set_ylabel(label)
    return _saved(figure, folder, "theory-4-3", "Fig. 4.3: Example 4.3 under 100 random signals, and the certified "
                  "Lyapunov function along one")  # fmt: skip


def figure_4_4(folder: Path) -> dict[str, str]:
    """Example 4.4: ellipsoids, balls and states reached, for a rival, the theorem as printed, and ours."""
    system, language = example("example_4_4"), _ARBITRARY.clocked(1)
    printed = Representation("words", 1, share_matrices=True)
    designs = {
        "mode-dependent rival": (baselines.mode_dependent_ball(system), ArbitrarySwitching(modes=2).clocked(0)),
        "Theorem 4.4 as printed": (
            reach.minimize(system, language, representation=printed, alpha="grid"), language,
        ),
        "automaton, alpha a mode": (reach.minimize(system, language), language),
    }  # fmt: skip
    figure, axes = _panels(1, 3, (11, 3.8))
    for axis, (name, (design, own)) in zip(axes, designs.items(), strict=True):
        tube = EllipsoidalTube.of(design.certificate)
        for node in range(len(tube.shapes)):
            axis.plot(*tube.outline(node).T, color=_COLORS[0], lw=1)
        turn = np.linspace(0, 2 * np.pi, 181)
        radius = design.certificate.value
        axis.plot(radius * np.cos(turn), radius * np.sin(turn), "--", color=_COLORS[1], lw=1)
        for seed in range(50):
            errors = _errors(system, design, own, seed)
            axis.plot(errors[:, 0], errors[:, 1], ".", ms=1.5, color=_COLORS[5])
        axis.set_title(f"{name}: radius {radius:.4f}", fontsize=9, loc="left")
        axis.set_aspect("equal")
        axis.set_xlabel("e_1")
        axis.set_ylabel("e_2")
    return _saved(figure, folder, "theory-4-4", "Fig. 4.4: reachable sets of Example 4.4; ellipsoids of the "
                  "certificate, the certified ball (dashed), states under 50 signals at the peak")  # fmt: skip


def figure_4_5(folder: Path) -> dict[str, str]:
    """The double-clock controller: ten disturbed runs in the tube around the nominal one."""
    _, controller, tube = _double_clock()
    signal = [mode_of(letter) for letter in _ARBITRARY.random(_STEPS, 3)]
    figure, axes = _panels(1, 2, (11, 4.2))
    chance = np.random.default_rng(0)
    for _ in range(10):
        real, ideal = controller.simulate(_START, signal, chance.choice([-1.0, 1.0], (_STEPS, 1)))
        axes[0].plot(*real.T, color=_COLORS[5], lw=0.6)
        axes[1].plot(np.linalg.norm(real, axis=1), color=_COLORS[5], lw=0.6)
    for node in range(len(tube.shapes)):
        for z in ideal:
            axes[0].plot(*(z + tube.outline(node)).T, color=_COLORS[0], lw=0.5, alpha=0.5)
    axes[0].plot(*ideal.T, "o-", color=_COLORS[1], ms=3, label="nominal state z")
    axes[1].plot(np.linalg.norm(ideal, axis=1), "o-", color=_COLORS[1], ms=3, label="|z|")
    axes[1].step(range(_STEPS), [0.3 * mode - 1.2 for mode in signal], color=_COLORS[3], where="post", label="mode")
    axes[0].set_xlabel("x_1")
    axes[0].set_ylabel("x_2")
    axes[1].set_xlabel("k [samples]")
    axes[1].set_ylabel("norm")
    for axis in axes:
        axis.legend(fontsize=8, frameon=False)
    return _saved(figure, folder, "theory-4-5", "Fig. 4.5: the double-clock controller on Example 4.4, ten runs with "
                  "disturbances at their peak inside the certified tube")  # fmt: skip


def figure_4_6(folder: Path) -> dict[str, str]:
    """The nominal Lyapunov function along the run of Fig. 4.5, and (4.34) along fifty signals."""
    system, controller, _ = _double_clock()
    language = _ARBITRARY.clocked(1)
    nominal = synthesis.stabilize(system, language)
    error = reach.minimize(system, language)
    graph = language.graph(0)
    figure, axes = _panels(1, 2, (11, 3.4))
    word = language.random(_STEPS, 3)
    _, ideal = controller.simulate(_START, [mode_of(letter) for letter in word], np.zeros((_STEPS, 1)))
    nodes = _path(graph, word)
    values = [float(np.sqrt(z @ nominal.certificate.matrices[u] @ z)) for z, u in zip(ideal, nodes, strict=False)]
    axes[0].semilogy(values, "o-", ms=3, color=_COLORS[2])
    axes[0].set_ylabel("V(z) of (4.18)")
    alpha = [float(item) for item in error.certificate.document["proof"]["alpha"]]
    chance = np.random.default_rng(1)
    for seed in range(50):
        word = language.random(60, seed)
        nodes, e, found = _path(graph, word), np.zeros(2), []
        for letter, here, there in zip(word, nodes, nodes[1:], strict=False):
            w = chance.choice([-1.0, 1.0], 1)
            following = system.loop(letter, error.gains) @ e + system.floats[mode_of(letter) - 1]["E"] @ w
            share = alpha[mode_of(letter) - 1]
            matrices = error.certificate.matrices
            found.append(following @ matrices[there] @ following - share * e @ matrices[here] @ e - (1 - share))
            e = following
        axes[1].plot(found, lw=0.5, color=_COLORS[0])
    axes[1].axhline(0, color=_COLORS[1], lw=1)
    axes[1].set_ylabel("left side of (4.34)")
    for axis in axes:
        axis.set_xlabel("k [samples]")
    return _saved(figure, folder, "theory-4-6", "Fig. 4.6: the nominal Lyapunov function decreases, and (4.34) holds "
                  "along 50 signals")  # fmt: skip


def _double_clock() -> tuple[SwitchedSystem, DoubleClock, EllipsoidalTube]:
    system, language = example("example_4_4"), _ARBITRARY.clocked(1)
    nominal, error = synthesis.stabilize(system, language), reach.minimize(system, language)
    return system, DoubleClock(system, nominal.gains, error.gains, 1, 1), EllipsoidalTube.of(error.certificate)


def _run(system: SwitchedSystem, word: Any, start: Array) -> Array:
    states = [start]
    for label in word:
        states.append(system.floats[label - 1]["A"] @ states[-1])
    return np.array(states)


def _errors(system: SwitchedSystem, design: Design, language: Any, seed: int) -> Array:
    chance = np.random.default_rng(seed)
    states = [np.zeros(2)]
    for letter in language.random(60, seed):
        push = system.floats[mode_of(letter) - 1]["E"][:, 0]
        moved = system.loop(letter, design.gains) @ states[-1]
        sign = (1.0 if moved @ push >= 0 else -1.0) if chance.random() < 0.8 else chance.choice([-1.0, 1.0])
        states.append(moved + sign * push)
    return np.array(states)


def _path(graph: Any, word: Any) -> list[int]:
    """Nodes along which a word is a path of a graph, jumps taken where the next letter needs them."""
    leaving: dict[int, list[Any]] = {}
    for u, label, v in graph.edges:
        leaving.setdefault(u, []).append((label, v))
    silent: dict[int, list[int]] = {}
    for u, v in graph.jumps:
        silent.setdefault(u, []).append(v)
    fronts: list[dict[int, tuple[int, int] | None]] = [dict.fromkeys(range(graph.nodes))]
    for label in word:
        front: dict[int, tuple[int, int] | None] = {}
        for node in fronts[-1]:
            for stop in (node, *silent.get(node, ())):
                for own, then in leaving.get(stop, ()):
                    if own == label:
                        front.setdefault(then, (node, stop))
        fronts.append(front)
    node = next(iter(fronts[-1]))
    path = [node]
    for front in reversed(fronts[1:]):
        came = front[node]
        if came is None:
            break
        node = came[0]
        path.append(came[1])
    return path[::-1]


def _panels(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, list[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25)
    return figure, axes


def _saved(figure: Any, folder: Path, name: str, caption: str) -> dict[str, str]:
    figure.savefig(folder / f"{name}.png", dpi=110)
    return {f"{name}.png": caption}
