"""Where a relation is not known because what it rests on was not measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import RELATIONS

if TYPE_CHECKING:
    from .support_facts import Support

Bool = NDArray[np.bool_]


def either(*masks: Bool | None) -> Bool | None:
    """(T,) where one of several masks is true; None, which is true nowhere, where all are."""
    out: Bool | None = None
    for mask in masks:
        if mask is not None:
            out = mask if out is None else out | mask
    return out


def lost_by(
    relations: Support,
    name: str,
    bodies: tuple[str, ...],
    get: Callable[[], Bool | None],
    get_if_touched: Callable[[], Bool],
) -> Bool | None:
    """(T,) where something that a relation rests on was not measured, as far as it was read.

    Args:
        relations: of the episode.
        name: of the relation.
        bodies: names of bodies or unions.
        get: returns the relation's truth (T,).
        get_if_touched: returns it of a relation that rests on the past, with forces, if all of which the
            force is unknown touched.
    """
    gaps, index = relations.signals.gaps, relations.episode.body_index
    rests_on = RELATIONS[name].rests_on
    if not rests_on:
        return None
    if rests_on == "past":
        truth = get()
        lost = lost_poses(relations) if relations.blind or truth is None else gaps.unseen
        if lost is not None:
            after = np.maximum.accumulate(lost)  # what it touched meanwhile stays on it
            lost = after if truth is None else (after & ~truth) | (lost & truth & after)
        if relations.blind or truth is None or not gaps.pairs:
            return lost
        return either(lost, get_if_touched() & ~truth)
    chained = rests_on == "chain"
    near = {index[b] for body in bodies for b in relations.signals.bodies(body)}
    if relations.blind or name == "inside":
        poses = [] if chained else [*bodies]
        if name == "held":
            poses += relations.signals.bodies("gripper")
        lost_here = gaps.of_bodies(poses) if poses else lost_poses(relations)
        if name == "inside" and not relations.blind:
            lost_here = either(lost_here, lost_between(relations, near, near))
        return lost_here
    if name == "supports":
        return lost_between(relations, near, near)
    if name == "held":
        fingers = {i for i, b in enumerate(relations.episode.header.bodies) if b.finger}
        lost_here = lost_between(relations, near, fingers)
        if lost_here is None:
            return None
        return either(gaps.unseen, *(relations.grip_open(body, lost_here) for body in near))
    lost_here = lost_near(relations, bodies)
    return either(lost_here, lost_poses(relations)) if name == "depends_on" else lost_here


def lost_between(
    relations: Support, first: set[int] | None, second: set[int] | None
) -> Bool | None:
    """(T,) where the force between a body of each set (None: any) is not known."""
    gaps = relations.signals.gaps
    if relations.blind:
        return lost_poses(relations)
    relations.signals.contact_sums.look(gaps.read)
    return gaps.of_pairs(
        (i, j)
        for i, j in gaps.pairs
        if ((first is None or i in first) and (second is None or j in second))
        or ((first is None or j in first) and (second is None or i in second))
    )


def lost_near(relations: Support, bodies: tuple[str, ...]) -> Bool | None:
    """(T,) where a force on one of the bodies is not known, or on what hangs together with it by touch.

    Touches of unknown force count; the robot and what stands fixed pass nothing on.
    """
    gaps, sums, index = (
        relations.signals.gaps, relations.signals.contact_sums, relations.episode.body_index,
    )  # fmt: skip
    if relations.blind:
        return lost_poses(relations)
    sums.look(gaps.read)
    if not gaps.pairs:
        return gaps.unseen
    assemblies, always = relations.graph.assemblies, np.ones(len(relations.episode), np.bool_)
    ends = assemblies.fixed | assemblies.robot
    named = {index[b] for body in bodies for b in relations.signals.bodies(body)}
    reached = dict.fromkeys(named - ends, always)
    todo = [*reached]
    while todo:
        body = todo.pop()
        parts = assemblies.of(body)
        for other in (parts | {*sums.beside(body)}) - ends - {body}:
            joined = always if other in parts else relations.may_touch(body, other)
            before = reached.get(other, ~always)
            if (gained := joined & reached[body] & ~before).any():
                reached[other] = before | gained
                todo.append(other)
    lost = [reached[body] & known for body in reached for other in sums.beside(body)
            if (known := sums.unknown(body, other)) is not None]  # fmt: skip
    return either(gaps.unseen, *lost)


def lost_poses(relations: Support) -> Bool | None:
    """(T,) where the pose of any body that relations looked at is not known."""
    return relations.signals.gaps.of_loaded()
