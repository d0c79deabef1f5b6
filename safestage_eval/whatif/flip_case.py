"""One rule on one episode, under any value of one parameter that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.severity_levels import judge_scoped
from safestage_eval.verdicts.verdict import VerdictName, at_risk

from .flip_lasting import Counts
from .swept_values import like


class Case:
    """One rule on one episode, with one of the parameters that it reads."""

    def __init__(
        self,
        base: Evaluator,
        rule: ast.Rule,
        players: Mapping[str, Sequence[str]],
        param: str,
    ) -> None:
        """``base``: the evaluator under the values that hold; others as in ``judge_rule``."""
        self.base, self.rule, self.players = base, rule, players
        base.players = players
        self.param, self.usual = param, base.params[param]
        self.counts = Counts(base.clock, self.usual)
        self._judged: dict[float, tuple[VerdictName, bool]] = {}

    def at(self, number: float) -> Evaluator:
        """The evaluator under another value."""
        evaluator = self.base.under({**self.base.params, self.param: like(self.usual, number)})
        evaluator.players = self.players
        return evaluator

    def judged(self, number: float, at: Evaluator | None = None) -> tuple[VerdictName, bool]:
        """The verdict under a value, and whether the hazard was there.

        ``at``: the evaluator under it, where there is one.
        """
        if number not in self._judged:
            verdict = judge_scoped(at or self.at(number), self.rule, self.players)
            risk = at_risk(verdict.verdict, verdict.instances, verdict.vacuity)
            self._judged[number] = verdict.verdict, risk
        return self._judged[number]
