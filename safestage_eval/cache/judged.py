"""What judging one rule again takes: the series that it compares, and the states that it names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from safestage_eval.geometry.clearance import Clearance
from safestage_eval.relations.measure import COSTLY
from safestage_eval.rules import syntax as ast
from safestage_eval.signals.measure import loose
from safestage_eval.signals.options import Options
from safestage_eval.signals.series import Series
from safestage_eval.states.band import F64, Band
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.instance import applies, stretches
from safestage_eval.verdicts.players import combinations, nodes
from safestage_eval.verdicts.values import Env

from .entry import Value
from .stored import kept_partial

if TYPE_CHECKING:
    from .remembered import RememberedRelations

HEAD, TIME = "judged", "t"

FEW = 64
"""Stretches of values with slack; a series with more of them is looked at whole."""
DEEP = 1
"""Through so many states that last (or have gaps) their own series are kept as well."""


def series_name(
    name: str, bodies: Sequence[str], since: str, cap: float, deep: bool, slack: float,
    options: Options,
) -> str:  # fmt: skip
    """Name of a series: what was asked of the trace."""
    return f"signal {name}{tuple(bodies)} {since} {cap} {deep} {slack} {options}"


def state_name(name: str, bodies: Sequence[str], digest: str) -> str:
    """Name of a state's margins; ``digest`` of its definition, empty for a relation."""
    return f"state {name}{tuple(bodies)} {digest}"


def partial_name(name: str, bodies: Sequence[str]) -> str:
    """Name of what was measured at some frames only."""
    return f"partial {name}{tuple(bodies)}"


def slack_name(name: str, bodies: Sequence[str], frame: int) -> str:
    """Name of what a value may differ by around a frame."""
    return f"{name}{tuple(bodies)} {frame}"


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
        found.instance = env
        for what in (rule.require, rule.forbidden, rule.reach):
            if what is not None:
                found.alternative(what, env, DEEP)
        for node in nodes(rule):
            if isinstance(node, ast.Call) and f"{{t.{node.name}}}" in rule.explain:
                found.call(node, env, 0)
    episode = evaluator.episode
    head: Value = {
        "answers": evaluator.at_hand or {},
        "bodies": {
            name: [evaluator.material(name), evaluator.untilted(name)] for name in found.bodies
        },
        "extremes": _extremes(evaluator, rule, found.ends) if len(instances) > 1 else {},
        "slacks": dict(relations.signals.slacks),
        "dt": episode.dt,
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
    found: F64 = value["t"] if "t" in value else np.arange(value["frames"]) / value["rate"]
    return found


def _extremes(
    evaluator: Evaluator, rule: ast.Rule, series: Mapping[str, tuple[Env, float, Series]]
) -> Value:
    """By series: its extremes in each scope of its bodies, and the frames at which slack was taken."""
    out: Value = {}
    for name, (env, cap, found) in series.items():
        if found.notes or applies(evaluator, rule, env) is False:
            continue
        scopes: dict[str, list[float]] = {}
        for (first, stop, _, sure), _ in stretches(evaluator, rule, env):
            if sure is None and first < stop:
                ends = (found.lower[first:stop], found.upper[first:stop])
                most = [f(end) for end in ends for f in (np.min, np.max)]
                scopes[f"{first} {stop}"] = [float(value) for value in most]
        taken = _together(loose(found, cap))
        if scopes and len(taken[0]) <= FEW:
            out[name] = {"scopes": scopes, "loose": taken}
    return out


def _together(taken: Clearance) -> list[list[float]]:
    """Lower and upper ends of intervals, those that overlap put together."""
    order = np.argsort(taken.lower, kind="stable")
    lower, upper = taken.lower[order], np.maximum.accumulate(taken.upper[order])
    apart = lower[1:] > upper[:-1]
    edge = np.ones(min(len(lower), 1), np.bool_)
    starts, ends = np.concatenate([edge, apart]), np.concatenate([apart, edge])
    return [lower[starts].tolist(), upper[ends].tolist()]


class _Found:
    """Collects series and states as it goes through a rule."""

    def __init__(self, evaluator: Evaluator, relations: RememberedRelations) -> None:
        self._evaluator, self._relations = evaluator, relations
        self.values: dict[str, Value] = {}
        self.instance: Env = {}
        self.bodies: dict[str, None] = {}
        self.ends: dict[str, tuple[Env, float, Series]] = {}
        """Series that are compared with a limit which has to be kept, with cap, by name."""
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
        name, bodies, _ = self._evaluator.measured(atom.call, env)
        self.bodies.update(dict.fromkeys((*bodies, *env.values())))
        if atom.since is not None and atom.since.call is not None:
            self.call(atom.since.call, env, 0)
        if name in COSTLY:
            partial = self._relations.partial(name, bodies)
            if partial is not None:
                self.values[partial_name(name, bodies)] = kept_partial(partial)
            return
        seen = self._relations.signals.seen = {}
        self._evaluator.series(atom, env)
        self._relations.signals.seen = None
        for key, (series, cap) in seen.items():
            if env is self.instance and atom.since is None:
                self.ends[key] = env, cap, series
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
        lasts = any(part is not None for part in (declared.for_, declared.gap, declared.until))
        if lasts and not deep:
            return
        inner = dict(zip(declared.of, bodies, strict=True))
        blind = evaluator.relations.blind
        for part in (declared.when, *((declared.fallback, declared.perhaps) if blind else ())):
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
