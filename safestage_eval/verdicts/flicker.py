"""What was true too briefly to count: the raw side of a filtered state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states.persistence import runs

from .evaluate import Evaluator
from .instance import Instance


def too_brief(evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Instance]) -> list[str]:
    """A note per forbidden state that held in a scope, but not for as long as it must.

    So that a touch of 17 ms is not counted, and yet not hidden.
    """
    notes = dict[str, None]()
    for instance in instances:
        first, stop, _, _ = instance.scope
        for call in _forbidden_states(evaluator, rule):
            bodies = tuple(instance.env.get(arg, arg) for arg in call.args)
            state = evaluator.rules.states[call.name]
            inner = dict(zip(state.of, bodies, strict=True))
            raw = evaluator.condition(state.when, inner).true[first:stop]
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


def _forbidden_states(evaluator: Evaluator, rule: ast.Rule) -> Iterator[ast.Call]:
    for what in rule.forbid:
        if isinstance(what, ast.Event) and what.call is not None and what.edge is None:
            state = evaluator.rules.states.get(what.call.name)
            if state is not None and state.for_ is not None and state.until is None:
                yield what.call
