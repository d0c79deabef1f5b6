"""Answers about one episode under given values: each computed once, and kept with its notes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import digest_of, parameters_read

from .values import Env, Values

Found = TypeVar("Found")

Answer = tuple[object, Any, dict[str, None]]
"""The part of the rules that was asked about, the answer, and the notes on it."""


class Answers(Values):
    """Values as they hold for an episode, and the answers computed under them.

    Attributes:
        store: answers queries about the episode, and keeps answers to questions.
        notes: on what is being computed, in the order in which they came up.
        players: role → all bodies that play it, for ``at least K role``.
        success, success_known: frame of native success, None if it never came; and whether that is known.
        causal: states look only backwards.
    """

    success: int | None
    success_known: bool
    causal: bool

    def __init__(self, relations: Relations, rules: ast.RuleSet, params: ast.Params) -> None:
        """Arguments as in ``Evaluator``."""
        super().__init__(relations, rules, params)
        self.store = relations.store
        self.players: Mapping[str, Sequence[str]] = {}
        self._digests: dict[Any, tuple[object, str]] = {}
        self._answers: dict[tuple[Any, ...], Answer] = {}
        self._base: Answers | None = None
        """Under other values, for the same episode."""
        self._changed: frozenset[str] = frozenset()
        """Parameters that have another value there."""

    def share(self, other: Answers) -> None:
        """Answer as another does, about the same episode, where other values make no difference."""
        self.players = other.players
        changed = {name for name, value in self.params.items() if other.params.get(name) != value}
        self._base, self._changed = other, frozenset(changed)

    def look_up(self, key: tuple[Any, ...]) -> Answer | None:
        """An answer from here, or from under values that make no difference to it."""
        answer = self._answers.get(key)
        if answer is None and self._base is not None:
            answer = self._base.look_up(key)
            if answer is not None:
                if not self._changed.isdisjoint(parameters_read(self.rules, answer[0])):
                    return None
                self._answers[key] = answer
        return answer

    def digest(self, node: object) -> str:
        """Digest of a part of a rule, as it holds under these values."""
        key = tuple(map(id, node)) if isinstance(node, tuple) else id(node)
        digest = self._digests.get(key)
        if digest is None:
            backend = self.relations.signals.backend
            digest = node, digest_of(self.rules, node, self.params, backend)
            self._digests[key] = digest
        return digest[1]

    def once(
        self, node: object, key: tuple[Any, ...], compute: Callable[..., Found], *args: Any
    ) -> Found:
        """The answer of ``compute`` about a part of the rules, with its notes; computed once per key.

        Args:
            node: the part; kept beside the answer, so that its identity stays taken.
            key: what else the answer depends on, and who asks.
            compute: what computes it.
            args: handed to it.
        """
        answer = self._answers.get(key)
        if answer is None and self._base is not None:
            answer = self.look_up(key)
        if answer is None:
            outer, self.notes = self.notes, {}
            try:
                answer = self._answers[key] = node, compute(*args), self.notes
            finally:
                self.notes = outer
        if answer[2]:
            self.notes.update(answer[2])
        value: Found = answer[1]
        return value

    def recall(self, what: str, node: object, env: Env, compute: Callable[[], Any]) -> Any:
        """The answer (JSON) of ``compute`` about a part of a rule, with its notes, from a lasting store.

        The question names all that the answer may depend on besides the trace: the part with every
        definition and value that it reaches, who plays what, and what is known of success.
        """
        if not self.store.lasting:
            return compute()
        part = f"{what} {self.digest(node)} {sorted(env.items())}"
        facts = self.success, self.success_known, self.causal
        question = f"{part} {sorted(self.players.items())} {facts}"
        answer, notes = self.store.answer(question, lambda: self._noted(compute))
        self.notes.update(dict.fromkeys(notes))
        return answer

    def _noted(self, compute: Callable[[], Any]) -> list[Any]:
        """An answer, and the notes that came with it."""
        outer, self.notes = self.notes, {}
        try:
            return [compute(), list(self.notes)]
        finally:
            self.notes = outer
