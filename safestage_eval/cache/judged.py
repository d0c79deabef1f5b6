"""What judging one rule again takes: the series that it compares, and the states that it names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from safestage_eval.evidence.declare import is_costly
from safestage_eval.evidence.series import Series
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import F64, Band
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.explain import mentioned_next
from safestage_eval.verdicts.players import combinations, nodes
from safestage_eval.verdicts.values import Env

from .closest import closest_of
from .entry import Value
from .names import partial_name, state_name
from .stored import kept_partial

if TYPE_CHECKING:
    from .remembered import RememberedRelations

HEAD, TIME = "judged", "t"

DEEP = 2
"""Through so many states that last (or have gaps) their own series are kept as well."""


def values_of(
    evaluator: Evaluator, rule: ast.Rule, players: Mapping[str, Sequence[str]]
) -> dict[str, Value]:
    """Everything that is kept of a rule that was judged just now.

    Nothing is measured for it: what the rule did not come to look at is left out.

    Args:
        evaluator: that judged it, with the answers that it collected.
        rule: itself.
        players: role → bodies.
    """
    relations = cast("RememberedRelations", evaluator.relations)
    found = _Found(evaluator, relations)
    instances = list(combinations(rule, players))
    for env in instances:
        for what in (rule.require, rule.forbidden, rule.reach):
            if what is not None:
                found.alternative(what, env, DEEP)
        for node in nodes(rule):
            if isinstance(node, ast.Call) and f"{{t.{node.name}}}" in rule.explain:
                found.call(node, env, 0)
        for call in mentioned_next(rule.explain):
            found.call(call, env, 0)
    episode = evaluator.episode
    head: Value = {
        "answers": evaluator.at_hand or {},
        "bodies": {
            name: [evaluator.material(name), evaluator.untilted(name)] for name in found.bodies
        },
        "closest": closest_of(evaluator, rule, instances, found.seen),
        "slacks": dict(relations.signals.slacks),
        "dt": episode.dt,
        "unseen": [] if episode.unseen is None else np.flatnonzero(episode.unseen).tolist(),
        "termination": episode.header.termination,
        "success_time": episode.header.success_time,
        "baseline": relations.signals.baseline.frames,
    }
    return {HEAD: head, TIME: _time(np.asarray(episode.t)), **found.values}


def _time(t: F64) -> Value:
    """Times (T,), or their rate where each is its number divided by that."""
    rate = round((len(t) - 1) / t[-1], 6) if len(t) > 1 and t[-1] > 0 else 1.0
    if np.array_equal(t, np.arange(len(t)) / rate):
        return {"frames": len(t), "rate": rate}
    return {"t": t}


def time_of(value: Value) -> F64:
    """(T,) s, as it is kept."""
    found: F64 = value["t"] if "t" in value else _even(value["frames"], value["rate"])
    return found


@lru_cache(maxsize=4)
def _even(frames: int, rate: float) -> F64:
    """So many times at a rate, the same for all episodes of a length."""
    out = np.arange(frames) / rate
    out.flags.writeable = False
    return out


class _Found:
    """Collects series and states as it goes through a rule."""

    def __init__(self, evaluator: Evaluator, relations: RememberedRelations) -> None:
        self._evaluator, self._relations = evaluator, relations
        self.values: dict[str, Value] = {}
        self.bodies: dict[str, None] = {}
        self.seen: dict[str, tuple[Series, float]] = {}
        """Series that are compared with limits, each with its cap, by name."""
        self._seen: set[tuple[Any, ...]] = set()

    def alternative(self, what: ast.Alternative, env: Env, deep: int) -> None:
        if isinstance(what, ast.Condition):
            for atom in what.atoms:
                self._atom(atom, env, deep)
        elif what.call is not None:
            self.call(what.call, env, deep)

    def _atom(self, atom: ast.Atom, env: Env, deep: int) -> None:
        if isinstance(atom, ast.SignalAtom):
            self._signal(atom, env)
        elif isinstance(atom, ast.StateAtom):
            self.call(atom.call, env, deep)
        elif isinstance(atom, ast.CountAtom):
            for body in self._evaluator.players.get(atom.role, ()):
                self.call(atom.call, {**env, atom.role: body}, deep)
        else:
            for what in atom.alternatives:
                self.alternative(what, env, deep)

    def _signal(self, atom: ast.SignalAtom, env: Env) -> None:
        name, bodies, options = self._evaluator.measured(atom.call, env)
        self.bodies.update(dict.fromkeys((*bodies, *env.values())))
        if atom.since is not None and atom.since.call is not None:
            self.call(atom.since.call, env, 0)
        if is_costly(name):
            partial = self._relations.partial(name, bodies, options)
            if partial is not None:
                self.values[partial_name(name, bodies, options)] = kept_partial(partial)
            return
        seen = self._relations.signals.seen = {}
        self._evaluator.series(atom, env)
        self._relations.signals.seen = None
        for key, (series, cap) in seen.items():
            self.seen[key] = series, cap
            known: Value = {"dimension": series.dimension, "notes": list(series.notes)}
            self.values[key] = known | _ends(series.lower, series.upper)

    def call(self, call: ast.Call, env: Env, deep: int) -> None:
        """A state with its margins; what it is made of if ``deep`` is left."""
        evaluator = self._evaluator
        bodies = tuple(env.get(arg, arg) for arg in call.args)
        if (call.name, bodies, deep) in self._seen:
            return
        self._seen.add((call.name, bodies, deep))
        declared = evaluator.rules.states.get(call.name)
        known = evaluator.found(call.name, bodies)
        if known is not None:
            digest = "" if declared is None else evaluator.digest(declared)
            band, notes = known
            value = {"notes": list(notes), **_ends(*band)}
            self.values[state_name(call.name, bodies, digest)] = value
        if declared is None:
            return
        lasting = (declared.for_, declared.gap, declared.until, declared.also)
        lasts = any(part is not None for part in lasting)
        if lasts and not deep:
            return
        inner = dict(zip(declared.of, bodies, strict=True))
        blind = evaluator.relations.blind
        instead = (declared.fallback, declared.perhaps) if blind else ()
        for part in (declared.when, declared.also, *instead):
            if part is not None:
                self.alternative(part, inner, deep - lasts)
        if declared.until is not None and declared.until.call is not None:
            self.call(declared.until.call, inner, 0)


def _ends(lower: Any, upper: Any) -> Value:
    return {"lower": lower} if upper is lower else {"lower": lower, "upper": upper}


def band_of(value: Value) -> Band:
    """Margins as they are kept."""
    lower: Any = value["lower"]
    return Band(lower, value.get("upper", lower))
