"""One episode under audit, and what several checks of it share."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from safestage_eval.episode import Body, Episode, Header, Track, with_holes
from safestage_eval.errors import RuleError
from safestage_eval.rules import BindFile, Binding, RuleSet, bind_episode
from safestage_eval.rules import syntax as ast

if TYPE_CHECKING:
    from safestage_eval.relations.relations import Relations


class Subject:
    """One episode under audit.

    Attributes:
        episode: as it is stored: nothing of it is checked, and columns are read when they are
            asked for.
        rules: all that are loaded.
        bind: the bind file that was given, if any.
    """

    def __init__(self, episode: Episode, rules: RuleSet, bind: BindFile | None = None) -> None:
        self.episode, self.rules, self.bind = episode, rules, bind

    @property
    def header(self) -> Header:
        """Of the episode."""
        return self.episode.header

    @cached_property
    def objects(self) -> tuple[Body, ...]:
        """Movable objects that have a track."""
        return tuple(
            body
            for body in self.header.bodies
            if body.kind == "object" and body.movable and body.name in self.episode.tracks
        )

    def track(self, body: str) -> Track:
        """The motion of a body; (1, …) of a fixed one."""
        return self.episode.tracks[body]

    @cached_property
    def _bound(self) -> Binding | RuleError:
        try:
            return bind_episode(self.rules, self.header, bind=self.bind)
        except RuleError as error:
            return error

    @property
    def binding(self) -> Binding | None:
        """Its roles, assigned rules and goal; None where they make no sense (``unbound``)."""
        return self._bound if isinstance(self._bound, Binding) else None

    @property
    def unbound(self) -> RuleError | None:
        """Why there is no binding."""
        return self._bound if isinstance(self._bound, RuleError) else None

    @cached_property
    def assigned(self) -> tuple[ast.Scoped, ...]:
        """The assigned rules and costs that are loaded."""
        known = self.rules.scoped
        codes = self.binding.assigned if self.binding else self.header.rules
        return tuple(known[code] for code in codes if code in known)

    @cached_property
    def relations(self) -> Relations:
        """Relations and signals of the episode as it is judged; for a sound recording."""
        from safestage_eval.evidence.measure import Signals
        from safestage_eval.relations.relations import Relations

        return Relations(Signals(with_holes(self.episode)))
