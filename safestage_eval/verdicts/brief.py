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
from safestage_eval.rules.clauses import CLAUSES

from .evaluate import Evaluated, Evaluator
from .events import Scope, edges
from .obligations import Instance

States = list[tuple[Evaluated, str | None]]
"""States that must last to count, and break the rule where they hold; each with its edge."""


class Way(NamedTuple):
    """One way to break a rule in a scope: something that is forbidden, or all that is required.

    Attributes:
        scope: where it counts.
        tree: it, over the episode.
        wanted: it breaks the rule where it does not hold.
        broken: (T,) where it breaks the rule for sure, as if every state held from its first true frame.
        states: those whose lasting that leaves out.
    """

    scope: Scope
    tree: Evaluated
    wanted: bool
    broken: Bool
    states: States


def ways(evaluator: Evaluator, instances: Sequence[Instance]) -> list[Way]:
    """All ways to break a rule through states that hold, or do not."""
    return [
        Way(instance.scope, tree, required, margin.false if required else margin.true, states)
        for instance in instances
        for tree, required in _breaking_parts(instance)
        for margin, states in [_unfiltered(evaluator, tree, required)]
    ]


def too_brief(evaluator: Evaluator, found: Sequence[Way]) -> list[str]:
    """A note per state that would break the rule in a scope, but did not hold as long as it must."""
    notes = dict[str, None]()
    for way in found:
        for state, edge in way.states:
            ignored = _ignored(evaluator, way, state, edge)
            if len(ignored):
                longest = ignored[int(np.argmax(ignored[:, 1] - ignored[:, 0]))]
                notes[_note(evaluator, state, *longest.tolist())] = None
    return list(notes)


def raw_frames(evaluator: Evaluator, found: Sequence[Way]) -> Bool | None:
    """(T,) where something broke a rule, however briefly, in the scope of an instance.

    Without the ``for`` of the rule, and without ``for`` and ``gap`` of the states that it names. None
    for a rule that no state breaks.
    """
    if not found:
        return None
    out = np.zeros(evaluator.frames, np.bool_)
    for way in found:
        first, stop, _, sure = way.scope
        if way.states or not way.wanted:
            true = way.broken[first:stop]
            out[first:stop] |= true if sure is None else true & sure
    return out


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


def _breaking_parts(instance: Instance) -> Iterator[tuple[Evaluated, bool]]:
    """What breaks a rule where it holds, and where it does not (true); the forbidden first."""
    for met in sorted(instance.met, key=lambda m: CLAUSES[m.clause.kind].wanted):
        tree, kind = met.tree, met.clause.kind
        if kind == "forbid":
            several = tree.children[0] if len(tree.children) == 1 else tree
            one_of = isinstance(tree.node, ast.Condition) and isinstance(several.node, ast.AnyOf)
            # a list of forbidden things was made one condition of alternatives
            parts = several.children if one_of and len(several.children) > 1 else (tree,)
            yield from ((part, False) for part in parts)
        elif kind == "require" and any(
            isinstance(child.node, ast.AnyOf)
            or (isinstance(child.node, ast.StateAtom) and not child.node.want)
            for child in tree.children
        ):
            yield tree, True


def _unfiltered(evaluator: Evaluator, tree: Evaluated, required: bool) -> tuple[Interval, States]:
    """(T,) a part of a rule, of whose states those that break it hold as they are measured; and these."""
    node = tree.node
    if isinstance(node, ast.Condition | ast.AnyOf):
        parts = [_unfiltered(evaluator, child, required) for child in tree.children]
        fold = intervals.both if isinstance(node, ast.Condition) else intervals.either
        margin = fold([one for one, _ in parts], evaluator.frames)
        return margin, [state for _, some in parts for state in some]
    named = (isinstance(node, ast.Event) and not required and node.call is not None) or (
        isinstance(node, ast.StateAtom) and node.want != required
    )
    state = tree.children[0] if named and tree.children else None
    if state is None or state.raw is None or not _must_last(evaluator, state):
        return tree.margin, []
    if isinstance(node, ast.Event) and node.edge is not None:
        true = intervals.crisp(state.raw.true)
        return edges(true, node.edge), [(state, node.edge)]
    return intervals.opposite(state.raw) if required else state.raw, [(state, None)]


def _must_last(evaluator: Evaluator, state: Evaluated) -> bool:
    assert isinstance(state.node, ast.Call)
    declared = evaluator.rules.states.get(state.node.name)
    return declared is not None and declared.for_ is not None and declared.until is None


def _ignored(
    evaluator: Evaluator, way: Way, state: Evaluated, edge: str | None
) -> NDArray[np.int64]:
    """(R, 2) stretches in which a state held, and broke the rule in a scope if it had counted."""
    first, stop, _, _ = way.scope
    assert state.raw is not None  # a declared state
    assert isinstance(state.node, ast.Call)
    held = state.raw.true
    if edge is None:
        held = held.copy()
        held[:first], held[stop:] = False, False
        if not isinstance(way.tree.node, ast.Event):
            held &= way.broken
    if not held.any():
        return np.zeros((0, 2), np.int64)
    stretches = runs(held & ~evaluator.state(state.node, {}, held).margin.true)
    if edge is None:
        return stretches
    at = stretches[:, 0 if edge == "start" else 1]
    return stretches[(at >= first) & (at < stop)]
