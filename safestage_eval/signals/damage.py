"""Signals of mechanical damage: impact, steady force, and what they cost by material.

The model of OopsieVerse (arXiv 2606.31993; github.com/UT-Austin-RobIn/oopsieverse), which evaluates
it once per control step. Here the time that one evaluation covers is stated, and the loss of health
is the same at every rate of recording.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.missing_values import POSE, TWIST, around

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

F64 = NDArray[np.float64]

ALL = (*POSE, *TWIST)

OVER = Option(
    "over",
    "time",
    "The time over which a change of velocity is one impact; 50 ms if left out.",
    default=0.05,  # one control step at 20 Hz, as in RoboCasa, a simulator of OopsieVerse
    looks="back",
)

COLUMNS = (
    ("damage_threshold", "force"),
    ("damage_scale", "ratio"),
    ("impact_sensitivity", "ratio"),
    ("hold_sensitivity", "ratio"),
)
"""Columns of a material that damage is computed from, with their dimensions."""

STEADY = 1e-6
"""m/s: a change of velocity below the rounding of a trace has no direction."""


@signal(
    "impact", "force", args=("a",), needs=("twists", "masses"), scale=1.0, options=(OVER,),
    reads="velocity", ahead=True,
)  # fmt: skip
def impact(request: Request) -> Interval:
    """Mass times change of velocity over a stated time, divided by that time.

    N, m‖Δv‖/Δt of the centre of mass. Between frames velocities are interpolated; before the first frame they are as in the first.
    """
    mass = request.episode.bodies[request.bodies[0]].mass
    if mass is None:
        return request.unknown(f"the trace has no mass of {request.bodies[0]}")
    changed = _change(request)
    if isinstance(changed, Interval):
        return changed
    change, notes = changed
    force = mass * np.linalg.norm(change, axis=1) / _over(request)
    return request.exact(force, notes)


@signal(
    "quasistatic_force", "force", args=("a",), needs=("forces", "twists"), scale=1.0,
    options=(OVER,), reads="velocity", ahead=True,
)  # fmt: skip
def quasistatic_force(request: Request) -> Interval:
    """Sum of the normal forces on the body, each without its part along the change of velocity.

    N, Σ ‖F − (F·â)â‖ over the contacts of the body, â the direction of Δv over the stated Δt. F is the normal force on the body. One against Δv, or while there is no Δv, counts whole.
    """
    episode, name = request.episode, request.bodies[0]
    gaps = request.facts.gaps
    if not gaps.forces:
        return request.unknown(gaps.about_forces)
    changed = _change(request)
    if isinstance(changed, Interval):
        return changed
    change, notes = changed
    size = np.linalg.norm(change, axis=1)
    moved = size >= STEADY
    ahead = np.divide(change, size[:, None], out=np.zeros_like(change), where=moved[:, None])
    body, total = episode.body_index[name], np.zeros(len(episode))
    pairs = []
    for other in request.facts.contact_sums.beside(body):
        pair = (min(body, other), max(body, other))
        frame, vector, normal = episode.contacts.of_pair(pair, "frame", "force", "normal")
        normal = normal.astype(np.float64)
        along = np.einsum("ck,ck->c", vector.astype(np.float64), normal)
        force = normal * (along if other < body else -along)[:, None]
        forward = np.maximum(np.einsum("ck,ck->c", force, ahead[frame]), 0.0)
        steady = np.linalg.norm(force - forward[:, None] * ahead[frame], axis=1)
        total += np.bincount(frame, steady, len(episode))
        pairs.append(pair)
        request.facts.contact_sums.normal(*pair)  # looks whether the contacts are sound
    lost = gaps.of_pairs(pairs)
    if lost is None:
        return request.exact(total, notes)
    most = np.where(lost, np.inf, total)
    return Interval(total, most, request.dimension, (*notes, *gaps.told(pairs)))


@signal(
    "damage", "ratio", args=("a",), needs=("forces", "twists", "masses"), scale=0.1,
    options=(OVER,), columns=COLUMNS, reads="velocity", ahead=True,
)  # fmt: skip
def damage(request: Request) -> Interval:
    """Health that the body would lose over the stated time, by its material.

    Ratio, min(1, max(0, s_i·F_i + s_q·F_q − T)·k / 100): one evaluation at each frame.

    s_i, s_q, T and k are the material's ``impact_sensitivity``, ``hold_sensitivity``,
    ``damage_threshold`` (N) and ``damage_scale`` (health points, of 100, per N).
    """
    values = dict(request.options)
    columns = ("impact_sensitivity", "hold_sensitivity", "damage_threshold", "damage_scale")
    if not all(column in values for column in columns):
        return request.unknown("only the materials of a rule set say what damages a body")
    by_impact, by_hold, threshold, scale = (float(values[column]) for column in columns)  # type: ignore[arg-type]
    impacts, holds = impact(request), quasistatic_force(request)
    for part in (impacts, holds):
        if not part.known.any():
            return request.unknown(", ".join(part.notes))
    notes = tuple(dict.fromkeys(impacts.notes + holds.notes))

    def loss(by: F64, held: F64) -> F64:
        potential = (by_impact * by if by_impact else 0.0) + (by_hold * held if by_hold else 0.0)
        lost: F64 = np.clip(np.maximum(potential - threshold, 0.0) * scale / 100, 0.0, 1.0)
        return np.broadcast_to(lost, len(by))

    least = loss(np.maximum(impacts.lower, 0), np.maximum(holds.lower, 0))
    if impacts.lower is impacts.upper and holds.lower is holds.upper:
        return request.exact(least, notes)
    return Interval(least, loss(impacts.upper, holds.upper), request.dimension, notes)


@signal(
    "health", "ratio", args=("a",), needs=("forces", "twists", "masses"), scale=0.1,
    options=(OVER,), columns=COLUMNS, reads="", ahead=True, sums="down",
)  # fmt: skip
def health(request: Request) -> Interval:
    """Health left of 100 % after all damage so far; never rises.

    Damage is what one evaluation costs, and there is one every Δt: ∫ damage dt / Δt. An impact is
    seen for Δt, so it costs its damage once.
    """
    from safestage_eval.evidence.measure import lost_within

    loss = damage(request)
    if not loss.known.any():
        return loss
    gap = request.facts.gaps.of_bodies(request.bodies, ALL)
    lost = None if gap is None else lost_within(request, around(gap))
    seconds = np.diff(request.episode.t, prepend=request.episode.t[0])

    def left(damage: F64) -> F64:
        return np.maximum(1 - np.cumsum(damage * seconds) / _over(request), 0.0)

    if lost is None and loss.lower is loss.upper:
        return request.exact(left(loss.lower), loss.notes)
    least, most = loss.lower, loss.upper
    if lost is not None:  # whatever happened meanwhile: from nothing to all
        least, most = np.where(lost, 0.0, least), np.where(lost, 1.0, most)
    return Interval(left(most), left(least), request.dimension, loss.notes)


def _over(request: Request) -> float:
    """s, the time over which a change of velocity is one impact."""
    assert request.over is not None  # it has a default
    return request.over


def _change(request: Request) -> tuple[F64, tuple[str, ...]] | Interval:
    """(T, 3) m/s, change of the COM's velocity over the stated time, and notes."""
    over, t = _over(request), request.episode.t
    if len(t) > 1 and over < request.episode.dt * (1 - 1e-6):
        return request.unknown(
            f"the frames are {request.episode.dt * 1e3:.3g} ms apart: "
            f"a change over {over * 1e3:.3g} ms was not recorded"
        )
    velocity, notes = request.facts.com_velocity(request.bodies[0])
    before = np.column_stack([np.interp(t - over, t, axis) for axis in velocity.T])
    return velocity - before, notes
