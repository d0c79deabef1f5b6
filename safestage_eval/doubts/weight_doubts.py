"""Checks of support: forces carry the weight of what rests, and what nothing touches falls."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body
from safestage_eval.episode.contradiction import POSES, ContradictionError, doubt
from safestage_eval.episode.rounding import most_off

from .check_registry import check
from .column_comparisons import lengths
from .columns import Array, Columns
from .contact_doubts import CAUSES, EVERY

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I32 = NDArray[np.int32]

STILL, STILL_FOR = 5e-4, 0.1
"""m and s: a body at rest is nowhere else that much before and after each moment of its rest. A
thrown one is there, at the top of its way, for 2 cm of falling at the least."""

ROUGH = 0.01
"""m; of places that may be off by more nobody can tell whether a body rests or begins to fall."""

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


@check(
    "AUD123",
    "error",
    title="forces are not those that bear the weights",
    why="Support, dependence and grip are decided by forces in newtons on body 2 by body 1.",
    example="forces in kN, or those on body 1 by body 2",
    issue="isaac-sim/IsaacLab#2193",
    unless=(*CAUSES, "AUD114", "AUD115", "AUD117", "AUD121", "AUD132"),
    over="columns",
)
def weights(columns: Columns) -> Iterator[ContradictionError]:
    """Adds up the forces on free bodies at rest and compares them with their weight."""
    yield from (one for one in _unborne(columns) if one.code == "AUD123")


@check(
    "AUD127",
    "error",
    title="a body neither falls nor touches anything",
    why="What bears it is not recorded, so support, rest and dependence cannot be decided.",
    example="a recorder that leaves out contacts with the table",
    unless=(*CAUSES, "AUD114", "AUD115", "AUD117", "AUD121", "AUD123"),
    over="columns",
)
def floating(columns: Columns) -> Iterator[ContradictionError]:
    """Looks for free bodies that stay where they are though no contact of theirs is recorded."""
    yield from (one for one in _unborne(columns) if one.code == "AUD127")


def _unborne(columns: Columns) -> list[ContradictionError]:
    """Forces against the weights of free bodies at rest, with the code of the check that tells of each."""
    if "unborne" not in columns.found:
        columns.found["unborne"] = [*_find_unborne(columns)]
    found: list[ContradictionError] = columns.found["unborne"]
    return found


def _find_unborne(columns: Columns) -> Iterator[ContradictionError]:
    header = columns.header
    every = dict.fromkeys((*columns.pairs, *columns.episode.contacts.pairs))
    told = (columns.pairs.get(p) or columns.at_hand.contacts(p) for p in every)
    forces = (found[c] for found in told for c in ("force", "force.z") if c in found)
    if header.force_source in ("normal", "none") or not any(force.any() for force in forces):
        return  # friction bears as well; zero throughout: not recorded
    for i in _free(header.bodies, (joint.body for joint in header.joints)):
        body = header.bodies[i]
        place = columns.track(body, "position")
        if place is None or not columns.at_hand.matters(body.name):
            continue
        found = _borne(columns, i, place, exact=False)
        if found:  # contacts that no rule asked for may explain it, or the frames between
            found = _borne(columns, i, place, exact=True)
        yield from found


def _borne(columns: Columns, i: int, place: Array, *, exact: bool) -> list[ContradictionError]:
    """Contradiction in the support of a body (index); ``exact``: all of its contacts are known."""
    t, header, body = columns.t, columns.header, columns.header.bodies[i]
    sums, touched = np.zeros((len(t), 4)), np.zeros(len(t), np.bool_)
    many = 0
    for pair, told in columns.pairs.items():
        if i not in pair:
            continue
        if told.keys() >= {"frame", "force"}:
            sign = -1.0 if pair[0] == i else 1.0
            touched[told["frame"]] = True
            _add_forces(told["frame"], told["force"], sign, 1 if exact else EVERY, sums)
            if exact and len(told["frame"]):
                many += int(np.bincount(told["frame"]).max())
        elif exact:
            frame = columns.at_hand.contacts(pair, "frame")["frame"]
            sums[frame], touched[frame] = np.nan, True
    if columns.episode.unseen is not None:
        sums[columns.episode.unseen], touched[columns.episode.unseen] = np.nan, True
    gravity, off = -header.gravity[2], 0.0
    if many:  # at the frames at which it is pressed, but for one in ten
        share, step = columns.rounding("force")
        pressed = sums[sums[:, 3] > 0, 3]
        off = np.sqrt(3) * step * many
        off += share * float(np.quantile(pressed, 0.9)) if len(pressed) else 0.0
    weight = (body.mass or 0.0) * gravity
    found = [*_weight(t, place, weight, sums, body.name, dense=exact, off=off)]
    return found or ([*_free_fall(t, place, gravity, touched, body.name)] if body.mass else [])


def _free(all_bodies: tuple[Body, ...], moved: Iterable[str | None]) -> list[int]:
    """Objects that nothing is jointed to, so that contacts alone bear them."""
    jointed = {body.parent for body in all_bodies} | set(moved)
    return [
        i
        for i, body in enumerate(all_bodies)
        if body.kind == "object" and body.movable and body.geoms
        and body.parent is None and body.name not in jointed
    ]  # fmt: skip


def _add_forces(frame: I32, force: F32, sign: float, every: int, sums: F64) -> None:
    """Add forces (N, 3) to the ``sums`` (T, 4), x, y, z, and how strong they are, at each ``every`` frames."""
    if every > 1:
        some = frame % every == 0
        frame, force = frame[some], force[some]
    strong = lengths(force.astype(np.float64))
    for column, values in enumerate((*(sign * force.T), strong)):
        sums[:, column] += np.bincount(frame, values, len(sums))


def _mean_around(sums: F64, reach: int) -> F64:
    """(T, 4) means within ``reach`` frames of each, by weights that fall to 0 there."""
    weights = np.convolve(np.ones(reach), np.ones(reach)) / reach**2
    if len(sums) < len(weights):
        return sums
    return np.column_stack([np.convolve(column, weights, "same") for column in sums.T])


def _weight(
    t: F64, position: F32, weight: float, sums: F64, body: str, *, dense: bool, off: float
) -> Iterator[ContradictionError]:
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
        body: its name.
        dense: ``sums`` are those at every frame.
        off: N by which the rounding of forces may change a sum.
    """
    dt = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    if len(position) != len(t) or not 0 < dt <= STILL_FOR / 2 or not weight > 0:
        return  # at lower rates nobody can tell whether a body rests
    if off > TOO_LITTLE * weight / 2:
        return  # nor what bears it, where all is rounded
    reach = max(1, round(STILL_FOR / dt))
    least, most = TOO_LITTLE * weight - off, TOO_MUCH * weight + off
    aside = ASIDE * weight + off
    at = np.arange(-(-reach // EVERY) * EVERY, len(position) - reach, EVERY)
    here = position[at]
    still = [np.abs(position[at + way] - here) < STILL for way in (-reach, reach)]
    at = at[(still[0] & still[1]).all(axis=1)]
    wrong = np.ones((3, len(at)), np.bool_)
    for known in (sums, _mean_around(sums, reach)) if dense else (sums,):
        x, y, up, strong = known[at].T
        side = np.hypot(x, y)
        wrong &= (strong < least) | (up < -least), up > most, (side > aside) & (up < 0.5 * aside)
    for k, how in enumerate(("bear it with", "press it up with", "press it aside with")):
        lasted = wrong[k].sum() * EVERY * dt
        if lasted < RESTED:
            continue
        if most_off(position) > ROUGH:
            return
        i = int(at[wrong[k].argmax()])
        bears = sums[i, 3] if sums[i, 3] < least else sums[i, 2]  # below 0: they pull it down
        size = (bears, sums[i, 2], float(np.hypot(*sums[i, :2])))[k]
        yield doubt(
            f"{body!r} rests at {t[i]:.3f} s and weighs {weight:.3g} N, but contacts {how} "
            f"{size:.3g} N, for {lasted:.2f} s in all.",
            "forces in N, on body 2 by body 1, that bear what rests",
            "look for another unit of masses or forces, a support that is not recorded, "
            "contacts counted from another frame, or poses in another unit or other axes",
            bodies=(body,),
            time=t[i],
            hides=(*POSES, "contacts", "mass"),
            code="AUD127" if k == 0 and not size else "AUD123",
        )
        return


def _free_fall(
    t: F64, position: F32, gravity: float, touched: NDArray[np.bool_], body: str
) -> Iterator[ContradictionError]:
    """A free body that nothing touches falls; ``touched``: (T,) something may touch it."""
    dt = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    if len(position) != len(t) or not dt > 0:
        return
    touched = touched | (np.gradient(position[:, 2].astype(np.float64), t) < -FALLS)
    if dt > STILL_FOR / 2:
        first, lasted = _stays_untouched(t, position, touched)
        if not lasted:
            return
    else:
        reach = max(1, round(STILL_FOR / dt))
        # at the middle of 2 reaches it is g (reach dt)² / 2 above the line; half of that is asked for
        at = _in_the_air(position, touched, reach, 0.25 * gravity * (reach * dt) ** 2)
        if len(at) * dt < RESTED:
            return
        first, lasted = int(at[0]), len(at) * dt
    if most_off(position) <= ROUGH:
        yield doubt(
            f"{body!r} does not fall at {t[first]:.3f} s, though nothing touches it for "
            f"{lasted:.2f} s in all.",
            "contacts of all that bears or carries a body",
            "look for contacts that are not recorded, or counted from another frame, and for other "
            "units; a body that gravity does not act on is not movable, or has no mass",
            bodies=(body,),
            time=t[first],
            hides=(*POSES, "contacts"),
            code="AUD127",
        )


def _in_the_air(
    position: F32, touched: NDArray[np.bool_], reach: int, least: float
) -> NDArray[np.intp]:
    """Frames at which nothing touches a body for ``reach`` frames, and it does not fall by ``least`` m."""
    if touched.all() or len(position) <= 2 * reach:
        return np.zeros(0, np.intp)
    before = np.concatenate([[0], np.cumsum(touched)])
    at = np.flatnonzero(before[2 * reach + 1 :] == before[: -2 * reach - 1]) + reach
    z = position[:, 2].astype(np.float64)
    return at[z[at] - 0.5 * (z[at - reach] + z[at + reach]) < least]


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
