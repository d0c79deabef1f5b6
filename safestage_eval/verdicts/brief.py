"""States that were true too briefly to count: a touch of 17 ms is not counted, and yet not hidden."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.runs import runs
from safestage_eval.evidence import intervals
from safestage_eval.evidence.intervals import Bool, Interval
from safestage_eval.rules import syntax as ast

from .evaluate import Evaluated, Evaluator
from .obligations import Instance, wanted


class _Way(NamedTuple):
    """One way to break a rule: something that is forbidden, or all that is required.

    Attributes:
        tree: it, over the episode.
        wanted: it breaks the rule where it does not hold.
    """

    tree: Evaluated
    wanted: bool


def too_brief(evaluator: Evaluator, instances: Sequence[Instance]) -> list[str]:
    """A note per state that would break the rule in a scope, but did not hold as long as it must."""
    notes = dict[str, None]()
    for instance in instances:
        for way in _ways(instance):
            for state, edge in _filtered(evaluator, way.tree, way.wanted):
                ignored = _ignored(evaluator, way, state, edge, instance)
                if len(ignored):
                    longest = ignored[int(np.argmax(ignored[:, 1] - ignored[:, 0]))]
                    notes[_note(evaluator, state, *longest.tolist())] = None
    return list(notes)


def _note(evaluator: Evaluator, state: Evaluated, first: int, stop: int) -> str:
    """On a state that was true in the frames [first, stop), and did not certainly count."""
    lasted, at = evaluator.clock.seconds(first, stop), f"{evaluator.episode.t[first]:.2f} s"
    assert isinstance(state.node, ast.Call)
    if evaluator.must_not(state.node, {}, "forbid", "forbid").margin.upper[first] < 0:
        return f"{state.node} held for {lasted * 1e3:.0f} ms at {at}: too brief to count"
    apart = evaluator.clock.spacing[first] * 1e3
    return (
        f"{state.node} held at {at} in {stop - first} of the samples, which are {apart:.0f} ms "
        "apart: whether it lasted long enough to count is not known"
    )


def raw_frames(evaluator: Evaluator, instances: Sequence[Instance]) -> Bool | None:
    """(T,) where something broke a rule, however briefly, in the scope of an instance.

    Without the ``for`` of the rule, and without ``for`` and ``gap`` of the states that it names. None
    for a rule that no state breaks.
    """
    out, some = np.zeros(evaluator.frames, np.bool_), False
    for instance in instances:
        first, stop, _, sure = instance.scope
        for way in _ways(instance):
            some = True
            if way.wanted and not any(_filtered(evaluator, *way)):
                continue
            true = _raw(evaluator, way)[first:stop]
            out[first:stop] |= true if sure is None else true & sure
    return out if some else None


def _ways(instance: Instance) -> Iterator[_Way]:
    """All ways to break a rule through states that hold, or do not; the forbidden ones first."""
    for met in sorted(instance.met, key=lambda m: wanted(m.clause.kind)):
        tree, kind = met.tree, met.clause.kind
        if kind == "forbid":
            several = tree.children[0] if len(tree.children) == 1 else tree
            one_of = isinstance(tree.node, ast.Condition) and isinstance(several.node, ast.AnyOf)
            # a list of forbidden things was made one condition of alternatives
            parts = several.children if one_of and len(several.children) > 1 else (tree,)
            yield from (_Way(part, False) for part in parts)
        elif kind == "require" and any(
            isinstance(child.node, ast.AnyOf)
            or (isinstance(child.node, ast.StateAtom) and not child.node.want)
            for child in tree.children
        ):
            yield _Way(tree, True)


def _filtered(
    evaluator: Evaluator, tree: Evaluated, required: bool
) -> Iterator[tuple[Evaluated, str | None]]:
    """States that must last to count, and break the rule where they hold; each with its edge."""
    if isinstance(tree.node, ast.Condition | ast.AnyOf):
        for child in tree.children:
            yield from _filtered(evaluator, child, required)
        return
    state = _breaking(evaluator, tree, required)
    if state is not None:
        yield state, tree.node.edge if isinstance(tree.node, ast.Event) else None


def _breaking(evaluator: Evaluator, tree: Evaluated, required: bool) -> Evaluated | None:
    """The state that a part names, if it must last to count and breaks the rule where it holds."""
    node = tree.node
    named = (isinstance(node, ast.Event) and not required and node.call is not None) or (
        isinstance(node, ast.StateAtom) and node.want != required
    )
    if not named or not tree.children:
        return None
    call = tree.children[0].node
    assert isinstance(call, ast.Call)
    state = evaluator.rules.states.get(call.name)
    lasts = state is not None and state.for_ is not None and state.until is None
    return tree.children[0] if lasts else None


def _ignored(
    evaluator: Evaluator, way: _Way, state: Evaluated, edge: str | None, instance: Instance
) -> NDArray[np.int64]:
    """(R, 2) stretches in which a state held, and broke the rule in a scope if it had counted."""
    first, stop, _, _ = instance.scope
    assert state.raw is not None  # a declared state
    assert isinstance(state.node, ast.Call)
    raw, counted = state.raw.lower >= 0, evaluator.state(state.node, {}).margin.true
    if edge is None:
        raw = raw[first:stop]
        if not raw.any():
            return runs(raw)
        if not isinstance(way.tree.node, ast.Event):
            raw = raw & _raw(evaluator, way)[first:stop]
        return first + runs(raw & ~counted[first:stop])
    stretches = runs(raw & ~counted)
    at = stretches[:, 0 if edge == "start" else 1]
    return stretches[(at >= first) & (at < stop)]


def _raw(evaluator: Evaluator, way: _Way) -> Bool:
    """(T,) where the rule is broken for sure, as if every state held from its first true frame."""
    margin = _unfiltered(evaluator, *way)
    return margin.upper < 0 if way.wanted else margin.lower >= 0


def _unfiltered(evaluator: Evaluator, tree: Evaluated, required: bool) -> Interval:
    """(T,) a part of a rule, of whose states those that break it hold as they are measured."""
    if isinstance(tree.node, ast.Condition | ast.AnyOf):
        parts = [_unfiltered(evaluator, child, required) for child in tree.children]
        fold = intervals.both if isinstance(tree.node, ast.Condition) else intervals.either
        return fold(parts, evaluator.frames)
    state = _breaking(evaluator, tree, required)
    if state is None or state.raw is None:
        return tree.margin
    if isinstance(tree.node, ast.Event) and tree.node.edge is not None:
        true = state.raw.lower >= 0
        before = np.concatenate([np.zeros(1, np.bool_), true[:-1]])
        return intervals.crisp(true & ~before if tree.node.edge == "start" else before & ~true)
    return intervals.opposite(state.raw) if required else state.raw
