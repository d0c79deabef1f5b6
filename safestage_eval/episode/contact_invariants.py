"""Consistency of contacts: they lie on both bodies, and their forces carry the weight of bodies at rest.

One function per check; each returns what it found, none of it twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from .column_comparisons import distances, surface_distances, while_at_rest, while_untouched
from .contradiction import POSES, ContradictionError, contradiction
from .rounding import SINGLE, Rounding, most_off
from .scene_shapes import BodyShapes

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

STILL, STILL_FOR = 5e-4, 0.1
"""m and s: a body at rest is nowhere else that much before and after each moment of its rest. A
thrown one is there, at the top of its way, for 2 cm of falling at the least."""

ROUGH = 0.01
"""m; of places that may be off by more nobody can tell whether a body rests or begins to fall."""

EVERY = 8
"""Frames of which one is looked at where forces are added up."""

RESTED = 0.2
"""s of rest at the least before forces are compared with the weight."""

STAYED, SAMPLES = 1.0, 3
"""s and samples: what nothing touches stays nowhere so long, at whatever rate it is looked at."""

FALLS = 3.0
"""m/s downward; what sinks that fast falls, though air may keep a light body from falling faster."""

TOO_LITTLE, TOO_MUCH, ASIDE = 0.2, 2.0, 0.8
"""Share of its weight that the forces on a body at rest come to at the least, added up as they are
strong: the walls of a gap hold it with 0.25 by friction of 2; that the upward one comes to at the
most; and the horizontal one, where the upward one is less than half of that: a board that leans at
45° presses a wall with 0.5, and friction is not recorded everywhere. In recorded episodes the upward
one is 0.999 to 1.001."""


def _every(rows: int) -> int:
    return max(1, rows // LOOKED_AT)


def _most(values: F64) -> tuple[float, int]:
    """The greatest of the known values and its row; −inf where none is known."""
    known = np.where(np.isnan(values), -np.inf, values)
    at = int(known.argmax())
    return float(known[at]), at


def _least(values: F64) -> float:
    """The least of the known values; −inf where none is known."""
    return -_most(-values)[0] if np.isfinite(values).any() else -np.inf


def _place_off(position: F32, orientation: F32, reach: float) -> float:
    """How far (m) the rounding of poses may move a point so far from a body's origin."""
    return most_off(position) + 2 * most_off(orientation) * min(reach, RADIUS)


def check_touching_bodies(
    frame: I32 | None, position: F32, other: F32, reach: float, names: tuple[str, str], t: F64,
    where: str,
) -> list[ContradictionError]:  # fmt: skip
    """Two bodies that touch are near each other.

    Args:
        frame: (N,) of their contacts; None if it is only known that there are some.
        position: (T, 3) m of the one, or (1, 3).
        other: likewise of the other.
        reach: m, how far their shapes reach from their origins, together.
        names: of the two.
        t: (T,) s.
        where: for messages.
    """
    if (frame is not None and not len(frame)) or not reach < np.inf:
        return []
    if frame is None:
        when, there, far = "", "at the nearest", _least(distances(position, other))
    else:
        some = frame[:: _every(len(frame))]
        far, at = _most(distances(*(p[some] if len(p) > 1 else p for p in (position, other))))
        when, there = f" at {t[some[at]]:.3f} s", "there"
    if not far > reach + APART:
        return []
    if not far > reach + APART + most_off(position) + most_off(other):
        return []
    return [
        contradiction(
            "apart",
            names,
            where,
            f"{names[0]!r} and {names[1]!r} touch{when}, but are {far:.3g} m apart {there}; "
            f"their shapes reach {reach:.3g} m.",
            "contacts of bodies that are at the same place",
            "look for another unit (cm, mm) of one body's poses or shape, exchanged bodies, or "
            "contacts counted from another frame",
            hides=(*POSES, "contacts"),
        )
    ]


def check_reached_body(
    frame: I32, position: F32, radius: float, place: F32, turn: F32, shapes: BodyShapes,
    names: tuple[str, str], t: F64, where: str,
) -> list[ContradictionError]:  # fmt: skip
    """A body that touches another one is no further from its surface than its own shapes reach.

    Args:
        frame: (N,) of their contacts.
        position: (T, 3) m of the smaller one, or (1, 3).
        radius: m, how far its shapes reach from there.
        place: (T, 3) m of the other one, or (1, 3).
        turn: (T, 4) wxyz, likewise.
        shapes: of the other one.
        names: of the two, in this order.
        t: (T,) s.
        where: for messages.
    """
    some = frame[:: _every(len(frame))]
    if not len(some) or not radius < np.inf:
        return []
    there = position.take(some if len(position) > 1 else some * 0, axis=0)
    far, at = _most(surface_distances(some, there, place, turn, shapes))
    if not far > radius + APART:
        return []
    if not far > radius + APART + most_off(position) + _place_off(place, turn, far):
        return []
    return [
        contradiction(
            "apart",
            names,
            where,
            f"{names[0]!r} and {names[1]!r} touch at {t[some[at]]:.3f} s, but {names[0]!r} "
            f"is {far:.3g} m from the surface of {names[1]!r} there, and reaches {radius:.3g} m.",
            "contacts of bodies that are at the same place",
            "look for another unit (cm, mm) of one body's poses or shape, exchanged bodies, or "
            "contacts counted from another frame",
            time=t[some[at]],
            hides=(*POSES, "contacts"),
        )
    ]


