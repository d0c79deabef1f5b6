"""What was found out about one episode under given values, once and with the notes on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import digest_of

from .known import Known
from .values import Env, Values

Found = TypeVar("Found")


class Answers(Values):
    """Values as they hold for an episode, and what they were asked for before.

    Attributes:
        store: answers queries about the episode, and keeps answers to questions.
        notes: on what is being found out, in the order in which they came up.
        players: role → all bodies that play it, for ``at least K role``.
        success, success_known: frame of native success, None if it never came; and whether that is known.
        causal: states look only backwards.
    """

    success: int | None
    success_known: bool
    causal: bool

    def __init__(
        self,
        relations: Relations,
        rules: ast.RuleSet,
        params: ast.Params,
    ) -> None:
        """Arguments as in ``Evaluator``."""
        super().__init__(relations, rules, params)
        self.store = relations.store
        self.players: Mapping[str, Sequence[str]] = {}
        self._digests: dict[Any, tuple[object, str]] = {}
        self._know(Known(rules), shares=False)

    def _know(self, known: Known, *, shares: bool) -> None:
        self._known, self._told, self._shares = known, known.told, shares

    def share(self, other: Answers) -> None:
        """Answer as another does, about the same episode, where other values make no difference."""
        self.players = other.players
        changed = {name for name, value in self.params.items() if other.params.get(name) != value}
        self._know(Known(self.rules, other._known, frozenset(changed)), shares=True)

    def digest(self, node: object) -> str:
        """Of a part of a rule, as it holds under these values."""
        key = tuple(map(id, node)) if isinstance(node, tuple) else id(node)
        known = self._digests.get(key)
        if known is None:
            backend = self.relations.signals.backend
            known = node, digest_of(self.rules, node, self.params, backend)
            self._digests[key] = known
        return known[1]

    def once(
        self, node: object, key: tuple[Any, ...], find: Callable[..., Found], *asked: Any
    ) -> Found:
        """What ``find`` says of a declared part of the rules, with its notes; or what it said before.

        Args:
            node: the part, kept beside what was found, and so stays what it is.
            key: what else the answer depends on, and who asks.
            find: tells it.
            asked: handed to it.
        """
        known = self._told.get(key)
        if known is None and self._shares:
            known = self._known.get(key)
        if known is None:
            outer, self.notes = self.notes, {}
            try:
                known = self._told[key] = node, find(*asked), self.notes
            finally:
                self.notes = outer
        if known[2]:
            self.notes.update(known[2])
        found: Found = known[1]
        return found

    def recall(self, what: str, node: object, env: Env, find: Callable[[], Any]) -> Any:
        """The answer (JSON) of ``find`` about a part of a rule, with its notes; or as it was before.

        The question names all that the answer may depend on besides the trace: the part with every
        definition and value that it reaches, who plays what, and what is known of success.
        """
        if not self.store.lasting:
            return find()
        part = f"{what} {self.digest(node)} {sorted(env.items())}"
        facts = self.success, self.success_known, self.causal
        question = f"{part} {sorted(self.players.items())} {facts}"
        answer, notes = self.store.answer(question, lambda: self._noted(find))
        self.notes.update(dict.fromkeys(notes))
        return answer

    def _noted(self, find: Callable[[], Any]) -> list[Any]:
        """An answer, and the notes that came with it."""
        outer, self.notes = self.notes, {}
        try:
            return [find(), list(self.notes)]
        finally:
            self.notes = outer
