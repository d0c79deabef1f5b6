"""Decide whether a gripper holds a body: by forces, by shapes, or by how the two move together."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle, relative

from .proximity import Proximity

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

PRESSES = 0.2
"""N. A finger that presses less holds nothing …"""
PRESSES_SHARE = 0.05
"""… nor one that presses less than this share of the body's weight."""

STAYS = 5e-3
"""m. A held body's origin stays within this of where it was in the gripper's frame …"""
STAYS_TURN = 0.1
"""rad. … and its orientation within this."""
CARRIED_OFF = 0.02
"""m. The gripper moves by at least this meanwhile: what merely lies near a still hand is not held."""
TURNED_ALONG = 0.15
"""rad. What turns with the gripper by as much may be held, too."""
HOVERS = 0.1
"""s. What stays so long beside the gripper and rests on nothing may be held: it does not fall."""
FALLS = 0.03
"""m. What goes down by so much more within ``HOVERS`` than in as long before, faster and faster, may fall."""
MOVES = 1e-4
"""m. A gripper that goes less than this in one frame rests …"""
TURNS = 1e-3
"""rad. … if it turns by less than this, too."""


class Grip(NamedTuple):
    """(T,) each, about one body.

    Attributes:
        sure: it is certainly held.
        perhaps: it may be: from when it first went along.
        grasped: the hand stays with it, and takes it along sooner or later: it may be about to.
    """

    sure: Bool
    perhaps: Bool
    grasped: Bool


def by_pressure(episode: Episode, body: int, beside: Iterable[int]) -> Bool:
    """(T,) true where fingers of one gripper press on the body from opposing sides.

    Each side with at least ``PRESSES`` and ``PRESSES_SHARE`` of its weight; the mean normals, weighted
    by force, are at least 90° apart. A fist that pushes and a finger of each of two arms hold nothing.

    Args:
        episode: whose bodies these are.
        body: index into ``header.bodies``.
        beside: the bodies that ever touch it.
    """
    frames = len(episode)
    weight = (episode.header.bodies[body].mass or 0.0) * float(
        np.linalg.norm(episode.header.gravity)
    )
    least = max(PRESSES, PRESSES_SHARE * weight)
    held = np.zeros(frames, np.bool_)
    for sides in _grippers(episode, body, beside).values():
        if len(sides) < 2:
            continue
        pressed = {side: _pressure(episode, body, fingers) for side, fingers in sides.items()}
        (left, inward), (right, outward) = pressed["left"], pressed["right"]
        opposed = np.einsum("ti,ti->t", inward, outward) <= 0
        held |= (left >= least) & (right >= least) & opposed
    return held


def may_differ(episode: Episode, body: int, beside: Iterable[int], at: Bool, held: Bool) -> Bool:
    """(T,) true where fingers that press harder than recorded would change what ``by_pressure`` says.

    They cannot where one side touches nothing, or no two normals of the sides are at least 90° apart; nor
    where it is ``held`` (T,) and all of them are.

    Args:
        episode: whose bodies these are.
        body: index into ``header.bodies``.
        beside: the bodies that ever touch it.
        at: (T,) frames at which they may press harder.
        held: (T,) what ``by_pressure`` says.
    """
    out = np.zeros(len(episode), np.bool_)
    for sides in _grippers(episode, body, beside).values():
        if len(sides) < 2:
            continue
        (when, left), (then, right) = (_inward(episode, body, f) for f in sides.values())
        frames = np.intersect1d(when, then[at[then] & ~out[then]])
        ends = [np.searchsorted(x, [frames, frames + 1]).T.tolist() for x in (when, then)]
        for frame, (a, b), (c, d) in zip(frames.tolist(), *ends, strict=True):
            opposed = left[a:b] @ right[c:d].T <= 0
            out[frame] = opposed.any() and not (held[frame] and opposed.all())
    return out


