"""Signals of how a body stands on what bears it, at chosen frames: edges, overlap, tipping."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.edge import edge_margin
from safestage_eval.geometry.footprint import overlap_xy
from safestage_eval.signals.series import Series, exact, unknown

if TYPE_CHECKING:
    from .measure import Relations

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


def overlap(relations: Relations, at: I64, a: str, b: str) -> Series:
    """(N,) share of a's footprint over b's."""
    movers = relations.signals.movers
    for name in (a, b):
        if not movers.of([name]):
            return unknown(len(at), "ratio", f"the trace has no shape of {name}")
    share = np.broadcast_to(overlap_xy(movers[a], movers[b], at), len(relations.episode))[at]
    return exact(np.where(np.isnan(share), 0.0, share), "ratio")


def edge(relations: Relations, at: I64, a: str, s: str | None = None) -> Series:
    """(N,) m; of whatever bears the body if no second is named.

    Several bearers form one surface. −∞ where nothing bears it, or where it does not stand on the
    second at all; unknown where what bears it has no upward face under it (a ball in a groove, a
    leaning board).
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
    bears = np.array(list(bearers.values())).reshape(len(bearers), frames)[:, at]
    for combination in np.unique(bears, axis=1).T:
        if not combination.any():
            continue
        there = at[(bears == combination[:, None]).all(axis=0)]
        under = [movers[names[b]] for b, on in zip(bearers, combination, strict=True) if on]
        margin = edge_margin(movers[a], under, there)[there]
        lower[there] = np.where(np.isnan(margin), -np.inf, margin)
        upper[there] = np.where(np.isnan(margin), np.inf, margin)
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


def support_margin(relations: Relations, at: I64, a: str) -> Series:
    """(N,) m from the projected COM of a and all that rests on it to the edge of its support."""
    found = _standing(relations, at, a, "length")
    return found if isinstance(found, Series) else _known(found[0], "length", found[2])


def tipping_angle(relations: Relations, at: I64, a: str) -> Series:
    """(N,) rad: the tilt at which a would topple, from the support margin and the COM's height."""
    found = _standing(relations, at, a, "angle")
    return found if isinstance(found, Series) else _known(np.arctan2(*found[:2]), "angle", found[2])


def _standing(
    relations: Relations, at: I64, a: str, dimension: str
) -> Series | tuple[F64, F64, tuple[str, ...]]:
    if relations.blind:
        return unknown(len(at), dimension, "the trace has no contact forces")
    return relations.loads.standing(relations.episode.body_index[a], at)


def _known(values: F64, dimension: str, notes: tuple[str, ...]) -> Series:
    nothing = np.isnan(values)
    lower, upper = np.where(nothing, -np.inf, values), np.where(nothing, np.inf, values)
    return Series(lower, upper, dimension, notes)
