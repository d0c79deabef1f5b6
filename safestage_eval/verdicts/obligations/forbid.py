"""``forbid``: things none of which may hold in any frame, for as long as ``for`` says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import TINY, Band, Bool
from safestage_eval.states.persistence import without_short_runs
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.instance import Instance
from safestage_eval.verdicts.look_ahead import Foresight, Look
from safestage_eval.verdicts.values import Env
from safestage_eval.verdicts.witness import Witness

from .greatest import greatest
from .obligation import Margin, Obligation, nearest_run
from .ordering import first_broken, in_turn, is_ordering, ordering, speaking


class Forbid(Obligation):
    """Its margin is the negated greatest one at which any of these things holds."""

    kind = "forbid"
    kept = "Never happened from {begin} to {end}: {what}."

    def margin(
        self, evaluator: Evaluator, rule: ast.Rule, what: ast.Alternative, env: Env, scope: Scope
    ) -> Margin:
        """The negated margin of the longest run; costly conditions are measured at as few frames as that takes."""
        if rule.for_ is None and scope.stop > scope.first and evaluator.asks_costly(what):
            low, high, frame = greatest(evaluator, what, env, scope)
            return Margin(_negated(high), _negated(low), frame)
        return super().margin(evaluator, rule, what, env, scope)

    def margin_of(self, band: Band, sure: Bool | None, lasting: Window) -> Margin:
        """How far the nearest run of the forbidden condition is from lasting long enough, negated."""
        if not len(band.lower):
            return Margin(np.inf, np.inf, 0)
        held = band
        if sure is not None:
            held = Band(np.where(sure, band.lower, -np.inf), band.upper)
        surely, possibly, frame = nearest_run(held, lasting)
        return Margin(_negated(possibly), _negated(surely), frame)

    def broken(self, band: Band, sure: Bool, lasting: Window) -> Bool:
        """The frames of runs of the condition that certainly last long enough."""
        out: Bool = without_short_runs(np.where(sure, band.lower, -np.inf), lasting) >= 0
        return out

    def first_witness(
        self, evaluator: Evaluator, rule: ast.Rule, instance: Instance, *, violated: bool
    ) -> Witness | None:
        """The order of two moments, or what broke the rule first, where these count."""
        first = None
        if violated and in_turn(evaluator, rule):
            first = first_broken(evaluator, rule, instance)
        state = None
        if first is not None and isinstance(first.what, ast.Event) and first.what.call is not None:
            state = speaking(evaluator, first.what.call, instance.env)
        if is_ordering(rule):
            witness = ordering(evaluator, rule, instance, first)
            if witness is not None:
                return witness._replace(state=state)
        if first is None:
            return None
        if state is not None:
            return Witness(str(state), state.args, first.frame, state=state)
        if instance.clause is None or instance.clause.kind != self.kind:
            return None
        return self.witness(evaluator, first.what, instance, first.frame, violated=violated)

    def breaches(self, rule: ast.Rule) -> Sequence[ast.Alternative]:
        """Each thing that is forbidden."""
        return rule.forbid

    def foresight(self, look: Look, rule: ast.Rule, what: ast.Alternative) -> Foresight:
        """A violation is certain once the condition has lasted for long enough."""
        lasting = 0.0 if rule.for_ is None else look.seconds(rule.for_)
        return look.alternative(what).then(lasting)


def _negated(margin: float) -> float:
    """Like ``states.band.negated``, for a single margin."""
    return -margin if margin != 0 else -TINY
