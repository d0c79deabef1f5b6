"""Where a rule is judged, as keys: which frames are in its scope at a value, and up to where."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Band
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.spans import may_recur, spans
from safestage_eval.verdicts.values import Env

from .flip_bands import FlipBands
from .flip_keys import certain, latched
from .flip_lasting import Undecided


class Frames(NamedTuple):
    """The frames of a scope that depends on the parameter.

    Attributes:
        inside: (T,) keys of being in it.
        cut: key of the recording ending before it does.
    """

    inside: Band
    cut: float


def frames_of(flips: FlipBands, rule: ast.Rule, env: Env) -> Frames:
    """The frames of a rule's ``during``. Raises Undecided where they have no such form."""
    if rule.at is not None or rule.until is not None or rule.during is None:
        raise Undecided("it moves single moments")
    frames = _span(flips, rule.during, env)
    if flips.at.truncated and may_recur(rule.during, flips.at):
        return frames._replace(cut=np.inf)
    return frames


def _span(flips: FlipBands, span: ast.Span, env: Env) -> Frames:
    at = flips.at
    if not flips.reads(span):
        return _known(spans(at, span, env), at.frames)
    if isinstance(span, ast.PhaseSpan):
        return _phase(flips, span, env)
    if isinstance(span, ast.StateSpan):
        keys = flips.state(span.call, env)
        return Frames(keys, float(keys.upper[-1]) if at.unfollowed else -np.inf)
    if isinstance(span, ast.FromTo):
        on, off = flips.event(span.begin, env), flips.event(span.stop, env)
        inside = Band(latched(on.lower, -off.upper), latched(on.upper, -off.lower))
        open_end = at.unfollowed if span.stop.kind == "state" else at.truncated
        return Frames(inside, float(inside.upper[-1]) if open_end else -np.inf)
    if isinstance(span, ast.While):
        outer, holds = _span(flips, span.of, env), flips.state(span.call, env)
        inside = Band(
            np.minimum(outer.inside.lower, holds.lower), np.minimum(outer.inside.upper, holds.upper)
        )
        return Frames(inside, outer.cut)
    raise Undecided("it moves the length of a stretch")


def _phase(flips: FlipBands, span: ast.PhaseSpan, env: Env) -> Frames:
    at, phase = flips.at, flips.at.rules.phases[span.call.name]
    inner = dict(zip(phase.of, (env.get(arg, arg) for arg in span.call.args), strict=True))
    if phase.fallback is None:
        return _span(flips, phase.span, inner)
    if flips.reads(phase.span):
        raise Undecided("another stretch may take its place")
    stretches = spans(at, phase.span, inner)
    if any(scope.exists for scope in stretches):
        return _known(stretches, at.frames)
    if stretches:
        raise Undecided("which stretch counts is not known")
    return _span(flips, phase.fallback, inner)


def _known(stretches: list[Scope], frames: int) -> Frames:
    """Stretches that do not depend on the parameter; none touches the next."""
    sure, possible = np.zeros(frames, np.bool_), np.zeros(frames, np.bool_)
    end = -1
    for scope in stretches:
        if scope.first <= end:
            raise Undecided("its stretches touch")
        end = scope.stop
        possible[scope.first : scope.stop] = True
        sure[scope.first : scope.stop] = scope.certain
    cut = np.inf if any(scope.cut for scope in stretches) else -np.inf
    return Frames(Band(certain(sure), certain(possible)), cut)
