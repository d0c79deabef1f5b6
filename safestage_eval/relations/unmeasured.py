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
    relations: Support, name: str, bodies: tuple[str, ...], get: Callable[[], Bool | None]
) -> Bool | None:
    """(T,) where something that a relation rests on was not measured, as far as it was read.

    ``get``: returns the relation's truth (T,).
    """
    gaps, index = relations.signals.gaps, relations.episode.body_index
    rests_on = RELATIONS[name].rests_on
    if not rests_on:
        return None
    if rests_on == "past":
        lost = lost_between(relations, None, None)
        if lost is None:
            return None
        truth = get()
        after = np.maximum.accumulate(lost)  # what it touched meanwhile stays on it
        return after if truth is None else (after & ~truth) | (lost & truth & after)
    chained = rests_on == "chain"
    near = (
        None if chained else {index[b] for body in bodies for b in relations.signals.bodies(body)}
    )
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
        return lost_between(relations, near, None)
    lost_here = lost_between(relations, None, None)
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


def lost_poses(relations: Support) -> Bool | None:
    """(T,) where the pose of any body that relations looked at is not known."""
    return relations.signals.gaps.of_loaded()
