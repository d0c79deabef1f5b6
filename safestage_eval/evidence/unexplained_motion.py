"""When what lay still was set in motion by a touch that was not recorded.

What lies on something begins to move only if the robot or a moving body touches it, or if it goes
down by its own weight. Where the recording shows none of these, a contact or a body is missing.
Forces are not asked, only poses and who touches whom.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body
from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.runs import runs
from safestage_eval.geometry.pose import unit

Numbers = NDArray[np.floating[Any]]
Frames = NDArray[np.integer[Any]]

LIES, LIES_TURN, LIES_FOR = 2e-4, 0.0035, 0.1
"""m, rad and s: what goes and turns by less in this time lies still."""
MOVES, MOVES_TURN = 5e-3, 0.0873
"""m and rad, as ``brief_move`` and ``brief_turn``: less motion needs no explanation …"""
CREEPS, CREEPS_TURN = 1e-3, 0.0175
"""m and rad within ``LIES_FOR``: … nor does slower motion, for simulated bodies creep and roll."""
FALLS, SINKS, LOSS = 0.1, 2e-4, 1e-3
"""What its own weight moves goes down by this share of its way and by so much (m), and gets no
faster than by falling so far and this (m)."""
SHOWS = 3
"""Samples. A touch that fell between two samples mostly shows again within so many."""
TOGETHER = 0.05
"""s. Which of two bodies began to move first is not known within this time."""
GRAVITY = 9.81


class Path(NamedTuple):
    """A body: its centre of mass (T, 3) m, its orientation (T, 4), and where they are not known (T,)."""

    place: Numbers
    turn: Numbers
    lost: NDArray[np.bool_]


class Start(NamedTuple):
    """A body that lay still begins to move.

    Attributes:
        before, lay: the frames at which it certainly, and at which it last may have lain still.
        moved: frame by which what moved it shows: soon after it has moved far, or as far as it goes.
        stop: the first frame at which it lies still again.
        far: it goes or turns by ``MOVES`` or ``MOVES_TURN``.
        known: it lay still before, no gap hides how it began, and its own weight does not move it.
    """

    before: int
    lay: int
    moved: int
    stop: int
    far: bool
    known: bool


def unexplained_motion(
    t: Numbers, paths: Mapping[int, Path], pairs: Sequence[Pair],
    touches: Callable[[Pair], Frames], bodies: Sequence[Body],
) -> dict[int, int]:  # fmt: skip
    """Body → frame after which a touch that was not recorded set it in motion; most are left out.

    ``paths``: of the movable ``bodies`` but the robot's, by index. ``pairs``: of bodies that ever touch;
    ``touches`` returns the frames at which a pair does. ``t``: (T,) s.
    """
    root, robot = roots(bodies), {i for i, b in enumerate(bodies) if b.kind in ("robot", "gripper")}
    ago = np.maximum(np.searchsorted(t, t - LIES_FOR + 1e-9, "right") - 1, 0)

    @cache
    def starts(body: int) -> list[Start]:
        return list(_starts(t, ago, paths[body])) if body in paths else []

    def beside(one: int, first: int, last: int) -> Iterator[int]:
        """What touches the object that a body is a part of, and its other parts."""
        yield from (i for i in range(len(bodies)) if root[i] == root[one] and i != one)
        for pair in pairs:
            if (root[pair[0]] == root[one]) == (root[pair[1]] == root[one]):
                continue
            at = touches(pair)
            if ((at >= first) & (at <= last)).any():
                yield pair[root[pair[0]] == root[one]]

    def explained(body: int, start: Start) -> bool:
        group, todo, lies = {body}, [(body, start)], False
        while todo:
            one, its = todo.pop()
            for other in beside(one, its.before, its.moved):
                lies |= root[other] != root[one]
                if root[other] in robot:
                    return True
                if other in group or other not in paths:
                    continue
                group.add(other)
                if any(root[c] in robot for c in beside(other, its.before, its.moved)):
                    return True
                for begun in starts(other):
                    if begun.lay > its.moved or begun.stop <= its.before:
                        continue
                    if not begun.known or t[begun.lay] < t[its.lay] - TOGETHER:
                        return True
                    if t[begun.lay] <= t[its.lay] + TOGETHER:
                        todo.append((other, begun))
        return not lies  # what nothing bears has a drive of its own

    found = {}
    for body, path in paths.items():
        if np.ptp(path.place, 0).max() > MOVES / 2 or np.ptp(path.turn, 0).max() > MOVES_TURN / 8:
            far = (s for s in starts(body) if s.far and s.known and not explained(body, s))
            if (first := next(far, None)) is not None:
                found[body] = first.before
    return found


def roots(bodies: Sequence[Body]) -> list[int]:
    """Of each body the last of its chain of parents that still moves: one for all parts of an object."""
    index, found = {body.name: i for i, body in enumerate(bodies)}, []
    for i in range(len(bodies)):
        chain = [i]
        while (up := index.get(bodies[chain[-1]].parent or "", i)) not in chain and bodies[
            up
        ].movable:
            chain.append(up)
        found.append(chain[-1])
    return found


def _starts(t: Numbers, ago: Frames, path: Path) -> Iterator[Start]:
    place = path.place
    if len(place) != len(t) or len(t) < 2:
        return
    turn, every = unit(path.turn), np.arange(len(t))
    moves = t < t[0] + LIES_FOR - 1e-9
    for then in (ago, (ago + every) // 2):  # what swings comes back
        moves |= np.abs(place - place[then]).max(axis=1) > LIES
        still = np.flatnonzero(~moves)
        moves[still] = _turned(turn[still], turn[then[still]], LIES_TURN)
    soon = max(LIES_FOR, SHOWS * float(np.median(np.diff(t))))
    for first, stop in runs(moves).tolist():
        lay = first - 1
        way = np.linalg.norm(place[first:stop] - place[lay], axis=1)
        lately = np.linalg.norm(place[first:stop] - place[ago[first:stop]], axis=1) >= CREEPS
        lately |= _turned(turn[first:stop], turn[ago[first:stop]], CREEPS_TURN)
        far = (way >= MOVES) | _turned(turn[first:stop], turn[lay], MOVES_TURN)
        far &= lately
        at = int(far.argmax()) if far.any() else len(far) - 1
        moved, before = first + at, int(ago[lay])
        down = float(place[lay, 2] - place[moved, 2])
        speed = np.linalg.norm(place[moved] - place[moved - 1]) / (t[moved] - t[moved - 1])
        falls = down >= max(FALLS * way[at], SINKS) and speed**2 <= 2 * GRAVITY * (down + LOSS)
        gap = bool(path.lost[before : moved + 1].any())
        moved = int(t.searchsorted(t[moved] + soon + 1e-9)) - 1
        yield Start(before, lay, moved, stop, bool(far.any()), first > 0 and not falls and not gap)


def _turned(now: Numbers, then: Numbers, by: float) -> NDArray[np.bool_]:
    """(N,) unit quaternions that are more than an angle (rad) apart: their chord is 2 sin(θ/4)."""
    apart = [np.einsum("ij,ij->i", x, x) for x in (now - then, now + then)]
    return np.asarray(np.minimum(*apart) > (2 * np.sin(by / 4)) ** 2)
