"""How far a body stands from the edge of what it stands on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.missing_values import POSE, TWIST, around

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request
    from safestage_eval.relations.relations import Relations

I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

STILL, STILL_TURN = 0.01, 0.1
"""m/s and rad/s. What is faster neither carries on a surface nor guards its edge."""

DROP = Option(
    "edge_drop",
    "length",
    "A step down by less is no edge; the parameter edge_drop if left out, and 2 cm without one.",
    default=0.02,
    param=True,
)


@signal(
    "edge_margin", "length", args=("a", "b"), optional=1, needs=("poses", "geometry"),
    options=(DROP,), reads="", support=True, costly=True,
)  # fmt: skip
def edge_margin(request: Request) -> Interval:
    """Signed distance from the body's base to the unguarded edge of what it stands on
    (or of the second argument alone); positive when it is fully on.

    m, at N frames. Several bearers form one surface, which goes on over all that lies beside it and
    stays where it is; what stays also guards. −∞ where nothing bears the body, or where it does not stand on the
    second at all; unknown where what bears it has no upward face under it (a ball in a groove, a
    leaning board). A step down by less than ``edge_drop`` (m) is no edge.
    """
    from safestage_eval.geometry import edge

    relations, at, a = request.relations, request.at, request.bodies[0]
    frames, movers = len(relations.episode), relations.signals.movers
    for name in request.bodies:
        if not movers.of([name]):
            return request.unknown(f"the trace has no shape of {name}")
    if len(request.bodies) > 1:
        support = movers[request.bodies[1]]
        margin = np.broadcast_to(edge.edge_margin(movers[a], [support], at), frames)[at]
        return request.exact(np.where(np.isnan(margin), -np.inf, margin))
    edge_drop = request.number("edge_drop")
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
        margin = edge.edge_margin(movers[a], under, there, around=around, drop=edge_drop)[there]
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
    return Interval(lower[at], upper[at], "length", relations.caveat("supports") + notes)


def _beside(relations: Relations, a: str, at: I64) -> tuple[dict[str, Bool], Bool]:
    """Bodies whose faces may go on from those that a stands on, and whose walls guard it.

    Returns each with (N,) true where it stays where it is; and (N,) true where the pose of one is
    not known. Neither the robot nor what it holds, what rests on the body or is a part of it.
    """
    from safestage_eval.evidence.motion import derived

    episode, graph, shares = relations.episode, relations.graph, {}
    held = relations.least.held
    lost, own = np.zeros(len(at), np.bool_), graph.assemblies.of(episode.body_index[a])
    for i, body in enumerate(episode.header.bodies):
        moves = body.kind in ("robot", "gripper") and body.movable
        if not body.geoms or body.kind == "region" or moves or i in own:
            continue
        if graph.assemblies.on_robot(i):
            continue
        track = episode.tracks[body.name]
        if len(track) == 1:
            shares[body.name] = np.ones(len(at), np.bool_)
            continue
        stays = ~_in_motion(relations, body.name, at)
        away = relations.signals.gaps.of_bodies([body.name], (*POSE, *TWIST))
        if away is not None and any(derived(episode, body.name, column) for column in TWIST):
            away = around(away)
        seen = np.ones(len(at), np.bool_) if away is None else ~away[at]
        lost |= ~seen
        if i not in graph.assemblies.fixed:
            stays &= ~held(i)[at]
            stays &= ~graph.rests_on(i, episode.body_index[a], held)[at]
        shares[body.name] = stays & seen
    return {name: on for name, on in shares.items() if on.any()}, lost


def _in_motion(relations: Relations, name: str, at: I64) -> Bool:
    """(N,) faster than ``STILL`` or ``STILL_TURN``."""
    from safestage_eval.evidence.motion import angular_velocity, linear_velocity

    episode = relations.episode
    fast = [np.zeros(len(at), np.bool_)]
    for read, limit in ((linear_velocity, STILL), (angular_velocity, STILL_TURN)):
        velocity = read(episode, name)[0][at].astype(np.float64)
        fast.append((velocity**2).sum(axis=1) > limit**2)
    return np.asarray(np.logical_or.reduce(fast))