def check_contact_points(
    frame: I32, point: F32, position: F32, orientation: F32, shapes: BodyShapes,
    names: tuple[str, str, str], t: F64, where: str,
) -> list[ContradictionError]:  # fmt: skip
    """(N, 3) m: contact points lie on the surface of a body.

    ``names``: of the body whose poses and shapes are given, and of both that touch.
    """
    if not len(frame):
        return []
    every = _every(len(frame))
    far, row = _most(
        surface_distances(frame[::every], point[::every], position, orientation, shapes)
    )
    if not far > NEAR:
        return []
    slack = most_off(point) + _place_off(position, orientation, shapes.radius)
    if not far > NEAR + slack:
        return []
    at, (body, *pair) = t[frame[row * every]], names
    return [
        contradiction(
            "surface",
            (body, *(n for n in pair if n != body)),
            where,
            f"the contact of {pair[0]!r} and {pair[1]!r} at {at:.3f} s lies {far:.3g} m from the "
            f"surface of {body!r}.",
            f"contact points (m, world) within {NEAR} m of both surfaces",
            "look for other units, quaternions as xyzw, a shape of another size, exchanged bodies, "
            "or contacts counted from another frame",
            time=at,
            hides=(*POSES, "contacts"),
        )
    ]


def check_depths(depth: F32, names: Sequence[str], where: str) -> list[ContradictionError]:
    """(N,) m: bodies that touch neither overlap deeply nor are far apart."""
    if not len(depth) or not float(np.nanmax(np.abs(depth), initial=0)) > DEEPEST:
        return []
    return [
        contradiction(
            "depth",
            tuple(names),
            where,
            f"{names[0]!r} and {names[1]!r} overlap by {np.nanmax(np.abs(depth)):.3g} m.",
            f"depths (m) up to {DEEPEST}",
            "look for another unit of the depth, or of a shape",
            hides=(*POSES, "contacts"),
        )
    ]


def check_peaks(
    frame: I32, force: F32, normal: F32, peak: F32, names: Sequence[str], where: str,
    rounding: Callable[[str], Rounding] = lambda _: SINGLE,
) -> list[ContradictionError]:  # fmt: skip
    """(N,) N: a pair's peak within a frame is at least its force at the frame.

    To 1 %, 0.01 N and rounding. ``rounding``: tells that of ``force``, ``normal`` and ``peak_force``.
    """
    rows = np.flatnonzero(frame % EVERY == 0)
    at, push, way = frame[rows], force[rows].astype(np.float64), normal[rows].astype(np.float64)
    unit = np.abs(np.einsum("ij,ij->i", way, way) - 1) < 0.01  # any other is unknown anyway
    along = np.where(unit, np.abs(np.einsum("ij,ij->i", push, way)), 0.0)
    sums = np.bincount(at, along)
    with np.errstate(invalid="ignore"):
        short = 0.99 * sums[at] - 1e-2 - peak[rows]  # NaN is above nothing
        if not (short > 0).any():
            return []
        aside = np.einsum("ij,ij->i", rounding("force").error(push), np.abs(way))
        aside += np.einsum("ij,ij->i", rounding("normal").error(way), np.abs(push))
        short -= np.bincount(at, np.where(unit, aside, 0.0))[at]
        short -= rounding("peak_force").error(peak[rows])
        below = short > 0
    if not below.any():
        return []
    n = int(rows[below.argmax()])
    return [
        contradiction(
            "peak",
            tuple(names),
            where,
            f"the peak force of {names[0]!r} and {names[1]!r} at frame {frame[n]} is {peak[n]:.3g} N, "
            f"less than their force at that frame, {sums[frame[n]]:.3g} N.",
            "the greatest sum of a pair's normal forces within the frame",
            "look for another unit; or write NaN where no peak was recorded",
            hides=("peak_force",),
        )
    ]


def _mean_around(sums: F64, reach: int) -> F64:
    """(T, 4) means within ``reach`` frames of each, by weights that fall to 0 there."""
    weights = np.convolve(np.ones(reach), np.ones(reach)) / reach**2
    if len(sums) < len(weights):
        return sums
    return np.column_stack([np.convolve(column, weights, "same") for column in sums.T])


