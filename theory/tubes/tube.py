"""Polytopic tubes around all trajectories of a set of models: invariant sets, Propositions 5.1 to 5.3, Lemma 5.2."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from theory.arrays import Array
from theory.errors import EmptySetError, IllPosedError, InfeasibleError, SolverError, TooLargeError, UnboundedError
from theory.tubes.models import ModelSet
from theory.tubes.polytope import TOLERANCE, NormalizedPolytope, extreme
from theory.validation import check_integer, check_noise, finite_array

ITERATIONS_MAX = 300

FACES_MAX = 400
"""A tube has as many unknowns a step, and some tens of corners a face; with 400 a plan takes a second."""

_STEPS_MAX = 2000
_GROWTH_MAX = 1e6
_SETTLED = 1e-13


@dataclass(frozen=True)
class Limits:
    """F x + G u <= 1 (Eq. (5.2)): F is n_c x n_x, G is n_c x n_u."""

    F: Array
    G: Array

    def __post_init__(self) -> None:
        f, g = finite_array("F", self.F, (None, None)), finite_array("G", self.G, (None, None))
        if len(f) != len(g):
            raise IllPosedError("F, G", f"must have a row a limit each, given {len(f)} and {len(g)} rows")
        if not len(f):
            raise UnboundedError("F, G", "no limit given: limit every direction of the state")
        object.__setattr__(self, "F", f)
        object.__setattr__(self, "G", g)

    @classmethod
    def symmetric(cls, states: dict[int, float], inputs: dict[int, float], n_x: int, n_u: int) -> Limits:
        """|x_i| <= states[i] and |u_i| <= inputs[i], for the entries named (counted from 0)."""
        for name, given, count in (("states", states, n_x), ("inputs", inputs, n_u)):
            for i in given:
                check_integer(name, i, 0, count - 1)
        entries = [*states.items(), *((n_x + i, bound) for i, bound in inputs.items())]
        rows = np.zeros((2 * len(entries), n_x + n_u))
        for number, (entry, bound) in enumerate(entries):
            if not 0 < bound < np.inf:
                raise IllPosedError("limits", f"every bound must be finite and above 0, given {bound}")
            rows[2 * number : 2 * number + 2, entry] = 1 / bound, -1 / bound
        return cls(rows[:, :n_x], rows[:, n_x:])

    def check(self, states: int, inputs: int) -> None:
        """Raise `IllPosedError` unless they are limits of that many states and inputs."""
        if self.F.shape[1] != states or self.G.shape[1] != inputs:
            raise IllPosedError(
                "F, G", f"must have {states} and {inputs} columns, given {self.F.shape[1]} and {self.G.shape[1]}"
            )

    def under(self, gain: Array) -> Array:
        """Rows of the limits on x when u = K x.

        Parameters
        ----------
        gain
            K, n_u x n_x.

        Returns
        -------
        Array
            F + G K, n_c x n_x.
        """
        return np.asarray(self.F + self.G @ gain)

    def kept(self, state: Array, action: Array, slack: float = 1e-7) -> bool:
        """Whether a state and an input keep them.

        Parameters
        ----------
        state, action
            x, u: n_x, n_u.
        slack
            By how much a limit, scaled to 1, may be exceeded.
        """
        return bool((self.F @ state + self.G @ action <= 1 + slack).all())


def contractive_set(
    models: ModelSet, gain: Array, limits: Limits, noise: float, contraction: float
) -> NormalizedPolytope:
    """The largest set {x : V x <= 1} that keeps the limits under u = K x and shrinks by `contraction` in a step.

    V x <= 1 implies V x+ <= contraction for x+ = (A + B K) x + w, every model of the set and every |w|_inf <= noise:
    the iteration of Sec. 5.4.2 with the additive term w_max |V_l|_1, without which it is not invariant.

    Parameters
    ----------
    models
        The set of models.
    gain
        K, n_u x n_x.
    limits
        F x + G u <= 1.
    noise
        Bound of every entry of w.
    contraction
        lambda, above 0 and at most 1.

    Raises
    ------
    EmptySetError
        The noise or the set of models is too large for this contraction.
    UnboundedError
        The limits never bound a direction of the state.
    """
    if not 0 < contraction <= 1:
        raise IllPosedError("contraction", f"must lie above 0 and be at most 1, given {contraction}")
    check_noise(noise)
    rows = limits.under(finite_array("gain", gain, (models.inputs, models.states)))
    rows = rows[np.abs(rows).max(axis=1) > 0]
    if not len(rows):
        raise UnboundedError("F, G", "no limit bears on the state under this gain: limit every direction of it")
    pending, found = rows, None
    for _ in range(ITERATIONS_MAX):
        steps = _backward(models, gain, pending, noise, contraction)
        try:
            found = NormalizedPolytope(rows)
        except UnboundedError:
            if len(rows) > 50 * models.states * len(limits.F):
                raise
            pending, rows = steps, np.vstack([rows, steps])
            continue
        fresh = steps[found.support(steps) > 1 + TOLERANCE]
        if not len(fresh):
            return found
        rows = NormalizedPolytope(np.vstack([found.rows, fresh])).rows
        if len(rows) > FACES_MAX:
            raise TooLargeError("faces of the invariant set", len(rows), FACES_MAX)
        pending = fresh[(fresh[:, None] == rows[None]).all(axis=2).any(axis=1)]
    raise SolverError(
        f"not closed after {ITERATIONS_MAX} iterations", "the contractive set: raise `contraction`, or a faster gain"
    )


def _backward(models: ModelSet, gain: Array, rows: Array, noise: float, contraction: float) -> Array:
    """Rows that hold before a step if `rows` are to hold, contracted, after it."""
    found = []
    for row in rows:
        room = contraction - noise * np.abs(row).sum()
        if room <= TOLERANCE:
            raise EmptySetError(
                "noise",
                f"its part {noise * np.abs(row).sum():.3g} of a limit leaves nothing of the contraction {contraction}: "
                "there is no invariant set; lower the noise, raise the contraction, or learn the model better",
            )
        image = models.image(row)
        found.append(extreme(image[:, : models.states] + image[:, models.states :] @ gain) / room)
    return np.vstack(found)


@dataclass(frozen=True)
class Tube:
    """Cross-sections {x : V x <= gamma_i} that contain every trajectory under u = K x + c (Propositions 5.1 and 5.2).

    Row l has J models that matter (corners of `ModelSet.image`), padded by copies to the same J.
    """

    shape: NormalizedPolytope
    models: ModelSet
    gain: Array  # n_u x n_x
    limits: Limits
    noise: float

    @cached_property
    def images(self) -> Array:
        """n_v x J x (n_x + n_u): V_l [A B] at the corners."""
        parts = [self.models.image(row) for row in self.shape.rows]
        tall = max(len(part) for part in parts)
        return np.array([np.vstack([part, np.repeat(part[:1], tall - len(part), axis=0)]) for part in parts])

    @cached_property
    def steps(self) -> Array:
        """H of (5.13a), n_v x J x n_v: H V = V_l (A + B K)."""
        width = self.models.states
        targets = self.images[..., :width] + self.images[..., width:] @ self.gain
        flat = self.shape.multipliers(targets.reshape(-1, width))
        return flat.reshape(*targets.shape[:2], -1)

    @cached_property
    def pushes(self) -> Array:
        """V_l B, n_v x J x n_u: how c moves the tube in (5.13b)."""
        return self.images[..., self.models.states :]

    @cached_property
    def disturbance_support(self) -> Array:
        """w_max |V_l|_1, n_v: the support of the disturbance in each direction V_l, missing in (5.13b) as printed."""
        return self.noise * np.abs(self.shape.rows).sum(axis=1)

    @cached_property
    def limiting(self) -> Array:
        """H_c of (5.16a), n_c x n_v: H_c V = F + G K."""
        return self.shape.multipliers(self.limits.under(self.gain))

    def prepare(self) -> None:
        """Compute all of the above now rather than at their first use."""
        _ = self.steps, self.pushes, self.disturbance_support, self.limiting

    def with_gain(self, gain: Array) -> Tube:
        """The same cross-sections under another gain.

        Parameters
        ----------
        gain
            K, n_u x n_x.
        """
        made = Tube(self.shape, self.models, gain, self.limits, self.noise)
        made.__dict__["images"] = self.images
        return made

    def next_level(self, level: Array, perturbation: Array) -> tuple[Array, Array]:
        """The least gamma_{i+1} that (5.13b) allows, and which corner decides in each row.

        Parameters
        ----------
        level
            gamma_i, n_v.
        perturbation
            c_i of u = K x + c_i, n_u.

        Returns
        -------
        tuple
            gamma_{i+1}, n_v, and for each row the place of its corner, of J, in `images`.
        """
        values = self.steps @ level + self.pushes @ perturbation
        worst = values.argmax(axis=1)
        return values[np.arange(len(worst)), worst] + self.disturbance_support, worst

    @cached_property
    def contraction(self) -> float:
        """The factor lambda by which {x : V x <= 1} shrinks in a step without c, the noise included."""
        width = self.models.states
        targets = self.images[..., :width] + self.images[..., width:] @ self.gain
        return float((self.shape.support(targets).max(axis=1) + self.disturbance_support).max())

    def settle(self, level: Array) -> tuple[Array, Array, Array]:
        """The least gamma >= level that (5.21a) allows, gamma >= H gamma + w for every corner.

        Parameters
        ----------
        level
            n_v.

        Returns
        -------
        tuple
            gamma, n_v, and T, n_v x n_v, and t, n_v, with gamma = T level + t while the same rows decide.

        Raises
        ------
        InfeasibleError
            The levels grow without end under this gain.

        Notes
        -----
        Value iteration, hastened by the fixed point of the rows that decide (policy iteration): neither ever exceeds
        the least solution. Since H >= 0, other rows give less: T level + t is convex in the level.
        """
        value, still, every = np.asarray(level, float), np.zeros(self.models.inputs), np.arange(len(level))
        for _ in range(_STEPS_MAX):
            stepped, worst = self.next_level(value, still)
            grown = np.maximum(level, stepped)
            if grown.max() > _GROWTH_MAX * (1 + np.abs(level).max()):
                break
            stays = level >= stepped - 10 * _SETTLED * (1 + np.abs(stepped))
            chosen = np.where(stays[:, None], 0.0, self.steps[every, worst])
            try:
                inverse = np.linalg.inv(np.eye(len(every)) - chosen)
            except np.linalg.LinAlgError:  # some row would take over itself in full
                value = grown
                continue
            constant = inverse @ np.where(stays, 0.0, self.disturbance_support)
            if np.abs(grown - value).max() <= _SETTLED * (1 + np.abs(value).max()):
                return grown, np.asarray(inverse * stays, float), np.asarray(constant, float)
            fixed = inverse * stays @ level + constant
            value = np.maximum(grown, fixed) if inverse.min() > -_SETTLED else grown
        raise InfeasibleError("infeasible", "terminal section: it grows without end under this gain")
