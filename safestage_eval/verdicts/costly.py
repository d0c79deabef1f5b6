"""Which parts of a rule ask for something costly, so that it is measured only where it matters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from safestage_eval.evidence.declare import is_costly, is_gate
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.operations import OPERATIONS

Part = ast.Atom | ast.Alternative
AnyPart = TypeVar("AnyPart", ast.Atom, ast.Alternative)

_MANY = 4096
"""Parts that are remembered at once; goals in headers are new with every episode."""


class Costly:
    """Which parts of one set of rules are costly; the same for all episodes."""

    def __init__(self, rules: ast.RuleSet) -> None:
        """Answers are cached in ``rules.known``."""
        self._rules = rules
        # by identity: the part is kept beside the answer, and so stays what it is
        self._depths: dict[int, tuple[Part, int]] = rules.known.setdefault("costly", {})
        self._split: dict[int, tuple[ast.Condition, ast.Condition, tuple[ast.StateAtom, ...]]] = (
            rules.known.setdefault("gates", {})
        )
        for cached in (self._depths, self._split):
            if len(cached) > _MANY:
                cached.clear()

    def asked(self, part: Part) -> bool:
        """It asks for something costly, itself or through states."""
        cached = self._depths.get(id(part))
        return (self.depth(part) if cached is None or cached[0] is not part else cached[1]) > 0

    def depth(self, part: Part) -> int:
        """How many states lie between it and what is costly: what is asked for last; 0 if nothing."""
        cached = self._depths.get(id(part))
        if cached is None or cached[0] is not part:
            cached = self._depths[id(part)] = part, self._depth(part)
        return cached[1]

    def _depth(self, part: Part) -> int:
        if isinstance(part, ast.Condition):
            return max(map(self.depth, part.atoms), default=0)
        if isinstance(part, ast.AnyOf):
            return max(map(self.depth, part.alternatives), default=0)
        if part.call is None:
            return 0
        others = (getattr(part, "other", None), getattr(part, "begun", None))
        return max(self._of_call(call.name) for call in (part.call, *others) if call is not None)

    def _of_call(self, name: str) -> int:
        if name in self._rules.derived:
            return self._of_computed(self._rules.derived[name])
        if name in self._rules.signals:
            name = self._rules.signals[name].base
        declared = self._rules.states.get(name)
        if declared is None:
            return int(is_costly(name))
        if not self.state(declared):
            return 0
        return 1 + self.depth(declared.when) + (declared.until is not None)

    def _of_computed(self, computed: ast.DerivedDef) -> int:
        atoms = (ast.SignalAtom, ast.StateAtom)
        signals = [one for one in computed.operands if isinstance(one, atoms)]
        itself = int(OPERATIONS[computed.operation].costly)
        return max(itself, *map(self.depth, signals))

    def computed(self, computed: ast.DerivedDef) -> bool:
        """It is costly, or computed from something that is."""
        return self._of_computed(computed) > 0

    def sorted(self, parts: Sequence[AnyPart]) -> list[AnyPart]:
        """The parts with the costly ones last."""
        return sorted(parts, key=self.depth)

    def split(self, condition: ast.Condition) -> tuple[ast.Condition, tuple[ast.StateAtom, ...]]:
        """A condition without its gates, and these; a condition of gates alone has none.

        A gate only says whether the rest of its condition counts.
        """
        cached = self._split.get(id(condition))
        if cached is None or cached[0] is not condition:
            gates = tuple(
                atom
                for atom in condition.atoms
                if isinstance(atom, ast.StateAtom) and is_gate(atom.call.name)
            )
            rest = condition
            if 0 < len(gates) < len(condition.atoms):
                rest = ast.Condition(tuple(a for a in condition.atoms if a not in gates))
            else:
                gates = ()
            cached = self._split[id(condition)] = condition, rest, gates
        return cached[1], cached[2]

    def named(self, state: ast.StateDef) -> bool:
        """It merely names a condition: no frame of it depends on another."""
        lasting = state.for_ is None and state.gap is None and state.until is None
        return lasting and state.fallback is None and state.also is None

    def state(self, state: ast.StateDef) -> bool:
        """It asks for something costly, now or at other frames, and has no other source."""
        return state.fallback is None and state.also is None and self.asked(state.when)


def is_for_good(state: ast.StateDef) -> bool:
    """Once it holds it holds to the end, and at once."""
    if state.until is None or state.until.kind != "end":
        return False
    others = state.for_ is None and state.gap is None
    return others and state.fallback is None and state.also is None
