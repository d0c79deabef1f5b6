"""Why a verdict is inconclusive: the one thing that was not known where it is decided."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from textwrap import shorten
from typing import NamedTuple

import numpy as np

from safestage_eval.episode import Clock
from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import Bool
from safestage_eval.evidence.missing_values import POSE, TWIST
from safestage_eval.rules import syntax as ast

from . import between_samples as samples
from . import since as changes
from .evaluate import Evaluated, Evaluator
from .explain import seconds
from .language import Env, ends_with_success
from .obligations import Instance
from .players import nodes
from .scopes import initial_state
from .witness import since

REMEDIES = (
    ("touched it was not recorded", "record all contacts, and all bodies of the robot"),
    ("contradict", "correct the recording as the note on the episode says"),
    ("is NaN from", "record its poses and velocities at every frame"),
    ("is infinite from", "look for a division by zero, or write NaN for what was not measured"),
    ("recording ends", "record the rollout to its end, and on until everything is at rest"),
    ("recorded between", "record every frame"),
    ("recorded before", "record from the start of the episode on"),
    ("scope ended between", "record more frames"),
    ("came between two samples", "record more frames"),
    ("between two samples", "record more frames, and peaks over all physics steps"),
    ("finger", "say in the trace which bodies are the left and the right finger"),
    ("contact force", "record contact forces"),
    ("shape", "record the collision shapes of the bodies"),  # its note also speaks of masses
    ("mass", "record the masses of the bodies"),
    ("up axis", "say in the trace which axis of the body points up, or that none does"),
    ("inside", "declare the cavity of the container"),
    ("cavity", "declare the cavity of the container"),
    ("goal", "record native success, or name a goal in the header or a --bind file"),
    ("joint", "record the joints of the robot and of what it opens"),
    ("gripper", "record the gripper, and say which bodies it is made of"),
    ("robot", "record the bodies of the robot"),
    ("channel", "record this channel"),
)
"""Word in a cause → what would remedy it; the first that fits."""


GAP = "was not measured"
"""In what signals and relations say of frames at which something that they rest on is missing."""

GOAL_UNKNOWN = "whether and when the goal was reached is not known"

LONGEST = 160
"""Characters of a cause; a robot has many links without a shape."""


class Cause(NamedTuple):
    """The unknown thing, and its remedy, which may be empty."""

    what: str
    remedy: str


UNNAMED = Cause("", "")


def cause_of(evaluator: Evaluator, rule: ast.Rule, worst: Instance) -> Cause:
    """The cause of an inconclusive verdict; ``worst``: the instance that leaves it open."""
    env, scope = worst.env, worst.scope
    if worst.scope.cut and worst.clause is not None:
        return _too_short(evaluator, rule)
    if worst.clause is None and rule.given is not None:
        return _named(_at_start(evaluator, rule.given, env))
    if not scope.certain[worst.frame - scope.first]:
        return _named(_in_scope(evaluator, rule, env, worst.frame))
    if worst.clause is None:
        return _named("")
    cause = _in(evaluator, worst.tree, worst.frame)
    if GAP in cause:
        cause = _not_measured(evaluator, env, worst.frame) or cause
    hidden = [body for body, column in sorted(evaluator.episode.doubtful) if column == "mass"]
    if "no mass of" in cause and hidden:  # it has one, which is not believed
        cause = f"the mass of {', '.join(hidden)} is not used: it contradicts other columns"
    return _named(cause)


def _at_start(evaluator: Evaluator, given: ast.Condition, env: Env) -> str:
    """The unknown thing that leaves open whether a condition holds in the initial state."""
    initial = initial_state(evaluator, env)
    if initial is None:
        return _in(evaluator, evaluator.evaluate(given, env), 0)
    if initial.missing:
        return _hole(evaluator, initial.last)
    tree = evaluator.evaluate(given, env, None, initial.mask(evaluator.frames))
    causes = (_in(evaluator, tree, frame) for frame in range(initial.first, initial.last))
    apart = _apart(evaluator, initial.first) if initial.coarse else ""
    return next(filter(None, causes), f"how it began is not known{apart}")


def _not_measured(evaluator: Evaluator, env: Env, frame: int) -> str:
    """Which pose or velocity of an instance's bodies is NaN or not used; empty if none is."""
    gaps, t = evaluator.relations.signals.gaps, evaluator.episode.t
    for body in env.values():
        for column in (*POSE, *TWIST) if body in evaluator.episode.tracks else ():
            lost = gaps.of_body(body, [column])
            if lost is None or not lost.any():
                continue
            name = column.replace("_", " ")
            if (body, column) in evaluator.episode.doubtful:
                return f"the {name} of {body} is not used: it contradicts other columns"
            spans = runs(lost)
            first, stop = min(spans, key=lambda s: max(s[0] - frame, frame + 1 - s[1]))
            begin, end = seconds(float(t[first])), seconds(float(t[stop - 1]))
            values = getattr(gaps.given.track(body), column)[first:stop]
            number = "infinite" if np.isinf(values).any() else "NaN"
            return f"the {name} of {body} is {number} from {begin} to {end}"
    return ""


