"""Which bodies of a group start to move, given where they touch: equilibrium with dry friction."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.compiled import allocating, helper, kernel

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CONE_SIDES = 16
"""Edges of the pyramid that stands for a friction cone: within 2 % of its friction."""
LOST = 0.02
"""Share of g: what starts to move by less is kept in its place by what no recording tells."""
ARM = 0.05
"""m: the lever by which torques are compared with forces; radius of gyration where none is told."""

TOLERANCE = 1e-7
"""Of the total weight: a force that would better the balance by less is not looked for."""
COMPLIANCE = 1e-9
"""A spring in series with each force, so that of many forces that balance one set is found."""


class Bodies(NamedTuple):
    """B rigid bodies.

    Attributes:
        mass: (B,) kg.
        centre: (B, 3) m, centres of mass, world.
        inertia: (B, 3, 3) kg m², about the centre of mass, world axes.
    """

    mass: F64
    centre: F64
    inertia: F64


class Touches(NamedTuple):
    """C points in which they touch each other or the ground (−1).

    Attributes:
        first, second: (C,) bodies.
        position: (C, 3) m, world.
        normal: (C, 3) unit, from the first to the second.
        friction: (C,) sliding coefficients.
    """

    first: I64
    second: I64
    position: F64
    normal: F64
    friction: F64


class Balance:
    """Bodies and where they touch, prepared to be asked what moves under several pushes."""

    def __init__(self, bodies: Bodies, touches: Touches) -> None:
        """Nothing is solved yet."""
        self._heavy = np.sqrt(bodies.mass)
        self._owner = np.repeat(np.stack([touches.first, touches.second], 1), CONE_SIDES, axis=0)
        if len(touches.first):
            effect = _effects(bodies, touches)
            self._effect = effect / np.sqrt((effect**2).sum((1, 2)))[:, None, None]

    def motion(self, push: tuple[float, float] = (0.0, 0.0)) -> F64:
        """(B,) how strongly each body starts to move, in g; 0 where the forces balance.

        On each acts its weight, and ``push`` (shares of the weight along x and y) sideways.

        Forces within the friction cones, equal and opposite on both bodies, are chosen such that
        what stays unbalanced moves all bodies together as little as can be (Gauss's principle of
        least constraint; non-negative least squares by active sets, Lawson & Hanson 1974, "Solving
        least squares problems", ch. 23). If some forces balance all bodies, those are found and
        nothing moves: whether they exist is the linear program of Baraff 1991, "Coping with
        friction for non-penetrating rigid body simulation". If not, the motion is the only one of
        least constraint, and tells which bodies fall. A body's motion is the root of the mean
        square acceleration of its mass.
        """
        weight = np.zeros((len(self._heavy), 6))
        weight[:, :3] = self._heavy[:, None] * np.array([*push, 1.0])
        rest = weight.copy()
        if len(self._owner):
            least_constraint(self._effect, self._owner, weight, rest)
        return np.asarray(np.sqrt((rest**2).sum(1)) / self._heavy)


def motion(bodies: Bodies, touches: Touches) -> F64:
    """(B,) how strongly each body starts to move of itself, in g: see ``Balance``."""
    return Balance(bodies, touches).motion()


def _effects(bodies: Bodies, touches: Touches) -> F64:
    """(C × CONE_SIDES, 2, 6) what each edge of each cone does to both bodies, by root of mass."""
    normal = touches.normal
    helper_ = np.where(np.abs(normal[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = _cross(normal, helper_)
    first /= np.sqrt((first**2).sum(1, keepdims=True))
    second = _cross(normal, first)
    angles = np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES)
    sideways = (
        np.cos(angles)[None, :, None] * first[:, None]
        + np.sin(angles)[None, :, None] * second[:, None]
    )
    edges = normal[:, None] + touches.friction[:, None, None] * sideways
    whiten = np.linalg.inv(np.linalg.cholesky(bodies.inertia))
    out = np.zeros((len(normal), CONE_SIDES, 2, 6))
    for side, (body, sign) in enumerate(((touches.first, -1.0), (touches.second, 1.0))):
        on = np.flatnonzero(body >= 0)
        b = body[on]
        force = sign * edges[on]
        torque = _cross((touches.position[on] - bodies.centre[b])[:, None], force)
        out[on, :, side, :3] = force / np.sqrt(bodies.mass[b])[:, None, None]
        out[on, :, side, 3:] = np.einsum("cij,csj->csi", whiten[b], torque)
    return out.reshape(-1, 2, 6)


def _cross(a: F64, b: F64) -> F64:
    """As ``np.cross`` over the last axis, which takes several times as long for few vectors."""
    (ax, ay, az), (bx, by, bz) = ((v[..., 0], v[..., 1], v[..., 2]) for v in (a, b))
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)


@allocating
def least_constraint(effect: F64, owner: I64, weight: F64, rest: F64) -> int:
    """Least squares of ``weight`` (B, 6) by non-negative shares of M effects; fills ``rest``.

    ``effect`` (M, 2, 6), each of length one, on the bodies ``owner`` (M, 2), −1 for none. Returns
    the number of rounds.
    """
    many, most = effect.shape[0], min(effect.shape[0], 6 * weight.shape[0] + 1)
    used = np.empty(most, np.int64)
    active = np.zeros(many, np.bool_)
    share, trial = np.zeros(most), np.zeros(most)
    wanted, half = np.zeros(most), np.zeros(most)
    gram, root = np.zeros((most, most)), np.zeros((most, most))
    total = 0.0
    for b in range(weight.shape[0]):
        for i in range(6):
            total += weight[b, i] * weight[b, i]
            rest[b, i] = weight[b, i]
    enough = TOLERANCE * math.sqrt(total)
    n, barred, rounds = 0, -1, 0
    while rounds < 20 * most:
        rounds += 1
        best, gain = -1, enough
        for j in range(many):
            if not active[j] and j != barred:
                g = _along(effect, owner, j, rest)
                if g > gain:
                    best, gain = j, g
        if best < 0 or n == most:
            break
        # one more force
        for k in range(n):
            gram[n, k] = gram[k, n] = _between(effect, owner, best, used[k])
        gram[n, n] = 1.0 + COMPLIANCE
        used[n], share[n], active[best] = best, 0.0, True
        wanted[n] = _along(effect, owner, best, weight)
        n += 1
        if not _factor(gram, root, n - 1, n):
            n -= 1
            active[best] = False
            barred = best
            continue
        barred = -1
        while True:
            _solve(root, wanted, half, trial, n)
            step, worst = 1.0, -1
            for k in range(n):
                if trial[k] <= 0.0:
                    s = 0.0 if share[k] <= 0.0 else share[k] / (share[k] - trial[k])
                    if s < step:
                        step, worst = s, k
            if worst < 0:
                for k in range(n):
                    share[k] = trial[k]
                break
            if worst == n - 1 and share[n - 1] == 0.0 and step == 0.0:
                barred = used[n - 1]  # rounding alone made it look useful
            first, kept = n, 0
            for k in range(n):
                share[k] += step * (trial[k] - share[k])
            share[worst] = 0.0
            for k in range(n):
                if share[k] > 1e-14 * total or (k != worst and trial[k] > 0.0):
                    if kept != k:
                        used[kept], share[kept], wanted[kept] = used[k], share[k], wanted[k]
                        for m in range(n):
                            gram[kept, m] = gram[k, m]
                        for m in range(n):
                            gram[m, kept] = gram[m, k]
                    kept += 1
                else:
                    active[used[k]] = False
                    first = min(first, k)
            n = kept
            if n == 0:
                break
            if not _factor(gram, root, first, n):
                return -1
        for b in range(weight.shape[0]):
            for i in range(6):
                rest[b, i] = weight[b, i]
        for k in range(n):
            for side in range(2):
                b = owner[used[k], side]
                if b >= 0:
                    for i in range(6):
                        rest[b, i] -= share[k] * effect[used[k], side, i]
    return rounds


@helper
def _along(effect: F64, owner: I64, j: int, vector: F64) -> float:
    found = 0.0
    for side in range(2):
        b = owner[j, side]
        if b >= 0:
            for i in range(6):
                found += effect[j, side, i] * vector[b, i]
    return found


@helper
def _between(effect: F64, owner: I64, j: int, k: int) -> float:
    found = 0.0
    for one in range(2):
        for other in range(2):
            if owner[j, one] >= 0 and owner[j, one] == owner[k, other]:
                for i in range(6):
                    found += effect[j, one, i] * effect[k, other, i]
    return found


@kernel
def _factor(gram: F64, root: F64, first: int, n: int) -> bool:
    """Rows of the Cholesky factor from ``first`` on; False where the matrix is singular."""
    for i in range(first, n):
        for j in range(i + 1):
            s = gram[i, j]
            for k in range(j):
                s -= root[i, k] * root[j, k]
            if i == j:
                if s <= 0.1 * COMPLIANCE:
                    return False
                root[i, i] = math.sqrt(s)
            else:
                root[i, j] = s / root[j, j]
    return True


@kernel
def _solve(root: F64, wanted: F64, half: F64, trial: F64, n: int) -> None:
    for i in range(n):
        s = wanted[i]
        for k in range(i):
            s -= root[i, k] * half[k]
        half[i] = s / root[i, i]
    for i in range(n - 1, -1, -1):
        s = half[i]
        for k in range(i + 1, n):
            s -= root[k, i] * trial[k]
        trial[i] = s / root[i, i]
