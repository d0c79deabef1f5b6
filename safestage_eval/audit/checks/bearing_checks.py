"""Checks of recordings without contacts: whether shapes and poses bear what rests, rises or is held."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.start import ROBOT, Start
from safestage_eval.doubts.check_registry import check
from safestage_eval.episode import Body
from safestage_eval.episode.invariants import all_finite
from safestage_eval.episode.runs import runs
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.polygon import polygon_margin
from safestage_eval.geometry.pose import rotate
from safestage_eval.geometry.shape import BodyShape

F64 = NDArray[np.float64]

APART = 2e-3
"""m; what is further apart than this bears nothing."""

FAR = 0.5
"""m within which the body is looked for that comes nearest."""

LASTS = 0.25
"""s that a body must be in the air."""

FALLS = 0.5
"""Share of gravity from which on a body in the air is falling."""

LOOKS = 400
"""Frames at the most at which distances are measured."""

SAMPLES = 12
"""Frames at which overlaps are looked for."""

DEEP = 8e-3
"""m; pads and soft objects overlap by less while they hold."""

LOWEST = 3e-3
"""m above its lowest point, within which a body touches what it stands on."""

BEYOND = 5e-3
"""m by which a centre lies outside what a body stands on, where it cannot rest so."""

STILL = 2e-3
"""m by which a body at rest moves before the robot comes."""


@check(
    "AUD211",
    "error",
    title="nothing bears a body that rises or stays in the air",
    why="Held, carried, supported and dropped are read from shapes where no contacts are recorded: a "
    "finger that is a centimetre away holds nothing, and what it carries counts as fallen.",
    example="a cube that is lifted between two pads, each 1 cm away from it",
    unless=("AUD101", "AUD111", "AUD113", "AUD131", "AUD201", "AUD202", "AUD204"),
)
def borne_by_nothing(start: Start) -> Iterator[Defect]:
    """Looks for free bodies that are further than 2 mm from everything for 0.25 s, and do not fall.

    Without recorded contacts, and where every part of the robot and of the scene has a shape.
    """
    if not start.blind or not start.robot:
        return
    if any(body.unseen or "links" in body.untold for body in start.solid):
        return
    t = start.episode.t
    frames = np.unique(np.linspace(0, len(t) - 1, min(len(t), LOOKS)).astype(int))
    gravity = -start.header.gravity[2]
    for body in start.moved:
        if not np.isfinite(start.episode.track(body.name).position).all():
            continue
        spans = _in_air(start, body, frames)
        spans = [s for s in spans if not _falls(start, body, s, gravity)]
        if not spans:
            continue
        first, last = spans[0]
        near = _nearest(start, body, first, last)
        apart = f"{near[0]!r} comes nearest, {1000 * near[1]:.0f} mm away" if near else ""
        often = f", and {len(spans) - 1} times more" if len(spans) > 1 else ""
        yield Defect(
            f"{body.name!r} is in the air from {t[first]:.2f} to {t[last]:.2f} s{often} and does not "
            f"fall, though nothing is within {1000 * APART:.0f} mm of it"
            f"{f'; {apart}' if apart else f', or within {100 * FAR:.0f} cm'}.",
            f"correct the shape or the place of {near[0]!r}" if near
            else "record the body that holds it, with its shape",
            "the shape is too small, or not where its body has it" if near
            else "what holds it is not recorded",
            bodies=(body.name, *((near[0],) if near else ())),
            field="bodies.geoms",
            time=float(t[first]),
        )  # fmt: skip


def _in_air(start: Start, body: Body, frames: NDArray[np.intp]) -> list[tuple[int, int]]:
    """First and last frame of each stretch of ``LASTS`` over which nothing is near a body."""
    t = start.episode.t
    others = [b for b in start.solid if b is not body and b.geoms]
    there = [start.mover(other, frames) for other in others]
    near = clearance_series([start.mover(body, frames)], there, APART)
    spans = [(int(frames[a]), int(frames[b - 1])) for a, b in runs(near.lower >= APART - 1e-6)]
    return [(a, b) for a, b in spans if b - a >= 3 and t[b] - t[a] >= LASTS]


def _falls(start: Start, body: Body, span: tuple[int, int], gravity: float) -> bool:
    """Whether it falls or flies during the first ``LASTS`` of a stretch, by the fit of a parabola."""
    t = start.episode.t
    stop = min(span[1], max(span[0] + 3, int(np.searchsorted(t, t[span[0]] + LASTS))))
    at = slice(span[0], stop + 1)
    height = start.episode.track(body.name).position[at, 2].astype(float)
    upward = 2 * np.polynomial.polynomial.polyfit(t[at] - t[span[0]], height, 2)[2]
    return bool(upward < -FALLS * gravity)


def _nearest(start: Start, body: Body, first: int, last: int) -> tuple[str, float] | None:
    """The body that comes nearest in the middle of a stretch, and m between them; None beyond ``FAR``.

    What moves along with it comes before what it passes.
    """
    frames = np.unique(np.linspace(first, last, 5).astype(int))
    mine, gaps = start.mover(body, frames), dict[str, float]()
    for other in start.solid:
        if other is body or not other.geoms:
            continue
        apart = clearance_series([mine], [start.mover(other, frames)], FAR).upper
        if np.isfinite(apart).all() and (np.ptp(apart) < APART or other.kind in ROBOT):
            gaps[other.name] = float(np.median(apart))
    return min(gaps.items(), key=lambda one: one[1], default=None)


@check(
    "AUD212",
    "error",
    title="shapes go through each other",
    why="Distances between the two are negative, and touches, supports and grasps that follow from "
    "them never were.",
    example="a finger whose pad is modelled 1 cm too thick",
    unless=("AUD101", "AUD111", "AUD113", "AUD131", "AUD201", "AUD210"),
)
def through_each_other(start: Start) -> Iterator[Defect]:
    """Measures how deep shapes overlap at twelve frames, where no contacts are recorded; 8 mm pass."""
    if not start.blind:
        return
    t, deepest = start.episode.t, dict[tuple[str, str], tuple[float, int]]()
    for frame in np.unique(np.linspace(0, len(t) - 1, SAMPLES).astype(int)).tolist():
        for a, b in start.overlaps(DEEP, frame):
            depth = start.depth(a, b, frame)
            if depth > max(DEEP, deepest.get((a.name, b.name), (0.0, 0))[0]):
                deepest[a.name, b.name] = depth, frame
    for (a_name, b_name), (depth, frame) in deepest.items():
        yield Defect(
            f"{a_name!r} and {b_name!r} overlap by {1000 * depth:.0f} mm at {t[frame]:.2f} s.",
            "correct the shape or the place of one of them",
            "a shape is too large, or not where its body has it",
            bodies=(a_name, b_name),
            field="bodies.geoms",
            time=float(t[frame]),
        )


@check(
    "AUD210",
    "error",
    title="something rests as nothing can",
    why="Tilt, support and what would topple are judged by an orientation that the body never had.",
    example="a box that rests on one of its edges, tilted by 30° against the table",
    unless=("AUD101", "AUD111", "AUD113", "AUD206"),
)
def rests_tilted(start: Start) -> Iterator[Defect]:
    """Looks for objects at rest whose middle is not above the lowest 3 mm of their shape.

    Only of those that at most one other body is near, on which alone they would stand.
    """
    for body in start.moved:
        place = start.position(body.name)
        if not np.isfinite(place).all() or np.ptp(place, axis=0).max() > STILL:
            continue
        beyond, mine = _beyond(start, body), start.boxes(body)
        if beyond is None or mine is None or beyond < BEYOND or _company(start, body, mine) > 1:
            continue
        up, tilt = start.up(body), ""
        if up is not None:
            angle = np.degrees(np.arccos(np.clip(up, -1, 1)))
            tilt = f", tilted by {angle:.0f}° against its support"
        yield Defect(
            f"{body.name!r} rests on an edge or a corner{tilt}: its middle lies {1000 * beyond:.0f} mm "
            "beside what it stands on.",
            "write orientations as w, x, y, z, from the body's frame to the world, and its shape in "
            "that frame",
            "the orientation is read in another order, or its shape is turned against its frame",
            bodies=(body.name,),
            field="bodies.orientation",
            time=start.begins,
        )


def _beyond(start: Start, body: Body) -> float | None:
    """M by which the middle of a body lies beside its lowest points; None of planes, and where not measured."""
    shape = BodyShape.build(body, start.episode.meshes)
    parts = shape.polytopes
    track = start.episode.track(body.name)
    if any(part is None for part in parts) or not all_finite(track.orientation[0]):
        return None
    points = np.concatenate([part.vertices for part in parts if part is not None])
    turned = rotate(track.orientation[0].astype(float), np.vstack([points, shape.centroid]))
    low = turned[:-1][turned[:-1, 2] < turned[:-1, 2].min() + LOWEST][:, :2]
    middle = turned[-1, :2]
    ring = BEYOND / 10 * np.array([[1, 0], [-0.5, 0.8], [-0.5, -0.8]])  # an edge has no area
    spread = (low[:, None] + ring[None]).reshape(-1, 2)
    margin = polygon_margin(spread, np.zeros(len(spread), np.int64), middle[None])[0]
    return -float(margin)


def _company(start: Start, body: Body, mine: tuple[F64, F64]) -> int:
    """Bodies within 1 cm of a box around a body, planes among them."""
    low, high = mine[0].min(axis=0) - 0.01, mine[1].max(axis=0) + 0.01
    count = 0
    for other in start.solid:
        if other is body or not other.geoms:
            continue
        theirs = start.boxes(other)
        count += theirs is None or bool(
            ((theirs[0] <= high) & (theirs[1] >= low)).all(axis=1).any()
        )
    return count
