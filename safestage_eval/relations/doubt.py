"""Where a trace does not tell a relation: each (T,) true there, and why; None where it tells all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.runs import runs
from safestage_eval.geometry.pose import angle, matrix

from .near import NEAR

if TYPE_CHECKING:
    from .relations import Relations

STAYS = (1e-3, np.radians(1.0))
"""m, rad: what has moved by less still stands where it stood, also in a hand."""
RISES = 1e-5
"""m. What presses on its support as deep as when it stood there by itself, but for this, is borne by it."""
LIES_STILL = 0.1
"""s. What stayed for so long does not begin to move by itself."""
LEAVES = 0.2
"""s. What is lifted is off what it stood on sooner; what takes longer may hang or stand all the while."""

Bool = NDArray[np.bool_]
Doubt = tuple[Bool, str]


def may_be_caught(relations: Relations, body: str, on: str, wanted: Bool | None) -> Doubt | None:
    """Doubt where bodies within a hair's breadth, which carry nothing yet, may hold the body up or not."""
    if relations.lacking("depends_on", (body, on)):
        return None
    open_ = relations.caught(body, on, wanted)
    if not open_.any():
        return None
    return open_, (
        f"whether {body} falls without {on} hangs on what is within {NEAR * 1e3:g} mm "
        "and carries nothing yet"
    )


def may_lean(relations: Relations, body: str, on: str) -> Doubt | None:
    """Without contact forces a body that touches another may lean on it, or be weighed down by it.

    And so on over all that this one touches: whether it would fall hangs on friction and weights.
    """
    truth = relations.get("depends_on", (body, on))
    least = relations.decide("depends_on", [body, on], held=relations.may_be_held)
    if truth is None or least is None:
        return None
    index = relations.episode.body_index
    least = least & ~relations.graph.supported_without(index[body], index[on])
    leans = _may_hang_on(relations, index[body], index[on]) & ~truth
    if not (leans | (truth & ~least)).any():
        return None
    how = f"needs {on}" if leans.any() else f"still rests on {on}, or is held"
    return leans | (truth & ~least), f"without contact forces it is not known whether {body} {how}"


def _may_hang_on(relations: Relations, body: int, on: int) -> Bool:
    """(T,) a chain of touches joins the two, over objects that nothing holds.

    What leans on a can falls with what the can stands on; and what stands on a board may be the
    weight without which it tips.
    """
    bodies, frames = relations.episode.header.bodies, len(relations.episode)
    may = {on: np.ones(frames, np.bool_)}
    todo = [on]
    while todo:
        lower = todo.pop()
        through = may[lower] if lower == on else may[lower] & ~relations.held(lower)
        for upper in relations.proximity.beside(lower):
            free = bodies[upper].kind == "object" and bodies[upper].movable
            if upper == on or (upper != body and (lower == body or not free)):
                continue
            gained = through & relations.proximity.touching(upper, lower)
            before = may.get(upper, np.zeros(frames, np.bool_))
            if (gained & ~before).any():
                may[upper] = before | gained
                todo.append(upper)
    return may.get(body, np.zeros(frames, np.bool_))


def may_be_in_the_grip(relations: Relations, name: str, bodies: Sequence[str]) -> Doubt | None:
    """Doubt where the hand stays with a body that was put down, and perhaps still holds it."""
    truth = relations.get(name, bodies)
    may_be = relations.may_be_grasped if name == "held" else relations.may_be_held
    most = relations.decide(name, list(bodies), held=may_be)
    if truth is None or most is None:
        return None
    if name == "carried":
        most = most | _taken_along(relations, relations.episode.body_index[bodies[0]])
    if not (most & ~truth).any():
        return None
    return (
        most & ~truth,
        f"without contact forces it is not known when {bodies[0]} is grasped and let go",
    )


def may_be_leaned_on(relations: Relations, name: str) -> Doubt | None:
    """Without forces what is near may press or not; so may what perhaps is in the hand."""
    body = relations.episode.body_index[name]
    near = np.zeros(len(relations.episode), np.bool_)
    for other, has in relations.hands_at(body, relations.may_be_held).items():
        near |= has & relations.proximity.touching(body, other)
    open_ = near & ~relations.leaned_on(body, relations.held)
    if not open_.any():
        return None
    return open_, f"without contact forces it is not known whether the robot presses on {name}"


def may_hang_from_the_grip(relations: Relations, name: str, bodies: Sequence[str]) -> Doubt | None:
    """Doubt where a hand may hold a body, which then may hang from it instead of resting on something."""
    truth = relations.get(name, bodies)
    if truth is None or not truth.any():
        return None
    index, graph = relations.episode.body_index, relations.graph

    def taken_along(body: int) -> Bool:
        return _taken_along(relations, body)

    if name == "supports":
        open_ = truth & taken_along(index[bodies[1]])
    else:
        open_ = truth & ~graph.supported(index[bodies[0]], taken_along)
    if not open_.any():
        return None
    return open_, f"without contact forces it is not known whether {bodies[-1]} hangs from the hand"


