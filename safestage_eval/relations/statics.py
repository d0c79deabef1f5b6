"""Which bodies of a pile fall when one is taken away: equilibrium with dry friction.

Forces within the friction cones of all contacts, equal and opposite on both bodies, are chosen such that
what stays unbalanced moves all bodies together as little as can be (Gauss's principle of least
constraint): non-negative least squares over the edges of the cones. If some forces balance all bodies
(Baraff 1991, "Coping with friction for non-penetrating rigid body simulation"), those are found and
nothing moves; if not, the motion tells which bodies fall. They are taken away too, until no more fall.
A body's motion is the root of the mean square acceleration of its mass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

LOST = 0.02
"""Share of g: what starts to move by less is kept in its place by what no recording tells."""
ARM = 0.05
"""m: the lever by which torques are compared with forces; radius of gyration where none is stated."""
CONE_SIDES = 16
"""Edges of the pyramid that stands for a friction cone: within 2 % of its friction."""
TOLERANCE = 1e-6
"""Share of the total weight: forces that improve the balance by less are not looked for."""
ALIKE = 1e-12
"""Added to the normal equations, which are singular where two edges do the same; edges have length 1."""
ROUNDS = 1000
"""Times that edges may join: rounding could otherwise go on for ever."""
PUSHES = 0.02 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Shares of g along x and y: what falls as soon as the ground tilts by 1.1° falls. An equilibrium
that needs every contact to give its utmost exists on paper only. What is in balance under all of them
is so on level ground too: weights that can be balanced are a convex set."""

_ANGLES = np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES)
_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2).reshape(3, 9)
"""An arm (3,) @ it, as (3, 3), makes torques of forces."""
_AROUND = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], 1)


class Pile(NamedTuple):
    """B bodies and C points in which they touch each other or what holds still (−1).

    Attributes:
        mass: (B,) kg.
        centre: (B, 3) m, centres of mass, world.
        inertia: (B, 3, 3) kg m², about the centre of mass, world axes.
        first, second: (C,) bodies.
        position: (C, 3) m, world.
        normal: (C, 3) unit, from the first to the second.
        friction: (C,) sliding coefficients.
    """

    mass: F64
    centre: F64
    inertia: F64
    first: I64
    second: I64
    position: F64
    normal: F64
    friction: F64


def fallen(pile: Pile, gone: Bool, off: Bool) -> Bool:
    """(B,) what is away at last when the bodies ``gone`` (B,) and the contacts ``off`` (C,) are.

    That is what falls under any of ``PUSHES``, taken away along with what is gone. What moves as much
    with nothing taken away does not fall for that.
    """
    edges, out, every = effects(pile), gone.copy(), np.ones_like(off)
    for push in PUSHES:
        away, kept = gone, ~off & ~touched(pile, gone)
        while not (out | away).all():
            lacks = np.zeros(len(gone) + 1, np.bool_)  # the last is what holds still
            lacks[pile.first[~kept]] = lacks[pile.second[~kept]] = True
            motion = moved(pile, edges, kept, push, lacks[:-1] & ~away)
            falls = motion > LOST
            if falls.any():
                falls = motion > LOST + moved(pile, edges, every, push, falls)
            if not falls.any():
                break
            away, kept = away | falls, kept & ~touched(pile, falls)
        out |= away
    return out


def touched(pile: Pile, bodies: Bool) -> Bool:
    """(C,) the contacts of some bodies (B,)."""
    with_ground = np.append(bodies, False)
    return np.asarray(with_ground[pile.first] | with_ground[pile.second])


