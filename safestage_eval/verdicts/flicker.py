"""What was true too briefly to count: the raw side of a filtered state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Bool
from safestage_eval.states.persistence import runs

from .evaluate import Evaluator
from .instance import Instance


def too_brief(evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Instance]) -> list[str]:
    """A note per forbidden state that held in a scope, but not for as long as it must.

    So that a touch of 17 ms is not counted, and yet not hidden.
    """
    notes = dict[str, None]()
    filtered = list(_forbidden_states(evaluator, rule))
    for instance in instances:
        first, stop, _, _ = instance.scope
        for call in filtered:
            bodies = tuple(instance.env.get(arg, arg) for arg in call.args)
            raw = evaluator.momentary(call.name, bodies).lower[first:stop] >= 0
            if not raw.any():
                continue
            ignored = runs(raw & ~evaluator.state(call, instance.env).true[first:stop])
            if len(ignored):
                longest = ignored[int(np.argmax(ignored[:, 1] - ignored[:, 0]))]
                lasted = (longest[1] - longest[0]) * evaluator.episode.dt
                at = evaluator.episode.t[first + longest[0]]
                notes[
                    f"{ast.Call(call.name, bodies)} held for {lasted * 1e3:.0f} ms at {at:.2f} s: "
                    "too brief to count"
                ] = None
    return list(notes)


def raw_frames(evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Instance]) -> Bool:
    """(T,) where something forbidden held, however briefly, in the scope of an instance.

    Without the ``for`` of the rule, and without ``for`` and ``gap`` of the states that it names.
    """
    out = np.zeros(evaluator.frames, np.bool_)
    filtered = list(_forbidden_states(evaluator, rule))
    for instance in instances:
        first, stop, _, sure = instance.scope
        for what in rule.forbid:
            call = what.call if isinstance(what, ast.Event) else None
            if call is not None and call in filtered:
                bodies = tuple(instance.env.get(arg, arg) for arg in call.args)
                found = evaluator.momentary(call.name, bodies)
            else:
                wanted = _judged(evaluator, instance) if evaluator.asks_costly(what) else None
                found = evaluator.alternative(what, instance.env, wanted)
            true = found.lower[first:stop] >= 0
            out[first:stop] |= true if sure is None else true & sure
    return out


def _judged(evaluator: Evaluator, instance: Instance) -> Bool:
    """(T,) the frames that are certainly judged."""
    out = np.zeros(evaluator.frames, np.bool_)
    out[instance.scope.first : instance.scope.stop] = instance.scope.certain
    return out


def _forbidden_states(evaluator: Evaluator, rule: ast.Rule) -> Iterator[ast.Call]:
    for what in rule.forbid:
        if isinstance(what, ast.Event) and what.call is not None and what.edge is None:
            state = evaluator.rules.states.get(what.call.name)
            if state is not None and state.for_ is not None and state.until is None:
                yield what.call
