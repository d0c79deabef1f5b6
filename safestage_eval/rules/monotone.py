"""Which way a parameter moves a verdict, where that is certain from the rule alone."""

from __future__ import annotations

from typing import Any

from . import syntax as ast
from .clauses import CLAUSES
from .digest import reached

Signs = frozenset[int]
"""The effect of raising a parameter on a truth: {+1} only towards true, {−1} only towards false."""

NOTHING: Signs = frozenset()
EITHER: Signs = frozenset({1, -1})


def direction(rules: ast.RuleSet, rule: ast.Scoped, param: str) -> int | None:
    """The effect of raising a parameter on the verdict, ordered pass < inconclusive < violation.

    Returns +1 if it can only get worse, −1 if it can only get better, 0 if nothing changes, None
    if it may go either way.

    The proof is by the structure of the rule. A limit is crossed at one value. And, or, closing,
    opening and latching only select (minimum and maximum over atoms and frames), so they keep the
    direction; *not* turns it round; a longer ``for`` makes less true, a longer ``gap`` more. A
    parameter that moves a scope, an event, ``given``, ``until`` or a cost may do either.
    """
    walk = _Walk(rules, param)
    signs = walk.rule(rule) if isinstance(rule, ast.Rule) else walk.anything(rule)
    if len(signs) == 2:
        return None
    return next(iter(signs), 0)


class _Walk:
    def __init__(self, rules: ast.RuleSet, param: str) -> None:
        self._rules, self._param = rules, param

    def rule(self, rule: ast.Rule) -> Signs:
        """Effect on being violated."""
        found = NOTHING
        for frame in (rule.given, rule.during, rule.at, rule.until):
            if frame is not None:
                found |= self.anything(frame)
        for clause in rule.clauses:
            spec, holds = CLAUSES[clause.kind], self.alternative(clause.what)
            found |= _turned(holds) if spec.wanted else holds
            if spec.lasts and self._is(rule.for_):  # what must last longer holds less often
                found |= {1 if spec.wanted else -1}
        return found

    def condition(self, condition: ast.Condition) -> Signs:
        """Effect on a condition being true."""
        return frozenset().union(*(self.atom(item) for item in condition.atoms))

    def alternative(self, what: ast.Alternative) -> Signs:
        if isinstance(what, ast.Condition):
            return self.condition(what)
        if what.call is not None and what.edge is None:
            return self.state(what.call)
        return self.anything(what)

    def atom(self, atom: ast.Atom) -> Signs:
        if isinstance(atom, ast.SignalAtom):
            found = self.anything(atom.since) if atom.since is not None else NOTHING
            found |= self.anything(atom.call)  # a parameter among the options of a signal
            for limit in atom.limits:
                if isinstance(limit.value, ast.Parameter) and self._is(limit.value):
                    rises = (limit.op[0] == "<") != limit.value.negative
                    found |= frozenset({1 if rises else -1})
            return found
        if isinstance(atom, ast.StateAtom):
            found = self.state(atom.call)
            return found if atom.want else _turned(found)
        if isinstance(atom, ast.CountAtom):
            found = self.state(atom.call)
            return found if atom.bound == "least" else _turned(found)
        return frozenset().union(*(self.alternative(item) for item in atom.alternatives))

    def state(self, call: ast.Call) -> Signs:
        """Effect on a state being true."""
        state = self._rules.states.get(call.name)
        if state is None:
            return NOTHING
        found = self.condition(state.when)
        if state.fallback is not None:  # which of the two counts hangs on the trace alone
            found |= self.condition(state.fallback)
        if state.perhaps is not None:
            found |= self.condition(state.perhaps)
        if state.also is not None:
            found |= self.condition(state.also)
        if self._is(state.for_):
            found |= {-1}
        if self._is(state.gap):
            found |= {1}
        return found | self.anything(state.until) if state.until is not None else found

    def anything(self, node: Any) -> Signs:
        """Either way if the parameter is reached at all."""
        uses = reached(self._rules, node, self._rules.params)
        return EITHER if f"param.{self._param}" in uses else NOTHING

    def _is(self, value: Any) -> bool:
        return isinstance(value, ast.Parameter) and value.name == self._param


def _turned(signs: Signs) -> Signs:
    return frozenset(-sign for sign in signs)