def check_weight(
    t: F64, position: F32, weight: float, sums: F64, body: str, where: str, *,
    dense: bool = False, off: float = 0.0,
) -> list[ContradictionError]:  # fmt: skip
    """Contacts bear a free body that rests.

    One that rattles is borne over time: where forces are known at every frame, they count only if
    those around a moment are wrong as well. Newton's law bounds their mean by how far the body moves
    if they weigh the less, in proportion, the further away in time: ``STILL`` allows 1 % of the weight.

    Args:
        t: (T,) s.
        position: (T, 3) m.
        weight: N.
        sums: (T, 4) N, x, y, z of all of its contacts, and how strong they are; at each ``EVERY``
            frames.
        body: for messages.
        where: likewise.
        dense: ``sums`` are those at every frame.
        off: N by which the rounding of forces may change a sum.
    """
    dt = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    if len(position) != len(t) or not 0 < dt <= STILL_FOR / 2 or not weight > 0:
        return []  # at lower rates nobody can tell whether a body rests
    if off > TOO_LITTLE * weight / 2:
        return []  # nor what bears it, where all is rounded
    reach = max(1, round(STILL_FOR / dt))
    limits = TOO_LITTLE * weight - off, TOO_MUCH * weight + off, ASIDE * weight + off
    around = _mean_around(sums, reach) if dense else sums
    *wrong, at = while_at_rest(position, sums, around, reach, STILL, EVERY, *limits)
    for k, how in enumerate(("bear it with", "press it up with", "press it aside with")):
        lasted = wrong[k].sum() * EVERY * dt
        if lasted < RESTED:
            continue
        if most_off(position) > ROUGH:
            return []
        i = int(at[wrong[k].argmax()])
        bears = sums[i, 3] if sums[i, 3] < limits[0] else sums[i, 2]  # below 0: they pull it down
        size = (bears, sums[i, 2], float(np.hypot(*sums[i, :2])))[k]
        return [
            contradiction(
                "floats" if k == 0 and not size else ("bears", "presses", "aside")[k],
                (body,),
                where,
                f"{body!r} rests at {t[i]:.3f} s and weighs {weight:.3g} N, but contacts {how} "
                f"{size:.3g} N, for {lasted:.2f} s in all.",
                "forces in N, on body 2 by body 1, that bear what rests",
                "look for another unit of masses or forces, a support that is not recorded, "
                "contacts counted from another frame, or poses in another unit or other axes",
                time=t[i],
                hides=(*POSES, "contacts", "mass"),
            )
        ]
    return []


def check_free_fall(
    t: F64, position: F32, gravity: float, touched: NDArray[np.bool_], body: str, where: str
) -> list[ContradictionError]:
    """A free body that nothing touches falls.

    Args:
        t: (T,) s.
        position: (T, 3) m, of a free body.
        gravity: m/s².
        touched: (T,) something may touch it.
        body: for messages.
        where: likewise.
    """
    dt = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    if len(position) != len(t) or not dt > 0:
        return []
    touched = touched | (np.gradient(position[:, 2].astype(np.float64), t) < -FALLS)
    if dt > STILL_FOR / 2:
        first, lasted = _stays_untouched(t, position, touched)
        if not lasted:
            return []
    else:
        reach = max(1, round(STILL_FOR / dt))
        # at the middle of 2 reaches it is g (reach dt)² / 2 above the line; half of that is asked for
        at = while_untouched(position, touched, reach, 0.25 * gravity * (reach * dt) ** 2)
        if len(at) * dt < RESTED:
            return []
        first, lasted = int(at[0]), len(at) * dt
    if most_off(position) > ROUGH:
        return []
    return [
        contradiction(
            "floats",
            (body,),
            where,
            f"{body!r} does not fall at {t[first]:.3f} s, though nothing touches it for "
            f"{lasted:.2f} s in all.",
            "contacts of all that bears or carries a body",
            "look for contacts that are not recorded, or counted from another frame, and for other "
            "units; a body that gravity does not act on is not movable, or has no mass",
            time=t[first],
            hides=(*POSES, "contacts"),
        )
    ]


def _stays_untouched(t: F64, position: F32, touched: NDArray[np.bool_]) -> tuple[int, float]:
    """The first sample of the first stay of a body that nothing touches, and how long it is (s).

    Both are 0 where there is none of ``STAYED`` s and ``SAMPLES`` samples. Samples at which the
    place was not measured are left out.
    """
    at = np.flatnonzero(np.isfinite(position).all(axis=1))
    usual, first = float(np.median(np.diff(t))), 0
    for last, i in enumerate(at):
        if touched[i]:
            first = last + 1
            continue
        if (np.abs(position[i] - position[at[first]]) >= STILL).any():
            first = last
        many = last + 1 - first
        if many >= SAMPLES and many * usual >= STAYED:
            return int(at[first]), many * usual
    return 0, 0.0
