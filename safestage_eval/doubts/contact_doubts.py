"""Checks of contacts: they lie on both bodies, and say the same thing twice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.contradiction import POSES, ContradictionError, doubt
from safestage_eval.episode.rounding import most_off
from safestage_eval.episode.scene_shapes import BodyShapes

from .check_registry import check
from .column_comparisons import lengths, surface_distances
from .columns import Columns

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

LOOKED_AT = 64
"""Contacts of a pair that are compared with poses, evenly spread over its rows."""

NEAR = 0.03
"""m; a contact point lies so near to the surface of both bodies. In recorded episodes it is 3 mm;
engines that report a contact before the bodies meet do so at 2 cm."""

APART = 0.05
"""m; the balls around two bodies that touch are no further apart."""

RADIUS = 1.0
"""m from a body's origin at the most at which rounded orientations are taken into account: planes are endless."""

DEEPEST = 0.1
"""m; no solver lets bodies overlap by that much: recorded episodes have 1.4 cm, in a crash."""

EVERY = 8
"""Frames of which one is looked at where forces are added up."""

CAUSES = ("AUD101", "AUD111", "AUD113", "AUD116", "AUD131")
"""Checks whose findings explain contacts that are elsewhere than the bodies."""


@check(
    "AUD121",
    "error",
    title="contacts are not where the bodies are",
    why="Touches, support and forces are those of other bodies, or of another moment.",
    example="contacts counted from another frame, or given in a body's own frame",
    unless=(*CAUSES, "AUD114", "AUD115"),
    over="columns",
)
def contact_places(columns: Columns) -> Iterator[ContradictionError]:
    """Asks for contact points within 3 cm of the surfaces of both bodies, and for bodies that meet."""
    for pair, told in columns.pairs.items():
        frame, point = told.get("frame"), told.get("position")
        there, compared = [], 0
        for body in sorted((columns.header.bodies[i] for i in pair), key=lambda b: not b.movable):
            place = columns.track(body, "position")
            shapes = None if place is None else columns.shapes(body)
            if shapes is None or place is None:
                break
            one = _Placed(body.name, place, columns.track(body, "orientation"), shapes)
            there.append(one)
            if frame is not None and point is not None and one.turn is not None:
                yield from _points(columns, pair, frame, point, one)
                compared += 1
        if len(there) == 2 > compared:
            yield from _apart(columns, pair, frame, *sorted(there, key=lambda x: x.shapes.radius))


class _Placed(NamedTuple):
    """A body, where it is at each frame (or in one row), and its shapes."""

    name: str
    place: F32
    turn: F32 | None
    shapes: BodyShapes


def _points(
    columns: Columns, pair: Pair, frame: I32, point: F32, body: _Placed
) -> Iterator[ContradictionError]:
    """(N, 3) m: contact points lie on the surface of a body."""
    if not len(frame) or body.turn is None:
        return
    every = _every(len(frame))
    far, row = _most(
        surface_distances(frame[::every], point[::every], body.place, body.turn, body.shapes)
    )
    if not far > NEAR:
        return
    if not far > NEAR + most_off(point) + _place_off(body.place, body.turn, body.shapes.radius):
        return
    at, names = columns.t[frame[row * every]], [columns.header.bodies[i].name for i in pair]
    yield doubt(
        f"the contact of {names[0]!r} and {names[1]!r} at {at:.3f} s lies {far:.3g} m from the "
        f"surface of {body.name!r}.",
        f"contact points (m, world) within {NEAR} m of both surfaces",
        "look for other units, quaternions as xyzw, a shape of another size, exchanged bodies, "
        "or contacts counted from another frame",
        bodies=(body.name, *(n for n in names if n != body.name)),
        time=at,
        hides=(*POSES, "contacts"),
    )


def _apart(
    columns: Columns, pair: Pair, frame: I32 | None, small: _Placed, large: _Placed
) -> Iterator[ContradictionError]:
    """Two bodies that touch are no further apart than their shapes reach."""
    t, reach, at = columns.t, small.shapes.radius, 0
    some = None if frame is None else frame[:: _every(len(frame))]
    if not reach < np.inf or (some is not None and not len(some)):
        return
    to_surface = some is not None and large.turn is not None
    if some is not None and large.turn is not None:
        here = small.place.take(some if len(small.place) > 1 else some * 0, axis=0)
        far, at = _most(surface_distances(some, here, large.place, large.turn, large.shapes))
    else:
        reach += large.shapes.radius
        if some is None:  # it is only known that there are contacts
            apart = lengths(small.place.astype(np.float64) - large.place)
            far = float(np.nanmin(apart)) if np.isfinite(apart).any() else -np.inf
        else:
            places = (p[some] if len(p) > 1 else p for p in (small.place, large.place))
            first, second = places
            far, at = _most(lengths(first.astype(np.float64) - second))
    if not far > reach + APART:
        return
    turned = large.turn if to_surface else None
    slack = most_off(small.place) + _place_off(large.place, turned, far)
    if not far > reach + APART + slack:
        return
    when = "" if some is None else f" at {t[some[at]]:.3f} s"
    if to_surface:
        a, b = small.name, large.name
        how = f"{a!r} is {far:.3g} m from the surface of {b!r} there, and reaches {reach:.3g} m."
    else:
        a, b = (columns.header.bodies[i].name for i in pair)
        there = "there" if when else "at the nearest"
        how = f"are {far:.3g} m apart {there}; their shapes reach {reach:.3g} m."
    yield doubt(
        f"{a!r} and {b!r} touch{when}, but {how}",
        "contacts of bodies that are at the same place",
        "look for another unit (cm, mm) of one body's poses or shape, exchanged bodies, or "
        "contacts counted from another frame",
        bodies=(a, b),
        time=t[some[at]] if some is not None and to_surface else None,
        hides=(*POSES, "contacts"),
    )


