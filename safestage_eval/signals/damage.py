"""Signals of mechanical damage: impact, steady force, and what they cost by material.

The model of OopsieVerse (arXiv 2606.31993; github.com/UT-Austin-RobIn/oopsieverse), which evaluates
it once per control step. Here the time that one evaluation covers is stated, and the loss of health
is the same at every rate of recording.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .facts import Query
from .gaps import POSE, TWIST
from .motion import com_velocity
from .options import DEFAULT_OVER
from .series import Series, exact

F64 = NDArray[np.float64]

ALL = (*POSE, *TWIST)

STEADY = 1e-6
"""m/s: a change of velocity below the rounding of a trace has no direction."""


def impact(query: Query) -> Series:
    """N, m‖Δv‖/Δt of the COM over the stated Δt.

    Between frames velocities are interpolated; before the first frame they are as in the first.
    """
    mass = query.episode.bodies[query.bodies[0]].mass
    if mass is None:
        return query.unknown(f"the trace has no mass of {query.bodies[0]}")
    found = _change(query)
    if isinstance(found, Series):
        return found
    change, notes = found
    force = mass * np.linalg.norm(change, axis=1) / _over(query)
    return exact(force, query.dimension, notes)


def quasistatic_force(query: Query) -> Series:
    """N, Σ ‖F − (F·â)â‖ over the contacts of the body, â the direction of Δv over the stated Δt.

    F is the normal force on the body. One against Δv, or while there is no Δv, counts whole.
    """
    episode, name = query.episode, query.bodies[0]
    gaps = query.facts.gaps
    if not gaps.forces:
        return query.unknown(gaps.about_forces)
    found = _change(query)
    if isinstance(found, Series):
        return found
    change, notes = found
    size = np.linalg.norm(change, axis=1)
    moved = size >= STEADY
    ahead = np.divide(change, size[:, None], out=np.zeros_like(change), where=moved[:, None])
    body, total = episode.body_index[name], np.zeros(len(episode))
    pairs = []
    for other in query.facts.contact_sums.beside(body):
        pair = (min(body, other), max(body, other))
        frame, vector, normal = episode.contacts.of_pair(pair, "frame", "force", "normal")
        normal = normal.astype(np.float64)
        along = np.einsum("ck,ck->c", vector.astype(np.float64), normal)
        force = normal * (along if other < body else -along)[:, None]
        forward = np.maximum(np.einsum("ck,ck->c", force, ahead[frame]), 0.0)
        steady = np.linalg.norm(force - forward[:, None] * ahead[frame], axis=1)
        total += np.bincount(frame, steady, len(episode))
        pairs.append(pair)
        query.facts.contact_sums.normal(*pair)  # looks whether the contacts are sound
    lost = gaps.of_pairs(pairs)
    if lost is None:
        return exact(total, query.dimension, notes)
    most = np.where(lost, np.inf, total)
    return Series(total, most, query.dimension, (*notes, *gaps.told(pairs)))


def damage(query: Query) -> Series:
    """Ratio, min(1, max(0, s_i·F_i + s_q·F_q − T)·k / 100): one evaluation at each frame.

    s_i, s_q, T and k are the material's ``impact_sensitivity``, ``hold_sensitivity``,
    ``damage_threshold`` (N) and ``damage_scale`` (health points, of 100, per N).
    """
    values = dict(query.options)
    columns = ("impact_sensitivity", "hold_sensitivity", "damage_threshold", "damage_scale")
    if not all(column in values for column in columns):
        return query.unknown("only the materials of a rule set say what damages a body")
    by_impact, by_hold, threshold, scale = (float(values[column]) for column in columns)  # type: ignore[arg-type]
    impacts, holds = impact(query), quasistatic_force(query)
    for found in (impacts, holds):
        if not found.known.any():
            return query.unknown(", ".join(found.notes))
    notes = tuple(dict.fromkeys(impacts.notes + holds.notes))

    def loss(by: F64, held: F64) -> F64:
        potential = (by_impact * by if by_impact else 0.0) + (by_hold * held if by_hold else 0.0)
        lost: F64 = np.clip(np.maximum(potential - threshold, 0.0) * scale / 100, 0.0, 1.0)
        return np.broadcast_to(lost, len(by))

    least = loss(np.maximum(impacts.lower, 0), np.maximum(holds.lower, 0))
    if impacts.lower is impacts.upper and holds.lower is holds.upper:
        return exact(least, query.dimension, notes)
    return Series(least, loss(impacts.upper, holds.upper), query.dimension, notes)


def health(query: Query) -> Series:
    """Ratio, 1 less all damage so far, never below 0.

    Damage is what one evaluation costs, and there is one every Δt: ∫ damage dt / Δt. An impact is
    seen for Δt, so it costs its damage once.
    """
    loss = damage(query)
    if not loss.known.any():
        return loss
    lost = (
        touched_by(query, gap)
        if (gap := query.facts.gaps.of_bodies(query.bodies, ALL)) is not None
        else None
    )
    seconds = np.diff(query.episode.t, prepend=query.episode.t[0])

    def left(damage: F64) -> F64:
        return np.maximum(1 - np.cumsum(damage * seconds) / _over(query), 0.0)

    if lost is None and loss.lower is loss.upper:
        return exact(left(loss.lower), query.dimension, loss.notes)
    least, most = loss.lower, loss.upper
    if lost is not None:  # whatever happened meanwhile: from nothing to all
        least, most = np.where(lost, 0.0, least), np.where(lost, 1.0, most)
    return Series(left(most), left(least), query.dimension, loss.notes)


def touched_by(query: Query, lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,) where a change of velocity over the stated time looks at a frame that is lost (T,)."""
    t = query.episode.t
    return lost_since(np.maximum(np.searchsorted(t, t - _over(query), "right") - 1, 0), lost)


def lost_since(first: NDArray[np.intp], lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,) where a frame that is lost (T,) lies between a first frame (T,) and each."""
    many = np.concatenate([[0], np.cumsum(lost)])
    return np.asarray(many[1:] > many[first])


def _over(query: Query) -> float:
    return float(query.option("over") or DEFAULT_OVER)  # type: ignore[arg-type]


def _change(query: Query) -> tuple[F64, tuple[str, ...]] | Series:
    """(T, 3) m/s, change of the COM's velocity over the stated time, and notes."""
    over, t = _over(query), query.episode.t
    if len(t) > 1 and over < query.episode.dt * (1 - 1e-6):
        return query.unknown(
            f"the frames are {query.episode.dt * 1e3:.3g} ms apart: "
            f"a change over {over * 1e3:.3g} ms was not recorded"
        )
    velocity, notes = com_velocity(query.episode, query.bodies[0])
    before = np.column_stack([np.interp(t - over, t, axis) for axis in velocity.T])
    return velocity - before, notes
