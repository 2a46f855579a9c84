"""Comparisons for certified reachable sets: their tube, extremal disturbances, and the double-clock controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from theory.arrays import Array
from theory.checker import Label
from theory.errors import IllPosedError
from theory.switching.certificate import Certificate
from theory.switching.language import Language
from theory.switching.periodic import WALKS_MAX
from theory.switching.system import Gains, SwitchedSystem, mode_of


def worst_radius(
    system: SwitchedSystem, word: Sequence[Label], *, gains: Gains | None = None, peak: float = 1.0, repeats: int = 60
) -> float:
    """The largest |e| that an extremal disturbance reaches from 0 along a repeated word: a lower bound of every radius.

    The set reached at a time is a sum of ellipsoids; its farthest point is climbed to from many directions.

    Parameters
    ----------
    system
        With E.
    word
        The letters of one period.
    gains
        For letters with a gain and a clock.
    peak
        Bound of |w(k)|.
    repeats
        Of the word, as far as they make at most 400 samples.
    """
    loop = [(system.loop(label, gains), system.floats[mode_of(label) - 1]["E"]) for label in word]
    best = 0.0
    for end in range(len(word)):
        reach, state = [], np.eye(system.size)
        for step in range(min(repeats * len(word), 400)):
            a, e = loop[(end - step) % len(word)]
            reach.append(state @ e)
            state = state @ a
        best = max(best, peak * _farthest(np.array(reach)))
    return best


def largest_radius_word(
    system: SwitchedSystem, language: Language, *, gains: Gains | None = None, peak: float = 1.0, longest: int = 6
) -> tuple[float, tuple[Label, ...]]:
    """The largest radius that a periodic word up to a length reaches, and that word."""
    words = language.periodic_words(longest, most=WALKS_MAX)
    found = ((worst_radius(system, word, gains=gains, peak=peak), word) for word in words)
    return max(found, key=lambda pair: pair[0], default=(0.0, ()))


def _farthest(parts: Array) -> float:
    """The largest |sum of P_k w_k| over |w_k| <= 1, by ascent from directions all around (or random ones)."""
    size = parts.shape[1]
    if size == 2:
        angles = np.linspace(0, np.pi, 64, endpoint=False)
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        directions = np.random.default_rng(0).normal(size=(64, size))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    best = 0.0
    for direction in directions:
        far = direction
        for _ in range(20):
            pulled = np.einsum("knq,n->kq", parts, far)
            lengths = np.maximum(np.linalg.norm(pulled, axis=1, keepdims=True), 1e-300)
            point = np.einsum("knq,kq->n", parts, pulled / lengths)
            length = float(np.linalg.norm(point))
            if length <= best * (1 + 1e-12) and np.allclose(point / max(length, 1e-300), far, atol=1e-9):
                break
            far = point / max(length, 1e-300)
        best = max(best, length)
    return best


@dataclass(frozen=True)
class EllipsoidalTube:
    """Ellipsoids {e : e' O e <= 1}, one a node, whose union holds the error (4.41)."""

    shapes: Array

    @classmethod
    def of(cls, certificate: Certificate) -> EllipsoidalTube:
        """The tube of a certificate of kind `reach`."""
        if certificate.kind != "reach":
            raise IllPosedError("certificate", f"is of kind {certificate.kind!r}, not 'reach'")
        return cls(certificate.matrices)

    def level(self, points: Array) -> Array:
        """The smallest e' O e over the ellipsoids for points of shape (..., n): at most 1 inside.

        Parameters
        ----------
        points
            (..., n).

        Returns
        -------
        Array
            Without unit.
        """
        return np.einsum("...i,uij,...j->...u", points, self.shapes, points).min(axis=-1)

    def outline(self, node: int, points: int = 121) -> Array:
        """The boundary of an ellipsoid in the plane: points x 2."""
        angles = np.linspace(0, 2 * np.pi, points)
        factor = np.linalg.cholesky(np.linalg.inv(self.shapes[node]))
        return np.stack([np.cos(angles), np.sin(angles)], axis=1) @ factor.T


@dataclass(frozen=True)
class DoubleClock:
    """The controller (4.7)-(4.9): u = F(mode, clock_z) z + K(mode, clock_e) (x - z), for e(0) = 0 (Theorem 4.5).

    It holds for persistent dwell times of at least max(tau_z, tau_e) with the same period.
    """

    system: SwitchedSystem
    nominal: Gains
    error: Gains
    clock_nominal: int
    clock_error: int

    def simulate(self, start: Array, signal: Sequence[int], disturbances: Array) -> tuple[Array, Array]:
        """States x and nominal states z, (samples + 1) x n each, along a signal of modes; z(0) = x(0) = `start`.

        `disturbances` has a row w(k) a sample.

        Parameters
        ----------
        start
            x(0) = z(0), (n,).
        signal
            A mode a sample, numbered from 1.
        disturbances
            w(k), samples x q.

        Returns
        -------
        tuple
            States x and nominal states z, (samples + 1) x n each.
        """
        x = z = np.asarray(start, dtype=float)
        real, ideal, run = [x], [z], 0
        for k, mode in enumerate(signal):
            run = run + 1 if k and signal[k - 1] == mode else 0
            own = self.system.floats[mode - 1]
            v = self.nominal[mode, min(run, self.clock_nominal)] @ z
            u = v + self.error[mode, min(run, self.clock_error)] @ (x - z)
            x, z = own["A"] @ x + own["B"] @ u + own["E"] @ disturbances[k], own["A"] @ z + own["B"] @ v
            real.append(x)
            ideal.append(z)
        return np.array(real), np.array(ideal)
