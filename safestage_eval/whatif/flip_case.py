"""One rule on one episode, under any value of one parameter that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.rule_verdict import judge_rule
from safestage_eval.verdicts.verdict import Verdict, VerdictName, at_risk

from .flip_lasting import Counts, like


class Case:
    """One rule on one episode, with one of the parameters that it reads."""

    def __init__(
        self,
        base: Evaluator,
        rule: ast.Rule,
        players: Mapping[str, Sequence[str]],
        blank: Verdict,
        param: str,
    ) -> None:
        """``base``: the evaluator under the values that hold; others as in ``judge_rule``."""
        self.base, self.rule, self.players, self.blank = base, rule, players, blank
        self.param, self.usual = param, base.params[param]
        self.counts = Counts(base.clock, self.usual)

    def at(self, number: float) -> Evaluator:
        """The evaluator under another value."""
        found = self.base.under({**self.base.params, self.param: like(self.usual, number)})
        found.players = self.players
        return found

    def judged(self, at: Evaluator) -> tuple[VerdictName, bool]:
        """The verdict, and whether it was reached on something."""
        found = judge_rule(at, self.rule, self.players, self.blank)
        return found.verdict, at_risk(found.verdict, found.instances, found.vacuity)
