"""Obligations: what a rule demands of the frames that it judges, and which of them break it.

Each kind is a few lines here, and an entry in ``rules.clauses``, which says what its text may be.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.evidence.intervals import TINY, Bool, Interval
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import ClauseKind

from . import between_samples
from .evaluate import Evaluated, Evaluator
from .events import Scope, mask_of
from .language import Env
from .scopes import applies, stretches
from .windows import held_from, without_short_runs


class Margin(NamedTuple):
    """Bounds of an obligation's margin in a scope; it is broken where ``upper`` is negative.

    Attributes:
        lower, upper: normalised.
        frame: that decides, counted from the scope's start.
    """

    lower: float
    upper: float
    frame: int


class Obligation(NamedTuple):
    """One kind of obligation.

    Attributes:
        margin: from the margins (N,) of its condition in the N frames of a scope, those that are certainly
            judged ((N,), None for all: only they can break it, but all must be known to meet it), and what
            ``for`` comes to in these frames.
        broken: (N,) the frames of a scope that certainly break it; arguments alike.
        cut: its margin where the recording ends before the scope does.
        kept: the sentence of a pass that no single measurement decides; ``{begin}`` and ``{end}``
            are the times that were judged, ``{what}`` the obligation in words.
    """

    margin: Callable[[Interval, Bool | None, Window], Margin]
    broken: Callable[[Interval, Bool, Window], Bool]
    cut: Callable[[Margin], Margin]
    kept: str


def _require(margin: Interval, sure: Bool | None, lasting: Window) -> Margin:  # noqa: ARG001
    """The least margin of any frame: every one must hold."""
    if not len(margin.lower):
        return Margin(np.inf, np.inf, 0)
    upper = margin.upper if sure is None else np.where(sure, margin.upper, np.inf)
    least, lowest = int(upper.argmin()), int(margin.lower.argmin())
    frame = least if upper[least] < 0 else lowest
    return Margin(float(margin.lower[lowest]), float(upper[least]), frame)


def _forbid(margin: Interval, sure: Bool | None, lasting: Window) -> Margin:
    """How far the nearest run of the forbidden condition is from lasting long enough, negated."""
    if not len(margin.lower):
        return Margin(np.inf, np.inf, 0)
    if sure is not None:
        margin = Interval(np.where(sure, margin.lower, -np.inf), margin.upper)
    surely, possibly, frame = _nearest_run(margin, lasting)
    return Margin(-possibly if possibly != 0 else -TINY, -surely if surely != 0 else -TINY, frame)


def _reach(margin: Interval, sure: Bool | None, lasting: Window) -> Margin:
    """How near the condition comes to holding for long enough."""
    if not len(margin.lower):
        return Margin(-np.inf, -np.inf, 0)
    surely, possibly, frame = _nearest_run(margin, lasting)
    if sure is None:
        return Margin(surely, possibly, frame)
    # a stretch that is not certain may be empty, or several, each of which would have to reach it
    return Margin(-np.inf, possibly if sure.any() else np.inf, frame)


def _nearest_run(held: Interval, lasting: Window) -> Margin:
    """The greatest margin that is certainly, and possibly, kept for long enough; the deciding frame."""
    low = held_from(held.lower, lasting)
    exact = held.exact and lasting.loose is lasting
    high = low if exact else held_from(held.upper, lasting.loose)
    start, values = int(low.argmax()), held.lower
    surely = possibly = float(low[start])
    if high is not low:
        start_high = int(high.argmax())
        possibly = float(high[start_high])
        if not surely >= 0:
            start, values, lasting = start_high, held.upper, lasting.loose
    frame = start + int(values[start : lasting.stop(start)].argmin())
    return Margin(surely, possibly, frame)


OBLIGATIONS: dict[ClauseKind, Obligation] = {
    "require": Obligation(
        _require,
        lambda margin, sure, lasting: margin.false & sure,  # noqa: ARG005
        lambda margin: margin._replace(lower=-np.inf),
        "Held from {begin} to {end}: {what}.",
    ),
    "forbid": Obligation(
        _forbid,
        lambda margin, sure, lasting: (
            without_short_runs(np.where(sure, margin.lower, -np.inf), lasting) >= 0
        ),
        lambda margin: margin._replace(lower=-np.inf),
        "No {what}, {begin} to {end}.",
    ),
    "reach": Obligation(
        _reach,
        lambda margin, sure, lasting: np.full(  # noqa: ARG005
            len(margin.lower), held_from(margin.upper, lasting.loose).max(initial=-np.inf) < 0
        ),
        lambda margin: margin._replace(upper=np.inf),  # it may be reached yet
        "Reached between {begin} and {end}: {what}.",
    ),
}


class Met(NamedTuple):
    """One obligation in one scope.

    Attributes:
        clause: the obligation.
        tree: its condition over the episode.
        margin: bounds of its margin; its frame counts from the scope's start.
    """

    clause: ast.Clause
    tree: Evaluated
    margin: Margin


class Instance(NamedTuple):
    """A rule on one combination of bodies in one scope.

    Attributes:
        env: role → body.
        scope: the frames that were judged.
        lower, upper: bounds of the margin; negative upper is a violation.
        clause: the decisive obligation; None where something needed is unknown.
        frame: where it is decided.
        met: all its obligations.
        resolved: for a rule with ``until``: the frame at which that came, None if never.
    """

    env: Env
    scope: Scope
    lower: float
    upper: float
    clause: ast.Clause | None
    frame: int
    met: tuple[Met, ...]
    resolved: int | None = None

    @property
    def violated(self) -> bool:
        """Certainly violated."""
        return self.upper < 0

    @property
    def undecided(self) -> bool:
        """Neither certainly violated nor certainly not."""
        return self.lower < 0 <= self.upper

    @property
    def tree(self) -> Evaluated:
        """The condition of the decisive obligation."""
        return next(met.tree for met in self.met if met.clause is self.clause)


def judge_instances(evaluator: Evaluator, rule: ast.Rule, env: Env) -> list[Instance] | None:
    """The rule for one combination of bodies, once per scope.

    None when ``given`` did not hold in the baseline: the rule does not apply to these bodies.
    """
    given = applies(evaluator, rule, env)
    if given is False:
        apart = [env[role] for role, spec in rule.roles if spec.every and role in env]
        if apart:
            evaluator.notes[f"not judged of {', '.join(apart)}: its given does not hold there"] = (
                None
            )
        return None
    found = [
        judge_scope(evaluator, rule, env, scope, resolved)
        for scope, resolved in stretches(evaluator, rule, env)
    ]
    if given is None:
        # it is no violation if it does not apply, and none if nothing breaks it
        found = [i if i.lower >= 0 else i._replace(upper=np.inf, clause=None) for i in found]
        if any(i.clause is None for i in found):
            evaluator.notes["whether it applies is not known: its given is not, at the start"] = (
                None
            )
    return found


def judge_scope(
    evaluator: Evaluator, rule: ast.Rule, env: Env, scope: Scope, resolved: int | None = None
) -> Instance:
    """The rule in one of its scopes; ``resolved``: the frame at which ``until`` ended it."""
    lasting = evaluator.window(rule.for_).within(scope.first, scope.stop)
    here, coarse, met = mask_of([scope], evaluator.frames), evaluator.clock.coarse, []
    for clause in rule.clauses:
        kind = OBLIGATIONS[clause.kind]
        tree = evaluator.evaluate(clause.what, env, clause.kind, here)
        known = between_samples.begun_between(clause.what, scope, coarse)
        margin = kind.margin(tree.margin.between(scope.first, scope.stop), known.sure, lasting)
        met.append(Met(clause, tree, kind.cut(margin) if scope.cut else margin))
    violated = any(each.margin.upper < 0 for each in met)
    decisive = min(met, key=lambda m: m.margin.upper if violated else m.margin.lower)
    lower, upper = min(m.margin.lower for m in met), min(m.margin.upper for m in met)
    frame = scope.first + decisive.margin.frame
    return Instance(env, scope, lower, upper, decisive.clause, frame, tuple(met), resolved)


def violated_frames(evaluator: Evaluator, rule: ast.Rule, instance: Instance) -> Bool:
    """(T,) the frames of the scope in which some obligation is certainly broken."""
    out, scope = np.zeros(evaluator.frames, np.bool_), instance.scope
    here = slice(scope.first, scope.stop)
    lasting = evaluator.window(rule.for_).within(scope.first, scope.stop)
    for clause, tree, _ in instance.met:
        known = between_samples.begun_between(clause.what, scope, evaluator.clock.coarse)
        margin = tree.margin.between(scope.first, scope.stop)
        out[here] |= OBLIGATIONS[clause.kind].broken(margin, known.certain, lasting)
    return out