def _inward(episode: Episode, body: int, fingers: Iterable[int]) -> tuple[NDArray[np.intp], F64]:
    """Of all contacts with fingers the frames (C,), in order, and the normals (C, 3) into the body."""
    frames, normals = [np.zeros(0, np.intp)], [np.zeros((0, 3))]
    for finger in fingers:
        pair = (min(finger, body), max(finger, body))
        frame, normal = episode.contacts.of_pair(pair, "frame", "normal")
        frames.append(frame)
        normals.append((1.0 if body > finger else -1.0) * normal)
    order = np.argsort(np.concatenate(frames), kind="stable")
    return np.concatenate(frames)[order], np.concatenate(normals)[order]


def _pressure(episode: Episode, body: int, fingers: Iterable[int]) -> tuple[F64, F64]:
    """(T,) N, how hard the fingers press on the body; (T, 3) N, the sum of these normal forces."""
    frames = len(episode)
    total, vector = np.zeros(frames), np.zeros((frames, 3))
    for finger in fingers:
        pair = (min(finger, body), max(finger, body))
        frame, normal, force = episode.contacts.of_pair(pair, "frame", "normal", "force")
        normal = normal.astype(np.float64)
        along = np.einsum("ci,ci->c", force.astype(np.float64), normal)
        sign = 1.0 if body > finger else -1.0
        total += np.bincount(frame, np.abs(along), frames)
        for i in range(3):
            vector[:, i] += np.bincount(frame, sign * np.abs(along) * normal[:, i], frames)
    return total, vector


def _grippers(
    episode: Episode, body: int, beside: Iterable[int]
) -> dict[str, dict[str, list[int]]]:
    """Gripper → side → the fingers of that side that ever touch the body."""
    grippers: dict[str, dict[str, list[int]]] = {}
    for other in beside:
        side = episode.header.bodies[other].finger
        if side is not None and other != body:
            grippers.setdefault(gripper_of(episode, other), {}).setdefault(side, []).append(other)
    return grippers


def gripper_of(episode: Episode, finger: int) -> str:
    """A name for the gripper that a finger belongs to.

    The last body of kind ``gripper`` up its chain of parents that is no finger, else what the finger
    is jointed to. Without a stated parent: the only gripper, or the name but for its side.
    """
    bodies, about = episode.bodies, episode.header.bodies[finger]
    names = [about.name]
    while (above := bodies[names[-1]].parent) in bodies and above not in names:
        names.append(above)
    line = [bodies[name] for name in names]
    hands = [b.name for b in line if b.kind == "gripper" and b.finger is None]
    if hands:
        return hands[-1]
    palm = next((b.name for b in line if b.finger is None), None)
    if palm is not None:
        return palm
    fingers = [b for b in episode.header.bodies if b.finger is not None]
    if all(sum(b.finger == side for b in fingers) <= 1 for side in ("left", "right")):
        return ""
    head, _, tail = line[-1].name.rpartition(str(about.finger))
    return f"{head}*{tail}"


def by_fingers(episode: Episode, body: int, proximity: Proximity) -> Grip:
    """Where a left and a right finger of one gripper touch the body, and have it between them.

    What both touch on one side, as a fist that pushes does, is perhaps held.

    Args:
        episode: whose bodies these are.
        body: index into ``header.bodies``.
        proximity: who touches whom.
    """
    held, touched = (np.zeros(len(episode), np.bool_) for _ in range(2))
    for sides in _grippers(episode, body, proximity.beside(body)).values():
        for left, right in product(sides.get("left", ()), sides.get("right", ())):
            both = proximity.touching(body, left) & proximity.touching(body, right)
            rows = np.flatnonzero(both & ~held)
            if len(rows):
                held[rows] = proximity.between(body, left, right, rows)
            touched |= both
    return Grip(held, touched, touched)


