"""Forces within friction cones that come as near as can be to balancing weights.

Non-negative least squares by active sets (Lawson & Hanson 1974, "Solving least squares problems",
ch. 23); what edges of cones do is made up from the cone's axes when it is looked at.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, helper, kernel

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CONE_SIDES = 16
"""Edges of the pyramid that stands for a friction cone: within 2 % of its friction."""
TOLERANCE = 1e-7
"""Share of the total weight: forces that improve the balance by less are not searched."""
COMPLIANCE = 1e-9
"""A spring in series with each force, so that of many forces that balance one set is found."""

COS = np.cos(np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES))
SIN = np.sin(np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES))


class Cones(NamedTuple):
    """Wrenches on the bodies from forces in the friction cones of C contacts.

    The force along edge k of a cone is n + µ (cos u + sin v): what it does is linear in what the
    normal n and two tangents u and v do. Everything is divided by the root of mass (of inertia), so
    that its square is the square of an acceleration of mass.

    Attributes:
        first, second: (C,) bodies, −1 for the ground.
        effect: (C, 3, 2, 6) of n, µ u and µ v: on both bodies, force and torque.
        scale: (C, CONE_SIDES) one over the length of what each edge does.
        whiten: (B, 3, 3) times a torque: that torque by root of inertia.
    """

    first: I64
    second: I64
    effect: F64
    scale: F64
    whiten: F64


class Forces(NamedTuple):
    """Up to M forces along edges of cones, and room to find them: least squares by active sets.

    Attributes:
        size: (1,) how many there are.
        used: (M,) the edge of each, counted over all cones.
        share: (M,) how strong each is.
        owner, column: (M, 2) and (M, 2, 6) the bodies it acts on and what it does, of length one.
        active: (C × CONE_SIDES,) the edges in use.
        gram, root: (M, M) products of the columns, and their Cholesky factor.
        wanted, half, trial: (M,) right-hand side, and what is solved for.
    """

    size: I64
    used: I64
    share: F64
    owner: I64
    column: F64
    active: Bool
    gram: F64
    root: F64
    wanted: F64
    half: F64
    trial: F64


@allocating
def room_for_cones(contacts: int, bodies: int) -> Cones:
    """Not filled in yet."""
    return Cones(
        np.empty(contacts, np.int64),
        np.empty(contacts, np.int64),
        np.zeros((contacts, 3, 2, 6)),
        np.empty((contacts, CONE_SIDES)),
        np.empty((bodies, 3, 3)),
    )


@allocating
def room_for_forces(contacts: int, bodies: int) -> Forces:
    """None yet."""
    most = min(contacts * CONE_SIDES, 6 * bodies + 1)  # so many balance what can be balanced
    return Forces(
        np.zeros(1, np.int64),
        np.empty(most, np.int64),
        np.zeros(most),
        np.empty((most, 2), np.int64),
        np.empty((most, 2, 6)),
        np.zeros(contacts * CONE_SIDES, np.bool_),
        np.zeros((most, most)),
        np.zeros((most, most)),
        np.zeros(most),
        np.zeros(most),
        np.zeros(most),
    )


@kernel
def balance(cones: Cones, some: Bool, count: int, forces: Forces, weight: F64, rest: F64) -> int:
    """Least squares of ``weight`` (B, 6) by forces of ``some`` of the first contacts: fills ``rest``.

    Begins with the forces that are there: none, or those that balance another weight of the same
    bodies at the same contacts. Returns the number of rounds.
    """
    gram, root, share, trial = forces.gram, forces.root, forces.share, forces.trial
    most, n = len(forces.used), forces.size[0]
    total = 0.0
    for b in range(weight.shape[0]):
        for i in range(6):
            total += weight[b, i] * weight[b, i]
            rest[b, i] = weight[b, i]
    enough = TOLERANCE * math.sqrt(total)
    for k in range(n):
        forces.wanted[k] = _along(forces, k, weight)
    begun, barred, rounds = n > 0, -1, 0
    while rounds < 20 * most:
        rounds += 1
        if not begun:
            best = _best(cones, some, count, forces.active, barred, rest, enough)
            if best < 0 or n == most:
                break
            _add(cones, forces, n, best, weight)
            n += 1
            if not _factor(gram, root, n - 1, n):
                n -= 1
                forces.active[best] = False
                barred = best
                continue
        begun, barred = False, -1
        while True:
            solve(root, forces.wanted, forces.half, trial, n)
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
                barred = forces.used[n - 1]  # rounding alone made it look useful
            first, kept = n, 0
            for k in range(n):
                share[k] += step * (trial[k] - share[k])
            share[worst] = 0.0
            for k in range(n):
                if share[k] > 1e-14 * total or (k != worst and trial[k] > 0.0):
                    if kept != k:
                        _move(forces, k, kept, n)
                    kept += 1
                else:
                    forces.active[forces.used[k]] = False
                    first = min(first, k)
            n = kept
            if n == 0:
                break
            if not _factor(gram, root, first, n):
                forces.size[0] = n
                clear(forces)
                return -1
        for b in range(weight.shape[0]):
            for i in range(6):
                rest[b, i] = weight[b, i]
        for k in range(n):
            for side in range(2):
                b = forces.owner[k, side]
                if b >= 0:
                    for i in range(6):
                        rest[b, i] -= share[k] * forces.column[k, side, i]
    forces.size[0] = n
    return rounds


@kernel
def clear(forces: Forces) -> None:
    """Begin without forces."""
    for k in range(forces.size[0]):
        forces.active[forces.used[k]] = False
    forces.size[0] = 0


@kernel
def _best(
    cones: Cones, some: Bool, count: int, active: Bool, barred: int, rest: F64, enough: float
) -> int:
    """The edge, not active yet, along which most of what is left points; −1 if none does."""
    best, gain = -1, enough
    for c in range(count):
        if not some[c]:
            continue
        gn = gu = gv = 0.0
        for side in range(2):
            b = cones.second[c] if side else cones.first[c]
            if b >= 0:
                for i in range(6):
                    r = rest[b, i]
                    gn += cones.effect[c, 0, side, i] * r
                    gu += cones.effect[c, 1, side, i] * r
                    gv += cones.effect[c, 2, side, i] * r
        if gn + abs(gu) + abs(gv) <= 0.0:  # every edge points the other way
            continue
        for k in range(CONE_SIDES):
            g = (gn + COS[k] * gu + SIN[k] * gv) * cones.scale[c, k]
            if g > gain and not active[c * CONE_SIDES + k] and c * CONE_SIDES + k != barred:
                best, gain = c * CONE_SIDES + k, g
    return best


@kernel
def _add(cones: Cones, forces: Forces, n: int, edge: int, weight: F64) -> None:
    """Make an edge the last of n + 1 forces."""
    c, k = edge // CONE_SIDES, edge % CONE_SIDES
    forces.owner[n, 0], forces.owner[n, 1] = cones.first[c], cones.second[c]
    for side in range(2):
        for i in range(6):
            at = cones.effect[c, 0, side, i]
            at += COS[k] * cones.effect[c, 1, side, i] + SIN[k] * cones.effect[c, 2, side, i]
            forces.column[n, side, i] = at * cones.scale[c, k]
    forces.used[n], forces.share[n], forces.active[edge] = edge, 0.0, True
    for k in range(n):
        forces.gram[n, k] = forces.gram[k, n] = _between(forces, n, k)
    forces.gram[n, n] = 1.0 + COMPLIANCE
    forces.wanted[n] = _along(forces, n, weight)


@kernel
def _move(forces: Forces, k: int, to: int, n: int) -> None:
    """Make the k-th of n forces an earlier one."""
    forces.used[to], forces.share[to] = forces.used[k], forces.share[k]
    forces.wanted[to] = forces.wanted[k]
    for side in range(2):
        forces.owner[to, side] = forces.owner[k, side]
        for i in range(6):
            forces.column[to, side, i] = forces.column[k, side, i]
    for m in range(n):
        forces.gram[to, m] = forces.gram[k, m]
    for m in range(n):
        forces.gram[m, to] = forces.gram[m, k]


@helper
def _along(forces: Forces, k: int, vector: F64) -> float:
    found = 0.0
    for side in range(2):
        b = forces.owner[k, side]
        if b >= 0:
            for i in range(6):
                found += forces.column[k, side, i] * vector[b, i]
    return found


@helper
def _between(forces: Forces, j: int, k: int) -> float:
    found = 0.0
    for one in range(2):
        for other in range(2):
            if forces.owner[j, one] >= 0 and forces.owner[j, one] == forces.owner[k, other]:
                for i in range(6):
                    found += forces.column[j, one, i] * forces.column[k, other, i]
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
def solve(root: F64, wanted: F64, half: F64, trial: F64, n: int) -> None:
    """Solve root rootᵀ trial = wanted (n,); ``half`` is room for what root gives, ``trial`` may be it."""
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
