"""Signals of mechanical damage: impact, steady force, and what they cost by material.

The model of OopsieVerse (arXiv 2606.31993; github.com/UT-Austin-RobIn/oopsieverse), which evaluates
it once per control step. Here the time that one evaluation covers is stated, and the loss of health
is the same at every rate of recording.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .facts import Query
from .motion import com_velocity
from .options import DEFAULT_OVER
from .series import Series, exact

F64 = NDArray[np.float64]

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
    if episode.header.force_source == "none":
        return query.unknown("the trace has no contact forces")
    found = _change(query)
    if isinstance(found, Series):
        return found
    change, notes = found
    size = np.linalg.norm(change, axis=1)
    moved = size >= STEADY
    ahead = np.divide(change, size[:, None], out=np.zeros_like(change), where=moved[:, None])
    body, total = episode.body_index[name], np.zeros(len(episode))
    for other in query.facts.contact_sums.beside(body):
        pair = (min(body, other), max(body, other))
        frame, vector, normal = episode.contacts.of_pair(pair, "frame", "force", "normal")
        normal = normal.astype(np.float64)
        along = np.einsum("ck,ck->c", vector.astype(np.float64), normal)
        force = normal * (along if other < body else -along)[:, None]
        forward = np.maximum(np.einsum("ck,ck->c", force, ahead[frame]), 0.0)
        steady = np.linalg.norm(force - forward[:, None] * ahead[frame], axis=1)
        total += np.bincount(frame, steady, len(episode))
    return exact(total, query.dimension, notes)


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
        if not found.known.all():
            return found
    potential = by_impact * impacts.lower + by_hold * holds.lower - threshold
    loss = np.clip(np.maximum(potential, 0.0) * scale / 100, 0.0, 1.0)
    return exact(loss, query.dimension, tuple(dict.fromkeys(impacts.notes + holds.notes)))


def health(query: Query) -> Series:
    """Ratio, 1 less all damage so far, never below 0.

    Damage is what one evaluation costs, and there is one every Δt: ∫ damage dt / Δt. An impact is
    seen for Δt, so it costs its damage once.
    """
    loss = damage(query)
    if not loss.known.all():
        return loss
    seconds = np.diff(query.episode.t, prepend=query.episode.t[0])
    left = np.maximum(1 - np.cumsum(loss.lower * seconds) / _over(query), 0.0)
    return exact(left, query.dimension, loss.notes)


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
