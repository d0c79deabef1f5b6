"""Bodies that fall when one is removed: the rest of the pile is balanced again until no more fall."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import allocating, kernel

from .cones import Cones, Forces, balance, clear, room_for_cones, room_for_forces
from .reached import PATIENT, Springs, give, room_for_springs, stretch
from .statics import LOST, Bodies, Touches, speeds, spread, weigh

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

PUSHES = np.array([[0.0, 0.0], [0.02, 0.0], [-0.02, 0.0], [0.0, 0.02], [0.0, -0.02]])
"""Shares of g along x and y: what falls as soon as the ground tilts by 1.1° falls. An equilibrium
that needs every contact to give its utmost exists on paper only."""
TIPS = LOST / 2
"""Share of g. A block on its edge starts to move by h/√(h² + k²) of a push, h the height and k the
radius of gyration of its centre: by less than ``LOST`` under any of ``PUSHES``, though it is over."""
EASED = 0.25
"""Share of a push. What begins to move only under more of it tips, and goes on by itself; what moves
under however little of it, and in proportion, rolls, and rests again where the ground is level."""
STILL = 1e-4
"""Share of g: what moves by less is in balance; a hoop that rolls, by 0.7 of the push."""


class Pile(NamedTuple):
    """B objects and P pairs of bodies that touch, at F frames.

    Attributes:
        mass: (B,) kg.
        centre: (F, B, 3) m, centres of mass, world.
        inertia: (F, B, 3, 3) kg m², about the centre of mass, world axes.
        owner: (P, 2) the object that each side of the pair is, −1 for what holds still.
        part: (P, 2) the object that it goes with when that is taken away, −1 for none.
        start: (P, F + 1) the pair's contact points at frame f are start[f] … start[f + 1].
        position, normal: (N, 3) m and unit, from the pair's first body to its second, world.
        friction: (N,)
        force: (N, 3) N, of the pair's first body on the second, world; 0 where they are only near.
    """

    mass: F64
    centre: F64
    inertia: F64
    owner: I64
    part: I64
    start: I64
    position: F64
    normal: F64
    friction: F64
    force: F64


def collapse(
    pile: Pile, body: int, removed: int, off: Bool, rounds: int = PATIENT
) -> tuple[I64, Bool]:
    """(F,) the first of ``PUSHES`` under which a body falls, −1 if none; (F, B) what falls then.

    First under those under which no forces could balance it, then under those under which none are
    reached that do (``reached``), then under those under which it tips.

    ``removed`` is taken away, −1 if it is no object of the pile, and with it the contacts of the
    pairs ``off`` (P,). ``rounds`` to look for forces that are reached: see ``reached``.
    """
    fallen = np.zeros(pile.centre.shape[:2], np.bool_)
    push = np.empty(len(fallen), np.int64)
    _collapse(pile, body, removed, off, PUSHES, push, fallen, rounds)
    return push, fallen


class _Group(NamedTuple):
    """Bodies that hang together at one frame, and room to see what falls.

    Attributes:
        joined: (B,) the bodies.
        gone, left: (B,) taken away or fallen; what touched such, and what hangs together with that.
        pair: (C,) the pair of each contact.
        present, kept: (P,) pairs that touch, and those of them that bear what is left.
        some, before: (C,) the contacts of these, and those of the balance before.
        weight, rest: (B, 6) see ``balance``.
        moved, unrest: (B,) how strongly each moves, in g; and with nothing taken away.
        eased: (B,) what is left, under ``EASED`` of the push.
        force: (C, 3) N, that each contact exerts.
        balanced: (B,) what is gone when the rest is in balance without a push: what falls only
            under one has not fallen yet when the springs are asked, and loads them with the rest.
    """

    joined: Bool
    gone: Bool
    left: Bool
    pair: I64
    present: Bool
    kept: Bool
    some: Bool
    before: Bool
    weight: F64
    rest: F64
    moved: F64
    unrest: F64
    eased: F64
    force: F64
    balanced: Bool


@allocating
def _collapse(
    pile: Pile, body: int, removed: int, off: Bool, pushes: F64, push: I64, fallen: Bool,
    rounds: int,
) -> None:  # fmt: skip
    bodies, pairs, most = len(pile.mass), len(pile.owner), 0
    for f in range(len(push)):
        points = 0
        for p in range(pairs):
            points += pile.start[p, f + 1] - pile.start[p, f]
        most = max(most, points)
    flags, numbers = np.zeros((3, bodies), np.bool_), np.zeros((3, bodies))
    group = _Group(
        flags[0], flags[1], flags[2], np.empty(most, np.int64),
        np.empty(pairs, np.bool_), np.empty(pairs, np.bool_),
        np.zeros(most, np.bool_), np.zeros(most, np.bool_),
        np.empty((bodies, 6)), np.empty((bodies, 6)), numbers[0], numbers[1], numbers[2],
        np.empty((most, 3)), np.zeros(bodies, np.bool_),
    )  # fmt: skip
    touches = Touches(
        np.empty(most, np.int64), np.empty(most, np.int64),
        np.empty((most, 3)), np.empty((most, 3)), np.empty(most),
    )  # fmt: skip
    cones, forces = room_for_cones(most, bodies), room_for_forces(most, bodies)
    springs, eased = room_for_springs(most, bodies), EASED * pushes
    for f in range(len(push)):
        _join(pile, body, f, group)
        count = _gather(pile, f, group, touches)
        there = Bodies(pile.mass, pile.centre[f], pile.inertia[f])
        spread(there, touches, count, cones)
        clear(forces)
        push[f], near = -1, False
        for k in range(len(pushes)):
            near |= _fall(
                pile, group, cones, forces, count, removed, off, pushes[k], False, eased[k]
            )
            if group.gone[body]:
                push[f] = k
                break
            for b in range(bodies if k == 0 else 0):
                group.balanced[b] = group.gone[b]
        else:
            stretch(there, touches, group.force, count, springs)
            for k in range(len(pushes)):
                for b in range(bodies):
                    group.gone[b] = group.balanced[b]
                _slide(pile, group, springs, touches, count, off, pushes[k], rounds)
                if group.gone[body]:
                    push[f] = k
                    break
        for k in range(len(pushes) if near and push[f] < 0 else 0):
            _fall(pile, group, cones, forces, count, removed, off, pushes[k], True, eased[k])
            if group.gone[body]:
                push[f] = k
                break
        if push[f] >= 0:
            for b in range(bodies):
                fallen[f, b] = group.gone[b]


@kernel
def _join(pile: Pile, body: int, f: int, group: _Group) -> None:
    """The bodies that contacts at a frame join to this one, and the pairs that touch them."""
    group.left[:] = False
    group.left[body] = True
    for p in range(len(pile.owner)):
        group.kept[p] = pile.start[p, f] < pile.start[p, f + 1]
    _spread_left(pile, group)
    for b in range(len(group.left)):
        group.joined[b] = group.left[b]
    for p in range(len(pile.owner)):
        i, j = pile.owner[p, 0], pile.owner[p, 1]
        near = (i >= 0 and group.joined[i]) or (j >= 0 and group.joined[j])
        group.present[p] = group.kept[p] and near


@kernel
def _spread_left(pile: Pile, group: _Group) -> None:
    """Add to what is left what contacts that are kept join to it."""
    more = True
    while more:
        more = False
        for p in range(len(pile.owner)):
            i, j = pile.owner[p, 0], pile.owner[p, 1]
            if group.kept[p] and i >= 0 and j >= 0 and group.left[i] != group.left[j]:
                group.left[i] = group.left[j] = more = True


@kernel
def _gather(pile: Pile, f: int, group: _Group, touches: Touches) -> int:
    """The contacts of what hangs together; how many there are."""
    count = 0
    for p in range(len(pile.owner)):
        if group.present[p]:
            for n in range(pile.start[p, f], pile.start[p, f + 1]):
                group.pair[count] = p
                touches.first[count], touches.second[count] = pile.owner[p, 0], pile.owner[p, 1]
                for a in range(3):
                    touches.position[count, a] = pile.position[n, a]
                    touches.normal[count, a] = pile.normal[n, a]
                    group.force[count, a] = pile.force[n, a]
                touches.friction[count] = pile.friction[n]
                count += 1
    return count


@kernel
def _fall(
    pile: Pile, group: _Group, cones: Cones, forces: Forces, count: int, removed: int, off: Bool,
    push: F64, tips: bool, eased: F64,
) -> bool:  # fmt: skip
    """Take a body away, and what moves then, until nothing more does: ``group.gone``.

    What ``tips`` is taken away as well if that is asked for: it moves under the push, and not under
    the ``eased`` one. True where something moves that might.
    """
    weighed, near, bodies = False, False, len(group.gone)
    group.gone[:] = False
    if removed >= 0:
        group.gone[removed] = True
    while _leave(pile, group, off):
        _balance(pile, group, cones, forces, count, push, group.moved)
        if not _moves(group, TIPS):
            return near
        near = True
        if not weighed:
            weighed = True
            _weigh_all(pile, group, cones, forces, count, push)
            _leave(pile, group, off)
        if tips:
            _balance(pile, group, cones, forces, count, eased, group.eased)
        moves = False
        for b in range(bodies):
            least = TIPS if tips and group.eased[b] < STILL else LOST
            if group.left[b] and group.moved[b] > least + group.unrest[b]:
                group.gone[b] = moves = True
        if not moves:
            return near
    return near


@kernel
def _slide(
    pile: Pile, group: _Group, springs: Springs, touches: Touches, count: int, off: Bool, push: F64,
    rounds: int,
) -> None:  # fmt: skip
    """Take away what no forces balance that are reached, until nothing more moves: ``group.gone``.

    Nothing where those are not in balance that act with nothing taken away: they are not known.
    """
    known, bodies = False, len(group.gone)
    while _leave(pile, group, off):
        _choose(pile, group, count)
        give(springs, touches, group.some, count, group.left, push, group.moved, rounds)
        if not _moves(group, LOST):
            return
        if not known:
            known = True
            for b in range(bodies):
                group.left[b] = group.joined[b]
            for p in range(len(group.kept)):
                group.kept[p] = group.present[p]
            _choose(pile, group, count)
            give(springs, touches, group.some, count, group.left, push, group.unrest, rounds)
            for b in range(bodies):
                if group.left[b] and group.unrest[b] > LOST:
                    return
            _leave(pile, group, off)
        for b in range(bodies):
            if group.left[b] and group.moved[b] > LOST:
                group.gone[b] = True


@kernel
def _moves(group: _Group, least: float) -> bool:
    """Something of what is left moves by more than so many g."""
    moves = False
    for b in range(len(group.left)):
        moves |= group.left[b] and group.moved[b] > least
    return moves


@kernel
def _weigh_all(
    pile: Pile, group: _Group, cones: Cones, forces: Forces, count: int, push: F64
) -> None:
    """Find the bodies that are out of balance before anything is removed."""
    for b in range(len(group.left)):
        group.left[b] = group.joined[b]
    for p in range(len(group.kept)):
        group.kept[p] = group.present[p]
    _balance(pile, group, cones, forces, count, push, group.unrest)


@kernel
def _leave(pile: Pile, group: _Group, off: Bool) -> bool:
    """Mark what touched the removed bodies, and all connected to it; False if nothing did."""
    group.left[:] = False
    some = False
    for p in range(len(group.kept)):
        i, j = pile.part[p, 0], pile.part[p, 1]
        away = off[p] or (i >= 0 and group.gone[i]) or (j >= 0 and group.gone[j])
        group.kept[p] = group.present[p] and not away
        if group.present[p] and away:
            for side in range(2):
                b = pile.owner[p, side]
                if b >= 0 and not group.gone[b]:
                    group.left[b] = some = True
    _spread_left(pile, group)
    return some


@kernel
def _choose(pile: Pile, group: _Group, count: int) -> None:
    """The contacts that bear what is left: ``group.some``."""
    for c in range(count):
        p = group.pair[c]
        i, j = pile.owner[p, 0], pile.owner[p, 1]
        bears = i != j and ((i >= 0 and group.left[i]) or (j >= 0 and group.left[j]))
        group.some[c] = group.kept[p] and bears


@kernel
def _balance(
    pile: Pile, group: _Group, cones: Cones, forces: Forces, count: int, push: F64, moved: F64
) -> None:
    """How strongly each moves of what is left, in g."""
    same = True
    _choose(pile, group, count)
    for c in range(count):
        same &= group.some[c] == group.before[c]
        group.before[c] = group.some[c]
    if not same:
        clear(forces)
    weigh(pile.mass, push, group.left, group.weight)
    balance(cones, group.some, count, forces, group.weight, group.rest)
    speeds(pile.mass, group.rest, moved)
