"""Signals of how a body stands on what bears it, at chosen frames: edges, overlap, tipping."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.edge import edge_margin
from safestage_eval.geometry.footprint import overlap_xy
from safestage_eval.signals.gaps import POSE, TWIST
from safestage_eval.signals.motion import angular_velocity, linear_velocity
from safestage_eval.signals.options import DEFAULT_DROP
from safestage_eval.signals.series import Series, exact, unknown

if TYPE_CHECKING:
    from .measure import Relations

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

STILL, STILL_TURN = 0.01, 0.1
"""m/s and rad/s. What is faster neither carries on a surface nor guards its edge."""


def overlap(relations: Relations, at: I64, a: str, b: str) -> Series:
    """(N,) share of a's footprint over b's."""
    movers = relations.signals.movers
    for name in (a, b):
        if not movers.of([name]):
            return unknown(len(at), "ratio", f"the trace has no shape of {name}")
    share = np.broadcast_to(overlap_xy(movers[a], movers[b], at), len(relations.episode))[at]
    return exact(np.where(np.isnan(share), 0.0, share), "ratio")


def edge(
    relations: Relations, at: I64, a: str, s: str | None = None, edge_drop: float = DEFAULT_DROP
) -> Series:
    """(N,) m; of whatever bears the body if no second is named, else of the second alone.

    Several bearers form one surface, which goes on over all that lies beside it and stays where it
    is; what stays also guards. −∞ where nothing bears the body, or where it does not stand on the
    second at all; unknown where what bears it has no upward face under it (a ball in a groove, a
    leaning board).

    ``edge_drop``: m, a step down by less is no edge.
    """
    frames, movers = len(relations.episode), relations.signals.movers
    for name in (a, s):
        if name is not None and not movers.of([name]):
            return unknown(len(at), "length", f"the trace has no shape of {name}")
    if s is not None:
        margin = np.broadcast_to(edge_margin(movers[a], [movers[s]], at), frames)[at]
        return exact(np.where(np.isnan(margin), -np.inf, margin), "length")
    names = [body.name for body in relations.episode.header.bodies]
    known = relations.graph.bearers(relations.episode.body_index[a])
    bearers = {b: on for b, on in known.items() if movers.of([names[b]])}
    unseen = {names[b]: on for b, on in known.items() if b not in bearers and on[at].any()}
    lower, upper = np.full(frames, -np.inf), np.full(frames, -np.inf)
    borne = at[
        np.logical_or.reduce([np.zeros(len(at), np.bool_), *(b[at] for b in bearers.values())])
    ]
    beside, lost = _beside(relations, a, borne)
    roles = np.array([*(on[borne] for on in bearers.values()), *beside.values()], np.int8)
    roles = roles.reshape(len(bearers) + len(beside), len(borne))
    for combination in np.unique(roles, axis=1).T:
        there = borne[(roles == combination[:, None]).all(axis=0)]
        bearing, staying = np.split(combination.astype(bool), [len(bearers)])
        under = [movers[names[b]] for b, on in zip(bearers, bearing, strict=True) if on]
        around = [movers[name] for name, on in zip(beside, staying, strict=True) if on]
        around = [mover for mover in around if mover not in under]
        margin = edge_margin(movers[a], under, there, around=around, drop=edge_drop)[there]
        lower[there] = np.where(np.isnan(margin), -np.inf, margin)
        upper[there] = np.where(np.isnan(margin), np.inf, margin)
    upper[borne[lost]] = np.inf  # what cannot be seen may go on from the edge, or guard it
    for b, on in bearers.items():
        away = relations.signals.gaps.of_body(names[b], POSE)
        if away is not None:
            lower[on & away], upper[on & away] = -np.inf, np.inf
    bare = np.isneginf(lower) & np.isposinf(upper)
    for on in unseen.values():  # it can only reach further than what is seen
        upper[on] = np.inf
    notes = (f"what bears {a} has no upward face under it",) if bare[at].any() else ()
    if unseen:
        notes = (*notes, f"the trace has no shape of {', '.join(unseen)}, which bears {a}")
    if a in relations.unweighed and any(on[at].any() for on in known.values()):
        lower[at] = -np.inf
        notes = (*notes, f"the trace has no mass of {a}: whether it is borne is not told")
    return Series(lower[at], upper[at], "length", relations.caveat("supports") + notes)


def _beside(relations: Relations, a: str, at: I64) -> tuple[dict[str, Bool], Bool]:
    """Bodies whose faces may go on from those that a stands on, and whose walls guard it.

    Returns each with (N,) true where it stays where it is; and (N,) true where the pose of one is
    not known. Neither the robot nor what it holds, what rests on the body or is a part of it.
    """
    episode, graph, found = relations.episode, relations.graph, {}
    lost, own = np.zeros(len(at), np.bool_), graph.assemblies.of(episode.body_index[a])
    for i, body in enumerate(episode.header.bodies):
        moves = body.kind in ("robot", "gripper") and body.movable
        if not body.geoms or body.kind == "region" or moves or i in own:
            continue
        if graph.assemblies.on_robot(i):
            continue
        track = episode.tracks[body.name]
        if len(track) == 1:
            found[body.name] = np.ones(len(at), np.bool_)
            continue
        stays = ~_in_motion(relations, body.name, at)
        away = relations.signals.gaps.of_body(body.name, (*POSE, *TWIST))
        seen = np.ones(len(at), np.bool_) if away is None else ~away[at]
        lost |= ~seen
        if i not in graph.assemblies.fixed:
            stays &= ~relations.held(i)[at]
            stays &= ~graph.rests_on(i, episode.body_index[a], relations.held)[at]
        found[body.name] = stays & seen
    return {name: on for name, on in found.items() if on.any()}, lost


def _in_motion(relations: Relations, name: str, at: I64) -> Bool:
    """(N,) faster than ``STILL`` or ``STILL_TURN``."""
    episode = relations.episode
    fast = [np.zeros(len(at), np.bool_)]
    for read, limit in ((linear_velocity, STILL), (angular_velocity, STILL_TURN)):
        velocity = read(episode, name)[0][at].astype(np.float64)
        fast.append((velocity**2).sum(axis=1) > limit**2)
    return np.asarray(np.logical_or.reduce(fast))


def support_margin(relations: Relations, at: I64, a: str) -> Series:
    """(N,) m from the projected COM of a and all that rests on it to the edge of its support."""
    if relations.blind:
        return _unseen(at, "length")
    found = relations.loads.standing(relations.episode.body_index[a], at)
    lower = np.where(np.isnan(found.margin), -np.inf, found.margin)
    return Series(lower, found.most, "length", found.notes)


def tipping_angle(relations: Relations, at: I64, a: str) -> Series:
    """(N,) rad: the tilt at which a would topple, from the support margin and the COM's height."""
    if relations.blind:
        return _unseen(at, "angle")
    found = relations.loads.standing(relations.episode.body_index[a], at)
    tilt = np.arctan2(found.margin, found.height)
    nothing = np.isnan(tilt)
    lower, upper = np.where(nothing, -np.inf, tilt), np.where(nothing, np.inf, tilt)
    return Series(lower, upper, "angle", found.notes)


def _unseen(at: I64, dimension: str) -> Series:
    return unknown(len(at), dimension, "the trace has no contact forces")
