"""Samples that are far apart: what may have happened between two of them, unseen.

``coarse`` (T,) is true where the next sample comes so late that much may happen before it. What lies between
two such samples is no sample of its own. Instead each thing that hangs on when something was so is widened
here to all that it may have been.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from safestage_eval.episode import Clock, Window
from safestage_eval.evidence.declare import is_gate
from safestage_eval.evidence.intervals import TINY, Bool, Interval, crisp, exact
from safestage_eval.evidence.reference import Reference
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.operations import OPERATIONS

from . import computed_signals
from .events import Scope
from .language import Language, limit_margin
from .windows import lasting

# ---- events


def asks_edge(node: ast.Alternative | ast.Atom) -> bool:
    """Something asks when a state starts or ends."""
    match node:
        case ast.Event():
            return node.edge is not None
        case ast.Condition():
            return any(map(asks_edge, node.atoms))
        case ast.AnyOf():
            return any(map(asks_edge, node.alternatives))
    return False


def held_before_too(margin: Interval, coarse: Bool) -> Interval:
    """What must hold when an event comes: at the sample that shows the event and the one before."""
    lower = margin.lower.copy()
    before = np.minimum(lower[1:], margin.lower[:-1])
    lower[1:] = np.where(coarse[:-1], before, lower[1:])
    return Interval(lower, margin.upper)


def perhaps_before(event: Interval, coarse: Bool) -> Interval:
    """An event; perhaps also at the frames before: what these show may have been so when it came."""
    possible = event.possible
    before = np.append(possible[1:], False) & coarse & ~possible
    return crisp(event.true, possible | before) if before.any() else event


def begun_between(what: ast.Alternative, scope: Scope, coarse: Bool) -> Scope:
    """The scope; its first frame may show an event that came before the scope began."""
    first = scope.first
    if not 0 < first < scope.stop or not coarse[first - 1] or not asks_edge(what):
        return scope
    sure = scope.certain.copy()
    sure[0] = False
    return scope._replace(sure=sure)


def ended_between(scopes: Sequence[Scope], coarse: Bool) -> list[Scope]:
    """Each scope, with the frame behind it: how far things went until the scope ended shows there alone."""
    return [
        Scope(s.first, s.stop + 1, s.cut, np.append(s.certain, False))
        if s.first < s.stop < len(coarse) and coarse[s.stop - 1]
        else s
        for s in scopes
    ]


def falls_between(event: ast.Event) -> bool:
    """The event comes between the frame at which it is seen and the one before, at any rate."""
    return event.call is not None and is_gate(event.call.name) and event.edge != "end"


def earliest(evaluator: Language, event: ast.Event, reference: Reference) -> Reference | None:
    """What a change since an event is measured from if each came as early as it may have.

    None where that is the sample that shows it.
    """
    since, coarse = reference.since, evaluator.clock.coarse
    if event.kind == "start" or falls_between(event) or since is None:
        return None
    if event.kind == "success" and evaluator.success_at_sample:
        return None
    between = (since > 0) & coarse[np.maximum(since - 1, 0)]
    if not between.any():
        return None
    return Reference(reference.baseline, since - between, f"earliest {reference.key}")


# ---- how long a state lasted


def lasts(
    evaluator: Language,
    state: ast.StateDef,
    persistent: Callable[[ast.StateDef, Window], Interval],
) -> Interval:
    """Where a state lasts for long enough; unknown where too few samples, far apart, show it.

    Args:
        evaluator: of the episode.
        state: with ``for`` or ``gap``.
        persistent: its condition, filtered as a state asks for with a window for its ``for``.
    """
    window, coarse = evaluator.window(state.for_), evaluator.clock.coarse
    found = persistent(state, window)
    if not coarse.any():
        return found
    lower, upper = found.lower, found.upper
    if state.gap is not None:  # a gap of one such sample may have been long
        apart = persistent(replace(state, gap=None), window).lower
        lower = np.where(coarse, np.minimum(lower, apart), lower)
    if state.for_ is not None:
        strict = evaluator.clock.surely(lasting(evaluator.duration(state.for_)))
        lower = np.where(coarse, np.minimum(lower, persistent(state, strict).lower), lower)
        if window.loose is not window:
            perhaps = persistent(state, window.loose).upper
            upper = np.where(coarse, np.maximum(upper, perhaps), upper)
    return Interval(lower, upper)


def hidden_touch(
    evaluator: Language, state: ast.StateDef, bodies: tuple[str, ...], seconds: float
) -> Bool | None:
    """(T,) where the state may hold for ``seconds`` between a sample and the next; None: nowhere."""
    clock, relations = evaluator.clock, evaluator.relations
    coarse = clock.spacing >= seconds * (1 - 1e-6)
    if clock.unseen is not None:  # where nothing is known anyway
        coarse &= ~clock.unseen
    env, out = dict(zip(state.of, bodies, strict=True)), None
    for atom in state.when.atoms:
        if not isinstance(atom, ast.SignalAtom) or atom.call.name != "contact_force":
            continue
        asked = evaluator.asked(atom, env)
        if len(asked.bodies) != 2 or atom.limits[0].op[0] != ">":
            continue
        peak = relations.signal("peak_force", asked.bodies)
        out = relations.may_touch_between(*asked.bodies, coarse)
        reached = limit_margin(exact(peak.lower, peak.dimension), ">=", asked.limits[0], 1.0)
        out = out | (coarse & reached.possible)
        if out.any():
            first, t = int(out.argmax()), evaluator.episode.t
            evaluator.notes[
                f"{asked.bodies[0]} may have touched {asked.bodies[1]} between "
                f"{apart(clock, first)}, at {t[first]:.2f} s"
            ] = None
    return out


# ---- how far a signal went


def further(evaluator: Language, name: str, bodies: tuple[str, ...], frame: int) -> float | None:
    """How much further (SI) a signal may have gone between a frame and its neighbours.

    For distances, and what is computed from them frame by frame; None for other signals. A
    derivative is the mean over the time between two samples, and an integral a sum.
    """
    computed = evaluator.rules.derived.get(name)
    if computed is None:
        return evaluator.relations.between_frames(name, bodies, frame)
    if not OPERATIONS[computed.operation].pointwise:
        return None
    asked = computed_signals.measurements(evaluator, computed, bodies)
    each = [further(evaluator, one.name, one.bodies, frame) for one in asked]
    known = [one for one in each if one is not None]
    if not known or computed.operation != "product":
        return sum(known) if known else None
    if len(each) > 1:
        return np.inf
    numbers = [n for n in computed.operands if isinstance(n, ast.Quantity | ast.Parameter)]
    return known[0] * float(np.prod([abs(evaluator.number(n, {})) for n in numbers]))


def lowest(margin: float, apart: float, slack: float) -> float:
    """How low a margin (normalised) that is met at a sample may be beside it.

    Args:
        margin: at the sample.
        apart: m, how far the value is from its limit there.
        slack: m, how much further it may have gone.
    """
    return min(margin * (1 - slack / max(apart, np.finfo(float).tiny)), -TINY)


# ---- in words


def apart(clock: Clock, frame: int) -> str:
    """``two samples that are 40 ms apart``: a frame and the one behind it."""
    return f"two samples that are {clock.spacing[frame] * 1e3:.0f} ms apart"


def wider(clock: Clock, frame: int) -> int:
    """The frame or the one before it: that behind which the next comes later."""
    first = max(frame - 1, 0)
    return first + int(clock.spacing[first : frame + 1].argmax())