def _taken_along(relations: Relations, body: int) -> Bool:
    """(T,) a hand may be taking it away, and it still touches what it stood on.

    From when it is no longer where it stood before the hand can have had it, until it is off, unless
    that is soon. What never comes off while the hand may have it does not hang from it as long as it
    slides upright on what bore it there, as deep as then.
    """
    held = relations.may_be_held(body)
    track = relations.episode.track(relations.episode.header.bodies[body].name)
    borne = relations.graph.supported(body)
    out = np.zeros(len(held), np.bool_)
    for start, end in runs(held) if len(track) == len(held) else ():
        stop = start + int(np.append(borne[start:end], False).argmin())
        before = max(start - 1, 0)
        position, orientation = track.position[start:stop], track.orientation[start:stop]
        gone = np.linalg.norm(position - track.position[before], axis=1) > STAYS[0]
        gone |= angle(orientation, track.orientation[before]) > STAYS[1]
        if start > 0 and stop == end:  # how it stood without the hand is known, and it stays on
            rows = start + np.flatnonzero(gone)
            gone[rows - start] = ~_slides(relations, body, before, rows)
        first = start + int(np.append(gone, True).argmax())
        if relations.episode.clock.seconds(first, stop) >= LEAVES:
            out[first:stop] = True
    return out


def _slides(relations: Relations, body: int, before: int, rows: NDArray[np.intp]) -> Bool:
    """(N,) it is as upright on something as it was ``before``, and presses on it as it did."""
    name = relations.episode.header.bodies[body].name
    turned = matrix(relations.episode.track(name).orientation[[before, *rows]])
    up = np.einsum("nij,j->ni", turned, turned[0].T @ (0.0, 0.0, 1.0))
    upright = np.flatnonzero(up[1:, 2] >= np.cos(STAYS[1]))
    out = np.zeros(len(rows), np.bool_)
    for bearer, bears in relations.graph.bearers(body).items():
        at = upright[bears[rows[upright]]] if bears[before] else upright[:0]
        if len(at):
            then = relations.proximity.gap(body, bearer, np.array([before]))
            now = relations.proximity.gap(body, bearer, rows[at])
            out[at] |= now.upper <= then.lower + RISES
    return out


def may_have_been_touched(relations: Relations, body: str) -> Doubt | None:
    """Between two frames, or without shapes, the robot may have touched what no frame shows."""
    index, frames = relations.episode.body_index[body], np.arange(len(relations.episode))
    sure, perhaps = relations.causes.since(index), relations.causes.perhaps_since(index)
    open_ = (frames >= perhaps) & (frames < sure)
    if not open_.any():
        return None
    return open_, f"it is not known whether the robot, or what it moved, touched {body}"


def may_move_by_itself(relations: Relations, body: str) -> Doubt | None:
    """Where the robot's touch is not certain, and the body has not lain still yet: the scene may be settling.

    What has lain still for ``LIES_STILL`` does not begin to move by itself.
    """
    episode = relations.episode
    index, t, frames = episode.body_index[body], episode.t, np.arange(len(episode))
    sure = len(t) if relations.lacking("caused") else relations.causes.since(index)
    track = episode.track(body)
    if len(track.position) != len(t):
        return None
    ago = np.maximum(np.searchsorted(t, t - LIES_STILL - 1e-9), 0)
    way = np.linalg.norm(track.position - track.position[ago], axis=1)
    still = (way <= STAYS[0]) & (angle(track.orientation, track.orientation[ago]) <= STAYS[1])
    still &= t >= t[0] + LIES_STILL
    rested = int(still.argmax()) if still.any() else len(t)
    open_ = (frames < sure) & (frames < rested)
    may = relations.get("may_be_caused", (body,))
    if may is not None:
        open_ &= may
    if not open_.any():
        return None
    return open_, f"it is not known whether the robot, or what it moved, touched {body}"


def may_be_borne(relations: Relations, body: str, container: str) -> Doubt | None:
    """Doubt where a body looks over the rim: it is inside if the container bears it, which is unknown."""
    truth = relations.get("inside", (body, container))
    sure = relations.lies_inside(body, container, np.zeros(len(relations.episode), np.bool_))
    if truth is None or sure is None or not (truth & ~sure).any():
        return None
    return truth & ~sure, f"it is not known whether {container} bears {body}"


def may_be_too_weak(relations: Relations, name: str, bodies: Sequence[str]) -> Doubt | None:
    """A force may bear a body of unknown mass, or be too weak to: more edges never undo these."""
    if not (relations.unweighed or relations.faint):
        return None
    truth = relations.get(name, bodies)
    if truth is None or not truth.any():
        return None
    sure = relations.decide(name, list(bodies), relations.sure_graph)
    if sure is None or not (truth & ~sure).any():
        return None
    if relations.unweighed:
        masses = ", ".join(relations.unweighed)
        return truth & ~sure, f"the trace has no mass of {masses}: what bears it is not known"
    light = ", ".join(relations.faint)
    return truth & ~sure, f"what bears {light} is less than the rounding of the recorded forces"