def by_motion(episode: Episode, body: int, hand: str, supported: Bool) -> Grip:
    """Where the body goes along with the gripper.

    The episode is cut where the body's pose in the gripper's frame has left that at the start of
    the stretch. In a stretch in which the gripper moves away by ``CARRIED_OFF`` the body is held
    as long as nothing else bears it and it does not go down as what falls; while it rests on something
    it may be pushed. After that a hand that stays may still have it in its grip or not; so may one
    that merely turns with it, and one that has not gone far yet, with what nothing else bears.

    Args:
        episode: where both move.
        body: index into ``header.bodies``.
        hand: the gripper's name.
        supported: (T,) where something but the robot bears the body.
    """
    name, frames = episode.header.bodies[body].name, len(episode)
    track, grip = episode.track(name), episode.track(hand)
    place, turn = relative(grip.position, grip.orientation, track.position, track.orientation)
    path = grip.position.astype(np.float64)
    goes = np.linalg.norm(np.diff(path, axis=0), axis=1) > MOVES
    goes |= angle(grip.orientation[1:], grip.orientation[:-1]) > TURNS
    kept = ~supported & ~falling(episode.t, track.position[:, 2])
    held, perhaps, grasped = (np.zeros(frames, np.bool_) for _ in range(3))
    start = 0
    while start < frames:
        left = np.linalg.norm(place[start:] - place[start], axis=1) > STAYS
        left |= angle(turn[start:], turn[start]) > STAYS_TURN
        stop = start + int(left.argmax()) if left.any() else frames
        away = np.linalg.norm(path[start:stop] - path[start], axis=1).max()
        turned = angle(grip.orientation[start:stop], grip.orientation[start]).max()
        moves = np.flatnonzero(goes[start : max(stop - 1, start)])
        if (away >= CARRIED_OFF or turned >= TURNED_ALONG) and len(moves):
            first, last = start + int(moves[0]), start + int(moves[-1]) + 2
            if away >= CARRIED_OFF:
                held[start:stop] = kept[start:stop]  # what still rests on something may be pushed
            perhaps[first:last] = True
            perhaps[start:stop] |= ~supported[start:stop]
            perhaps[first:stop] = True
            grasped[start:stop] = True
        elif episode.clock.seconds(start, stop) >= HOVERS and not supported[start:stop].all():
            perhaps[start:stop] |= ~supported[start:stop]
            grasped[start:stop] = True
        start = stop
    return Grip(held, perhaps, grasped)


def falling(t: F64, height: NDArray[np.floating]) -> Bool:
    """(T,) where a body goes down as what falls: by ``FALLS`` more than it did before.

    Args:
        t: s, (T,).
        height: m, (T,) or (1,) of a body that stays.
    """
    z = np.broadcast_to(np.asarray(height, np.float64), len(t))
    out = np.zeros(len(t), np.bool_)
    if len(t) < 2 or np.ptp(z) < FALLS:
        return out
    lag = np.maximum(HOVERS, np.diff(t, prepend=t[0]))
    then, before = np.interp(t - lag, t, z), np.interp(t - 2 * lag, t, z)
    gained = (then - z) - np.maximum(before - then, 0.0) >= FALLS
    middle = np.interp(t - lag / 2, t, z)
    gained &= (2 * middle - then - z >= FALLS / 2) | (2 * np.diff(t, prepend=t[0]) > HOVERS)
    for now in np.flatnonzero(gained):
        out[np.searchsorted(t, t[now] - lag[now]) : now + 1] = True
    return out


def gripper_frame(episode: Episode) -> str | None:
    """The body that carries the tool centre point, or the nearest that bears both fingers.

    Else the only body of the gripper, if there is just one.
    """
    bodies = episode.bodies
    tools = [body.name for body in bodies.values() if body.tcp is not None]
    if tools:
        return tools[0] if len(tools) == 1 else None
    lines = [_line(episode, body.name) for body in bodies.values() if body.finger is not None]
    if not lines:
        grippers = [b.name for b in bodies.values() if b.kind == "gripper" and b.movable]
        return grippers[0] if len(grippers) == 1 else None
    return next((name for name in lines[0] if all(name in line for line in lines)), None)


def _line(episode: Episode, name: str) -> list[str]:
    """A body and all that it hangs on, from near to far."""
    line: list[str] = []
    following: str | None = name
    while following in episode.bodies and following not in line:
        line.append(following)
        following = episode.bodies[following].parent
    return line