def between_samples(what: str, clock: Clock, frame: int) -> Cause:
    """That something near its limit at a sample may have gone beyond it before the next one."""
    between = samples.apart(clock, samples.wider(clock, frame))
    return Cause(f"{what} may have gone beyond its limit between {between}", "record more frames")


def _named(what: str) -> Cause:
    remedies = (remedy for word, remedy in REMEDIES if word in what)
    return Cause(shorten(what, LONGEST, placeholder=" …"), next(remedies, ""))


def _too_short(evaluator: Evaluator, rule: ast.Rule) -> Cause:
    """The recording ends before what is judged does."""
    episode = evaluator.episode
    end, success = float(episode.t[-1]), episode.header.success_time
    if success is not None and success > end + 1e-6:
        return Cause(
            f"the recording ends at {seconds(end)}, before its success at {seconds(success)}",
            "record on until after success",
        )
    if not evaluator.success_known and [*_after_success(evaluator, rule.during)]:
        return _named(GOAL_UNKNOWN)
    hold = max(_after_success(evaluator, rule.during), default=None)
    if hold is not None and evaluator.success is not None:
        since = end - float(episode.t[evaluator.success])
        return Cause(
            f"the recording ends {seconds(since)} after success; {rule.code} needs {hold:g} s",
            f"record at least {hold:g} s after success",
        )
    if ends_with_success(episode):
        return _named(
            f"the recording ends with success at {seconds(end)}, and something still moved"
        )
    return _named(f"the recording ends at {seconds(end)}, before the rollout did")


def _after_success(evaluator: Evaluator, span: ast.Span | None) -> Iterator[float]:
    """How long (s) after success a span needs to be recorded."""
    for node in nodes(span):
        if isinstance(node, ast.PhaseSpan):
            yield from _after_success(evaluator, evaluator.rules.phases[node.call.name].span)
        elif (
            isinstance(node, ast.Around) and node.which == "after" and node.event.kind == "success"
        ):
            lasts = node.duration
            value = evaluator.params[lasts.name] if isinstance(lasts, ast.Parameter) else lasts
            if isinstance(value, ast.Quantity):
                yield value.value
            else:
                yield value.amount * (evaluator.episode.dt if value.frames else 1)


def _in_scope(evaluator: Evaluator, rule: ast.Scoped, env: Env, frame: int) -> str:
    """The unknown thing that leaves the scope of a rule open."""
    for event in _events(evaluator, (rule.during, rule.at, rule.until), env):
        cause = _in_event(evaluator, *event, frame)
        if cause:
            return cause
    when, apart = _when(evaluator, frame), _apart(evaluator, frame - 1) if frame else ""
    if apart:
        return f"its scope ended{apart}, and what went on until then shows at {when} alone"
    return f"whether {when} belongs to its scope is not known"


def _events(evaluator: Evaluator, parts: object, env: Env) -> Iterator[tuple[ast.Event, Env]]:
    """The events that spans hang on, each with the bodies of its roles."""
    for node in nodes(parts):
        if isinstance(node, ast.PhaseSpan):
            phase = evaluator.rules.phases[node.call.name]
            bodies = [env.get(actual, actual) for actual in node.call.args]
            inner = dict(zip(phase.of, bodies, strict=True))
            yield from _events(evaluator, (phase.span, phase.fallback), inner)
        elif isinstance(node, ast.StateSpan | ast.While):
            yield ast.Event("state", call=node.call), env
        elif isinstance(node, ast.Event):
            yield node, env


def _in_event(evaluator: Evaluator, event: ast.Event, env: Env, frame: int) -> str:
    if event.kind == "success" and not evaluator.success_known:
        return GOAL_UNKNOWN
    if event.call is None:
        return ""
    return _in(evaluator, evaluator.state(event.call, env), frame)


def _in(evaluator: Evaluator, tree: Evaluated, frame: int) -> str:
    """The unknown thing that leaves a part of a rule open at a frame; empty if none does."""
    node = tree.node
    if isinstance(node, ast.SignalAtom):
        return _in_signal(evaluator, node, tree, frame) if tree.margin.unknown[frame] else ""
    if isinstance(node, ast.Call):
        return _in_state(evaluator, node, frame)
    if isinstance(node, ast.Event) and node.call is None:
        return _in_event(evaluator, node, tree.env, frame)
    if isinstance(node, ast.Condition) and not tree.margin.unknown[frame]:
        return ""
    children = tree.children
    if isinstance(node, ast.Condition):
        children = tuple(child for child in children if child.margin.unknown[frame])
    return next(filter(None, (_in(evaluator, child, frame) for child in children)), "")


