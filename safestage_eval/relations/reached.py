"""Whether forces that would balance are reached: contacts give a little, and slip.

That some forces within the friction cones balance all bodies does not make them arise. Where
friction can wedge bodies against each other there are many, and which ones act is decided by how
the contacts give. So each contact is taken for a spring, equally stiff in all directions, under the
force that it has; it only presses, and slips where friction is exhausted without pushing the two
apart (Coulomb's law). Bodies give way in the direction in which they are out of balance until they
are in balance, or it is clear that they never will be. How stiff the springs are does not matter:
only forces are compared.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, helper, kernel

from .cones import solve
from .statics import Bodies, Touches

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

GRAVITY = 9.81
ANEW = 4
"""In each so many-th round only those springs count that press, and do not slip, at that moment."""
BRIEF, PATIENT = 15 * ANEW + 1, 150 * ANEW + 1
"""Rounds. The last follows upon such a one, so that only what nothing can take up is left. Wedged
bodies need many. Where points bear that are only near, a balance that many rounds bring about is
none: they would have to close their gaps first."""
LOOK = 8 * ANEW
"""After so many rounds it is looked whether anything still comes to rest."""
CALMER = 0.95
"""A body that still moves by more than this share of its motion at the last check will not rest."""
BALANCED = 0.003
"""Share of g: what is less out of balance has found its forces."""
LOOSE = 1e-4
"""Share of the greatest stiffness that holds a body nothing else holds, so that steps stay finite."""


class Springs(NamedTuple):
    """Room for C contacts of B bodies.

    Attributes:
        start: (C, 3) N, of each contact the force so far, along its normal and across.
        force, before: (C, 3) N, the same as the springs give, now and in the round before.
        slips: (C,) friction is exhausted.
        effect: (C, 2, 3, 6) what a unit force along each axis does to both, by root of mass.
        heavy: (B,) root of mass.
        turn: (B, 3, 3) Cholesky factor of the inertia.
        place: (B,) number of each body among those that may move, −1 for none.
        held, now: (6 B, 6 B) Cholesky factors of the stiffness of all springs, and of those that
            hold at the moment.
        rest, moved: (6 B,) what is out of balance, and how bodies give way.
        before_moved: (B,) how strongly each body moved at the last look, in g.
    """

    start: F64
    force: F64
    before: F64
    slips: Bool
    effect: F64
    heavy: F64
    turn: F64
    place: I64
    held: F64
    now: F64
    rest: F64
    moved: F64
    before_moved: F64


@allocating
def room_for_springs(contacts: int, bodies: int) -> Springs:
    """Nothing is filled in yet."""
    return Springs(
        np.empty((contacts, 3)), np.empty((contacts, 3)), np.empty((contacts, 3)),
        np.empty(contacts, np.bool_),
        np.empty((contacts, 2, 3, 6)), np.empty(bodies), np.empty((bodies, 3, 3)),
        np.empty(bodies, np.int64), np.empty((6 * bodies, 6 * bodies)),
        np.empty((6 * bodies, 6 * bodies)), np.empty(6 * bodies), np.empty(6 * bodies),
        np.empty(bodies),
    )  # fmt: skip


@kernel
def stretch(bodies: Bodies, touches: Touches, force: F64, count: int, springs: Springs) -> None:
    """Fill in ``start``, ``effect``, ``heavy`` and ``turn``."""
    for b in range(len(bodies.mass)):
        springs.heavy[b] = math.sqrt(bodies.mass[b])
        for i in range(3):
            for j in range(i + 1):
                springs.turn[b, i, j] = bodies.inertia[b, i, j]
        _factor(springs.turn[b], 3)
    for c in range(count):
        _across(touches.normal[c], springs.moved)
        for k in range(3):
            x, y, z = _axis(touches.normal[c], springs.moved, k)
            springs.start[c, k] = x * force[c, 0] + y * force[c, 1] + z * force[c, 2]
            for side in range(2):
                b = touches.second[c] if side else touches.first[c]
                if b < 0:
                    continue
                sign = 1.0 if side else -1.0
                at = springs.effect[c, side, k]
                px = touches.position[c, 0] - bodies.centre[b, 0]
                py = touches.position[c, 1] - bodies.centre[b, 1]
                pz = touches.position[c, 2] - bodies.centre[b, 2]
                at[0] = sign * x / springs.heavy[b]
                at[1] = sign * y / springs.heavy[b]
                at[2] = sign * z / springs.heavy[b]
                at[3] = sign * (py * z - pz * y)
                at[4] = sign * (pz * x - px * z)
                at[5] = sign * (px * y - py * x)
                for i in range(3):
                    for j in range(i):
                        at[3 + i] -= springs.turn[b, i, j] * at[3 + j]
                    at[3 + i] /= springs.turn[b, i, i]


@helper
def _across(normal: F64, out: F64) -> None:
    """A unit vector across a normal."""
    if abs(normal[0]) < 0.9:
        x, y, z = 0.0, normal[2], -normal[1]
    else:
        x, y, z = -normal[2], 0.0, normal[0]
    size = math.sqrt(x * x + y * y + z * z)
    out[0], out[1], out[2] = x / size, y / size, z / size


@helper
def _axis(normal: F64, across: F64, k: int) -> tuple[float, float, float]:
    """The normal, the vector across, or what is at right angles to both."""
    if k == 0:
        return normal[0], normal[1], normal[2]
    if k == 1:
        return across[0], across[1], across[2]
    return (
        normal[1] * across[2] - normal[2] * across[1],
        normal[2] * across[0] - normal[0] * across[2],
        normal[0] * across[1] - normal[1] * across[0],
    )


@kernel
def give(
    springs: Springs, touches: Touches, some: Bool, count: int, left: Bool, push: F64, moved: F64,
    rounds: int,
) -> None:  # fmt: skip
    """Fill ``moved`` (B,): how strongly each body that is ``left`` (B,) starts to move, in g.

    Only the contacts ``some`` (C,) count. On each body acts its weight, and ``push`` (2,), shares of
    it along x and y. After so many ``rounds`` (``BRIEF`` or ``PATIENT``) no balance is looked for.
    """
    n = 0
    for b in range(len(left)):
        springs.place[b] = n if left[b] else -1
        n += left[b]
    loose = _stiffen(springs, touches, some, count, n, springs.held, False, 0.0)
    for c in range(count):
        for k in range(3):
            springs.force[c, k] = springs.start[c, k]
    least = np.inf
    for turn in range(rounds):
        _slip(springs, touches, some, count)
        most = _weigh(springs, touches, some, count, left, push, moved)
        if most < BALANCED:
            return
        if turn and turn % ANEW == 0 and most > least:  # worse than before: not in this way
            for c in range(count):
                for k in range(3):
                    springs.force[c, k] = springs.before[c, k]
            most = _weigh(springs, touches, some, count, left, push, moved)
        least = most
        if turn and turn % LOOK == 0 and _settled(springs, left, moved, turn == LOOK):
            return
        if turn % ANEW == ANEW - 1:
            _stiffen(springs, touches, some, count, n, springs.now, True, loose)
            solve(springs.now, springs.rest, springs.moved, springs.moved, 6 * n)
        else:
            solve(springs.held, springs.rest, springs.moved, springs.moved, 6 * n)
        for c in range(count):
            if some[c]:
                for k in range(3):
                    springs.before[c, k] = springs.force[c, k]
                    springs.force[c, k] -= _along(springs, touches, c, k)


@kernel
def _settled(springs: Springs, left: Bool, moved: F64, first: bool) -> bool:
    """Whatever still moves does so as strongly as at the last look; False at the ``first`` one."""
    settled = not first
    for b in range(len(left)):
        if left[b]:
            if not first and BALANCED < moved[b] < CALMER * springs.before_moved[b]:
                settled = False
            springs.before_moved[b] = moved[b]
    return settled


@helper
def _along(springs: Springs, touches: Touches, c: int, k: int) -> float:
    """How far the two sides of a contact come apart along an axis."""
    found = 0.0
    for side in range(2):
        b = touches.second[c] if side else touches.first[c]
        if b >= 0 and springs.place[b] >= 0:
            for i in range(6):
                found += springs.effect[c, side, k, i] * springs.moved[6 * springs.place[b] + i]
    return found


@kernel
def _slip(springs: Springs, touches: Touches, some: Bool, count: int) -> None:
    """Cut what is across to what friction allows. A spring that is pulled long stays so."""
    for c in range(count):
        if some[c]:
            x, y = springs.force[c, 1], springs.force[c, 2]
            most = touches.friction[c] * max(springs.force[c, 0], 0.0)
            size = math.sqrt(x * x + y * y)
            springs.slips[c] = size > most
            if size > most:
                springs.force[c, 1], springs.force[c, 2] = x * most / size, y * most / size


@kernel
def _weigh(
    springs: Springs, touches: Touches, some: Bool, count: int, left: Bool, push: F64, moved: F64
) -> float:
    """Compute the unbalanced acceleration of each body, in g, and return the largest."""
    rest = springs.rest
    for b in range(len(left)):
        p = springs.place[b]
        if p >= 0:
            for i in range(3, 6):
                rest[6 * p + i] = 0.0
            rest[6 * p] = GRAVITY * springs.heavy[b] * push[0]
            rest[6 * p + 1] = GRAVITY * springs.heavy[b] * push[1]
            rest[6 * p + 2] = -GRAVITY * springs.heavy[b]
    for c in range(count):
        if not some[c]:
            continue
        for side in range(2):
            b = touches.second[c] if side else touches.first[c]
            if b < 0 or springs.place[b] < 0:
                continue
            for k in range(3):
                f = springs.force[c, k] if k else max(springs.force[c, 0], 0.0)
                for i in range(6):
                    rest[6 * springs.place[b] + i] += springs.effect[c, side, k, i] * f
    greatest = 0.0
    for b in range(len(left)):
        moved[b] = 0.0
        if springs.place[b] >= 0:
            for i in range(6):
                moved[b] += rest[6 * springs.place[b] + i] ** 2
            moved[b] = math.sqrt(moved[b]) / springs.heavy[b] / GRAVITY
            greatest = max(greatest, moved[b])
    return greatest


@kernel
def _stiffen(
    springs: Springs, touches: Touches, some: Bool, count: int, n: int, out: F64, holding: bool,
    loose: float,
) -> float:  # fmt: skip
    """The Cholesky factor of the springs' stiffness for ``n`` bodies; what was added to it.

    ``holding``: only of those that press, and across only of those that do not slip.
    """
    for i in range(6 * n):
        for j in range(i + 1):
            out[i, j] = 0.0
    for c in range(count):
        if not some[c] or (holding and springs.force[c, 0] <= 0.0):
            continue
        for one in range(2):
            b = touches.second[c] if one else touches.first[c]
            if b < 0 or springs.place[b] < 0:
                continue
            for other in range(2):
                d = touches.second[c] if other else touches.first[c]
                if d < 0 or springs.place[d] < 0 or springs.place[d] > springs.place[b]:
                    continue
                row, column = 6 * springs.place[b], 6 * springs.place[d]
                for k in range(1 if holding and springs.slips[c] else 3):
                    for i in range(6):
                        by = springs.effect[c, one, k, i]
                        for j in range(6):
                            out[row + i, column + j] += by * springs.effect[c, other, k, j]
    if not holding:
        for i in range(6 * n):
            loose = max(loose, out[i, i])
        loose = max(LOOSE * loose, 1e-12)
    for i in range(6 * n):
        out[i, i] += loose
    _factor(out, 6 * n)
    return loose


@kernel
def _factor(matrix: F64, n: int) -> None:
    """Cholesky, of and into the lower triangle."""
    for i in range(n):
        for j in range(i + 1):
            s = matrix[i, j]
            for k in range(j):
                s -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = s / matrix[j, j] if j < i else math.sqrt(max(s, 1e-30))
