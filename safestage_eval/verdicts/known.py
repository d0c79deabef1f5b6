"""What was found out about one episode under given values, and what other values leave as it is."""

from __future__ import annotations

from typing import Any

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read


class Known:
    """Answers with their notes, by what was asked; those that other values cannot change are shared.

    Attributes:
        told: question → the part of the rules that it is about, the answer, and notes on it.
    """

    def __init__(
        self,
        rules: ast.RuleSet,
        outer: Known | None = None,
        changed: frozenset[str] = frozenset(),
    ) -> None:
        """``outer``: what is known under values that differ in the ``changed`` parameters."""
        self.told: dict[tuple[Any, ...], tuple[object, Any, dict[str, None]]] = {}
        self._rules, self._outer, self._changed = rules, outer, changed

    def get(self, key: tuple[Any, ...]) -> tuple[object, Any, dict[str, None]] | None:
        """What was found out, here or under values that make no difference to it."""
        found = self.told.get(key)
        if found is None and self._outer is not None:
            found = self._outer.get(key)
            if found is not None:
                if not self._changed.isdisjoint(parameters_read(self._rules, found[0])):
                    return None
                self.told[key] = found
        return found