def _every(rows: int) -> int:
    return max(1, rows // LOOKED_AT)


def _most(values: F64) -> tuple[float, int]:
    """The greatest of the known values and its row; −inf where none is known."""
    known = np.where(np.isnan(values), -np.inf, values)
    at = int(known.argmax())
    return float(known[at]), at


def _place_off(position: F32, orientation: F32 | None, reach: float) -> float:
    """How far (m) the rounding of poses may move a point so far from a body's origin."""
    turned = 0.0 if orientation is None else 2 * most_off(orientation) * min(reach, RADIUS)
    return most_off(position) + turned


@check(
    "AUD122",
    "error",
    title="bodies overlap deeper than any solver lets them",
    why="Depths are lengths in metres; where forces are missing, touches are decided from them.",
    example="depths in millimetres",
    unless=CAUSES,
    over="columns",
)
def depths(columns: Columns) -> Iterator[ContradictionError]:
    """Asks for depths of 10 cm at the most."""
    for names, told in _told(columns):
        depth = told.get("depth", np.zeros(0))
        most = float(np.nanmax(np.abs(depth), initial=0)) if len(depth) else 0.0
        if most > DEEPEST:
            yield doubt(
                f"{names[0]!r} and {names[1]!r} overlap by {most:.3g} m.",
                f"depths (m) up to {DEEPEST}",
                "look for another unit of the depth, or of a shape",
                bodies=names,
                hides=(*POSES, "contacts"),
            )


@check(
    "AUD124",
    "error",
    title="peak forces are below the forces",
    why="The peak of a pair is its largest force in any physics step of the frame; rules about force "
    "limits are judged by it.",
    example="peaks of single contact points beside summed forces",
    over="columns",
)
def peaks(columns: Columns) -> Iterator[ContradictionError]:
    """Compares the peak of a pair with its force at the frame; 1 %, 0.01 N and rounding lie between them."""
    for names, told in _told(columns):
        if not told.keys() >= {"peak_force", "force", "normal"}:
            continue
        frame, peak = told["frame"], told["peak_force"]
        rows = np.flatnonzero(frame % EVERY == 0)
        at, push, way = (
            frame[rows],
            *(told[c][rows].astype(np.float64) for c in ("force", "normal")),
        )
        unit = np.abs(np.einsum("ij,ij->i", way, way) - 1) < 0.01  # any other is unknown anyway
        along = np.where(unit, np.abs(np.einsum("ij,ij->i", push, way)), 0.0)
        sums = np.bincount(at, along)
        with np.errstate(invalid="ignore"):
            short = 0.99 * sums[at] - 1e-2 - peak[rows]  # NaN is above nothing
            if not (short > 0).any():
                continue
            rounding = columns.rounding
            aside = np.einsum("ij,ij->i", rounding("force").error(push), np.abs(way))
            aside += np.einsum("ij,ij->i", rounding("normal").error(way), np.abs(push))
            short -= np.bincount(at, np.where(unit, aside, 0.0))[at]
            short -= rounding("peak_force").error(peak[rows])
            below = short > 0
        if below.any():
            n = int(rows[below.argmax()])
            yield doubt(
                f"the peak force of {names[0]!r} and {names[1]!r} at frame {frame[n]} is {peak[n]:.3g} N, "
                f"less than their force at that frame, {sums[frame[n]]:.3g} N.",
                "the greatest sum of a pair's normal forces within the frame",
                "look for another unit; or write NaN where no peak was recorded",
                bodies=names,
                hides=("peak_force",),
            )


def _told(columns: Columns) -> Iterator[tuple[tuple[str, str], Mapping[str, Any]]]:
    """Names of the bodies of each pair whose contacts are at hand by frame, with the columns."""
    bodies = columns.header.bodies
    for (i, j), told in columns.pairs.items():
        if "frame" in told:
            yield (bodies[i].name, bodies[j].name), told