def _in_signal(evaluator: Evaluator, atom: ast.SignalAtom, tree: Evaluated, frame: int) -> str:
    env, relations, series = tree.env, evaluator.relations, tree.series
    asked = evaluator.asked(atom, env)
    assert series is not None
    hole = _hole(evaluator, frame)
    if hole:
        return hole
    if evaluator.clock.late and (atom.since is not None or evaluator.signal(asked.name).from_start):
        return f"nothing was recorded before {seconds(float(evaluator.episode.t[1]))}"
    if atom.since is not None:
        reference, when = changes.reference_of(evaluator, atom.since, env)
        if when is not None:
            cause = _in_event(evaluator, atom.since, env, frame)
            if cause:
                return cause
        earlier = None if when is not None else samples.earliest(evaluator, atom.since, reference)
        if earlier is not None and earlier.since is not None and reference.since is not None:
            came = int(earlier.since[frame])
            if came != reference.since[frame]:
                measured = f"{ast.Call(atom.call.name, asked.bodies)}{since(atom, env)}"
                return f"{measured} is not known: that came{_apart(evaluator, came)}"
    remedied = [note for note in series.notes if _remedied(note)]
    if remedied:
        return remedied[-1]
    if relations.unweighed:
        return f"the trace has no mass of {', '.join(relations.unweighed)}"
    call, time = ast.Call(atom.call.name, asked.bodies), _when(evaluator, frame)
    if series.notes:
        return f"{series.notes[-1]}, so {call} has no value at {time}"
    return f"{call} is not known{_apart(evaluator, frame)} at {time}"


def _in_state(evaluator: Evaluator, call: ast.Call, frame: int) -> str:
    """The unknown thing that leaves a state or relation open at a frame, or at the nearest open one."""
    whole = evaluator.state(call, {})  # not only at the frames that mattered
    open_ = whole.margin.unknown
    if not open_.any():
        return ""
    frame = _nearest(open_, frame)
    state = evaluator.rules.states.get(call.name)
    if state is None:
        return _in_relation(evaluator, call.name, call.args, frame)
    source = whole.children[0]
    if source.margin.unknown.any():
        cause = _in(evaluator, source, _nearest(source.margin.unknown, frame))
        if cause:
            return cause
    if state.until is not None:
        cause = _in_event(evaluator, state.until, whole.env, frame)
        if cause:
            return cause
    apart = _apart(evaluator, frame)
    if apart:
        return f"how long {call} lasted is not known{apart}, at {_when(evaluator, frame)}"
    end = seconds(float(evaluator.episode.t[-1]))
    return f"the recording ends at {end}, and {call} may have lasted"


def _in_relation(evaluator: Evaluator, name: str, bodies: Sequence[str], frame: int) -> str:
    relations = evaluator.relations
    hole = _hole(evaluator, frame)
    if hole:
        return hole
    told = relations.told(name, bodies)
    if told.lower[frame] < told.upper[frame] and told.notes:
        return told.notes[-1]
    said = ast.Call(name, tuple(bodies))
    return f"{said} is not known at {seconds(float(evaluator.episode.t[frame]))}"


def _hole(evaluator: Evaluator, frame: int) -> str:
    """Where nothing was recorded at a frame: since when, and until when."""
    episode = evaluator.episode
    unseen: Bool | None = getattr(episode, "unseen", None)
    if unseen is None or not unseen[frame]:
        return ""
    first, stop = next((a, b) for a, b in runs(unseen) if a <= frame < b)
    begin, end = (float(episode.t[i]) for i in (max(first - 1, 0), min(stop, len(episode) - 1)))
    return f"nothing was recorded between {seconds(begin)} and {seconds(end)}"


def _when(evaluator: Evaluator, frame: int) -> str:
    return seconds(float(evaluator.episode.t[frame]))


def _apart(evaluator: Evaluator, frame: int) -> str:
    """That the next sample comes late, in words; empty where it does not."""
    coarse = evaluator.clock.coarse[frame]
    return f" between {samples.apart(evaluator.clock, frame)}" if coarse else ""


def _nearest(frames: Bool, frame: int) -> int:
    at = frames.nonzero()[0]
    return int(at[np.argmin(np.abs(at - frame))])


def _remedied(note: str) -> bool:
    return any(word in note for word, _ in REMEDIES)
