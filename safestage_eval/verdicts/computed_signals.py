"""Signals that rules compute from others: as intervals, from all that their operands may be."""

from __future__ import annotations

import numpy as np

from safestage_eval.evidence.interval_arithmetic import (
    AT_REST,
    Ends,
    change_per_second,
    change_within,
    combined,
    sparc,
    summed_over_time,
)
from safestage_eval.evidence.intervals import Bool, Interval, exact
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.operations import OPERATIONS

from .language import Asked, Env, Language, ends_early

FAR = 1e3
"""m, up to where a distance is measured exactly that something is computed from."""


def series_of(
    evaluator: Language,
    computed: ast.DerivedDef,
    bodies: tuple[str, ...],
    frames: Bool | None = None,
) -> Interval:
    """(T,) SI, of certain bodies; what is costly is measured at ``frames`` (T,) alone, everywhere if None."""
    if frames is not None and evaluator.is_costly(computed):
        series = _measure(evaluator, computed, bodies, frames)
    else:
        series = evaluator.once(
            computed, ("computed", *bodies), lambda: _measure(evaluator, computed, bodies, None)
        )
    evaluator.notes.update(dict.fromkeys(series.notes))
    return series


def _measure(
    evaluator: Language, computed: ast.DerivedDef, bodies: tuple[str, ...], frames: Bool | None
) -> Interval:
    """-inf for a body that lacks one of the quantities, like the quantity itself."""
    env, operation = dict(zip(computed.of, bodies, strict=True)), computed.operation
    where = frames if OPERATIONS[operation].pointwise else None
    operands = [_operand(evaluator, one, env, where) for one in computed.operands]
    notes = tuple(dict.fromkeys(note for one in operands for note in one.notes))
    if any(map(evaluator.exempt, measurements(evaluator, computed, bodies))):
        return exact(np.full(evaluator.frames, -np.inf), computed.dimension, notes)
    t = evaluator.episode.t
    if operation == "derivative" and computed.over is not None:
        ends = _change_over(evaluator, operands[0], computed.over)
    elif operation == "derivative":
        ends = change_per_second(operands[0], t)
    elif operation == "sparc":
        ends = _smoothness(evaluator, operands[0], frames)
        if np.abs(operands[0].upper).max(initial=0.0) < AT_REST:
            notes += (f"{computed.name}() of what has not moved is not known",)
    elif operation == "holds":
        ends = operands[0].lower, operands[0].upper
    elif operation == "integral":
        ends = summed_over_time(operands[0], t)
        lost = ~np.isfinite(ends[0]) | ~np.isfinite(ends[1])
        if lost.any():
            since = float(t[int(lost.argmax())])
            notes += (f"what {computed.name}() adds up is not known from {since:.2f} s on",)
    else:
        ends = combined(operation, operands)
    return Interval(*ends, computed.dimension, notes)


def _change_over(evaluator: Language, of: Interval, over: ast.Duration | ast.Parameter) -> Ends:
    """Within that time around each sample; of a rollout that is still running, before it.

    Where the trace stops before its rollout did, what lies half that time before its end is open.
    """
    given, episode = evaluator.duration(over), evaluator.episode
    seconds = given.amount * (episode.dt if given.frames else 1.0)
    t = episode.t
    if evaluator.causal:
        return change_within(of, t, seconds, 0.0)
    lower, upper = change_within(of, t, seconds / 2, seconds / 2)
    if not ends_early(episode):
        return lower, upper
    open_ = t + seconds / 2 > t[-1] * (1 + 1e-9)
    return np.where(open_, -np.inf, lower), np.where(open_, np.inf, upper)


def _smoothness(evaluator: Language, of: Interval, frames: Bool | None) -> Ends:
    """SPARC of all that came before, at the frames that matter; not known behind what is not known."""
    t, dt, speed = evaluator.episode.t, evaluator.episode.dt, np.abs(of.upper)
    known = np.logical_and.accumulate(np.isfinite(speed) & (of.lower == of.upper))
    asked = known if frames is None else known & frames
    even = t[0] + dt * np.arange(len(t)) if not evaluator.clock.uniform else t
    lower, upper = np.full(len(t), -np.inf), np.zeros(len(t))
    for frame in np.flatnonzero(asked):
        some = speed[: frame + 1]
        if even is not t:
            some = np.interp(even[even <= t[frame] + 1e-9], t[: frame + 1], some)
        lengths = sparc(some, dt)
        if lengths is not None:
            lower[frame] = upper[frame] = lengths
    return lower, upper


def _operand(evaluator: Language, operand: ast.Operand, env: Env, frames: Bool | None) -> Interval:
    if isinstance(operand, ast.StateAtom):
        margin = evaluator.state(operand.call, env, frames).margin
        sure = margin.true.astype(np.float64)
        if not margin.unknown.any():
            return Interval(sure, sure, "ratio")
        return Interval(sure, margin.possible.astype(np.float64), "ratio")
    if isinstance(operand, ast.SignalAtom):
        return evaluator.measured_series(_asked(evaluator, operand, env), operand, env, frames)
    return exact(np.full(evaluator.frames, evaluator.number(operand, env)), "")


def _asked(evaluator: Language, operand: ast.SignalAtom, env: Env) -> Asked:
    """The measurement behind an operand: a distance exactly, however far."""
    name, bodies, options = evaluator.measured(operand.call, env)
    far = FAR if evaluator.signal(name).capped else 0.0
    return Asked(name, bodies, options, (0.0,), far)


def measurements(
    evaluator: Language, computed: ast.DerivedDef, bodies: tuple[str, ...]
) -> list[Asked]:
    """The signals that it is computed from."""
    env = dict(zip(computed.of, bodies, strict=True))
    signals = [one for one in computed.operands if isinstance(one, ast.SignalAtom)]
    return [_asked(evaluator, one, env) for one in signals]