def effects(pile: Pile) -> F64:
    """(C, CONE_SIDES, B, 6) what a force along each edge of each cone does to each body, of length 1.

    Forces are divided by the root of mass, torques by that of inertia, so that the square of what they
    do is that of an acceleration of mass.
    """
    n, rows = pile.normal, np.arange(len(pile.first))
    u = np.cross(n, np.where(np.abs(n[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    tangents = np.stack([u, np.cross(n, u)], 1)
    edges = n[:, None] + pile.friction[:, None, None] * (_AROUND @ tangents)
    heavy = np.append(np.sqrt(pile.mass), np.inf)  # the last is what holds still
    centre, turn = np.zeros((len(heavy), 3)), np.zeros((len(heavy), 3, 3))
    centre[:-1], turn[:-1] = pile.centre, np.linalg.inv(np.linalg.cholesky(pile.inertia))
    out = np.zeros((len(rows), CONE_SIDES, len(heavy), 6))
    for body, sign in ((pile.first, -1.0), (pile.second, 1.0)):
        torque = turn[body] @ ((pile.position - centre[body]) @ _CROSS).reshape(-1, 3, 3)
        out[rows, :, body, :3] += sign * edges / heavy[body, None, None]
        out[rows, :, body, 3:] += sign * edges @ torque.swapaxes(1, 2)
    out = out[:, :, :-1]
    return np.asarray(out / np.sqrt((out**2).sum(axis=(2, 3), keepdims=True)))


def moved(pile: Pile, edges: F64, kept: Bool, push: F64, bodies: Bool) -> F64:
    """(B,) how strongly bodies (B,) and what contacts join to them start to move, in g; 0 of the rest.

    Only the contacts ``kept`` (C,) count. On each body acts its weight, and ``push`` (2,), shares of
    the weight along x and y. ``edges``: the pile's ``effects``.
    """
    heavy, out = np.sqrt(pile.mass), np.zeros(len(bodies))
    weight = np.zeros((len(heavy), 6))
    weight[:, :3] = heavy[:, None] * [-push[0], -push[1], 1.0]
    for joined in islands(pile, kept, bodies):
        some, own = np.flatnonzero(joined), np.flatnonzero(kept & touched(pile, joined))
        columns = edges[own][:, :, some].reshape(len(own), CONE_SIDES, 6 * len(some))
        rest = unbalanced(columns, weight[some].ravel()).reshape(-1, 6)
        out[some] = np.linalg.norm(rest, axis=1) / heavy[some]
    return out


def islands(pile: Pile, kept: Bool, bodies: Bool) -> list[Bool]:
    """(B,) each: the sets that contacts ``kept`` (C,) join bodies to, of those that some (B,) are in."""
    between = np.flatnonzero(kept & (pile.first >= 0) & (pile.second >= 0))
    joined = np.eye(len(bodies))
    joined[pile.first[between], pile.second[between]] = 1
    joined[pile.second[between], pile.first[between]] = 1
    reach = joined @ joined > 0
    while (reach > joined).any():
        joined = reach.astype(np.float64)
        reach = joined @ joined > 0
    return [reach[k] for k in np.unique(reach[bodies].argmax(axis=1)).tolist()]


def unbalanced(edges: F64, weight: F64) -> F64:
    """(R,) the least that non-negative sums of edges (C, CONE_SIDES, R) leave of a weight (R,).

    The active-set method of Lawson & Hanson 1974, "Solving least squares problems", ch. 23: few edges
    bear anything, so sums of these alone are taken. Of each cone the edge joins that takes most of
    what is left, until none takes any; an edge that would have to pull leaves. All may join at once:
    the best sum then pushes at least one of them, or what is left would not have become less.
    """
    every, first = edges.reshape(-1, len(weight)), np.arange(len(edges)) * CONE_SIDES
    used: I64 = np.zeros(0, np.int64)
    force: F64 = np.zeros(0)
    rest, enough = weight, TOLERANCE * np.sqrt(weight @ weight)
    for _ in range(ROUNDS if edges.size else 0):
        gain = every @ rest
        gain[used] = 0.0
        best = first + gain.reshape(-1, CONE_SIDES).argmax(axis=1)
        more = best[gain[best] > enough]
        if not len(more):
            break
        used, force = np.append(used, more), np.append(force, np.zeros(len(more)))
        while len(used):
            some = every[used]
            square = some @ some.T
            square.flat[:: len(used) + 1] += ALIKE  # edges may be sums of others
            wanted: F64 = np.asarray(np.linalg.solve(square, some @ weight), np.float64)
            pulls = np.flatnonzero(wanted <= 0)
            if not len(pulls):
                force = wanted
                break
            share = force[pulls] / np.maximum(force[pulls] - wanted[pulls], 1e-300)
            force = force + share.min() * (wanted - force)
            stays = np.ones(len(used), np.bool_)
            stays[pulls[share <= share.min()]] = False
            used, force = used[stays], np.maximum(force[stays], 0.0)
        rest = weight - force @ every[used]
    return rest
