"""One episode under audit, and what several checks of it share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from safestage_eval.doubts import contradictions
from safestage_eval.episode import (
    Body,
    ContactTable,
    Episode,
    Header,
    RobotFrames,
    Track,
    check,
    with_holes,
)
from safestage_eval.episode.contradiction import ContradictionError
from safestage_eval.episode.invariants import measured
from safestage_eval.episode.lazy_columns import StoredItems
from safestage_eval.errors import RuleError, TraceError
from safestage_eval.rules import BindFile, Binding, RuleSet, bind_episode
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.episode_binding import BY_ROLES

from .diagnosis import Diagnosis, diagnose
from .finding import Defect

if TYPE_CHECKING:
    from safestage_eval.relations.relations import Relations


class Subject:
    """One episode under audit.

    Attributes:
        given: as it is stored: nothing of it is checked, and columns are read when they are
            asked for.
        episode: the same, with NaN for what is infinite.
        rules: all that are loaded.
        bind: the bind file that was given, if any.
        notes: what checks of one file leave for each other.
        whole: all of it may be read; else only the motion of objects, and what is said once.
    """

    whole = True

    def __init__(self, episode: Episode, rules: RuleSet, bind: BindFile | None = None) -> None:
        self.given = episode if bind is None else bind.described(episode)
        self.episode = _measured(self.given)
        self.rules, self.bind = rules, bind
        self.notes: dict[str, Any] = {}

    def close(self) -> None:
        """Take apart what refers to itself: its memory would stay until Python looks for cycles.

        Nothing can be asked of it any more.
        """
        relations = vars(self).get("relations")
        if relations is not None:
            for part in (relations.signals.gaps, relations.signals, relations):
                vars(part).clear()
        self.notes.clear()

    @property
    def header(self) -> Header:
        """Header of the episode."""
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
    def broken(self) -> list[TraceError]:
        """Format errors; see ``episode.check``."""
        return check(self.episode)

    @property
    def readable(self) -> bool:
        """The format holds, so that columns may be compared."""
        return not self.broken

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """Contradictions in the recording, and their cause."""
        if not self.readable:
            return Diagnosis()
        errors = [*contradictions(self.episode)]
        return diagnose(self.episode, errors) if errors else Diagnosis()

    @property
    def sound(self) -> bool:
        """Nothing in it is contradicted, so that a scene can be looked at."""
        diagnosis = self.diagnosis
        return self.readable and diagnosis.repair is None and not diagnosis.left

    def explained(self, code: str) -> Iterator[Defect]:
        """The part of the diagnosis that a check reports: a cause, and contradictions left unexplained."""
        diagnosis = self.diagnosis
        if (
            diagnosis.repair is not None
            and diagnosis.repair.code == code
            and diagnosis.first is not None
        ):
            first, repair = diagnosis.first, diagnosis.repair
            total = diagnosis.explained + len(diagnosis.left)
            gone = f"all {total}" if not diagnosis.left else f"{diagnosis.explained} of {total}"
            proof = f"with that undone {gone} contradictions vanish" if total > 1 else ""
            yield Defect(
                f"{first.what.rstrip('.')}.",
                repair.fix,
                "; ".join(filter(None, (repair.cause, proof))),
                bodies=diagnosis.bodies,
                field=repair.field,
                time=first.time,
            )
        left = [error for error in diagnosis.left if error.code == code]
        if left:
            yield defect_of(left)

    @cached_property
    def touched(self) -> dict[str, NDArray[np.bool_]]:
        """Body → (T,) something touches it, of every body with a contact."""
        episode, touched = self.episode, dict[str, NDArray[Any]]()
        for pair in episode.contacts.pairs:
            frame = episode.contacts.of_pair(pair, "frame")[0]
            for i in pair:
                name = self.header.bodies[i].name
                touched.setdefault(name, np.zeros(len(episode), np.bool_))[frame] = True
        return touched

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
        """The rules and costs that some source assigns, and that are loaded."""
        known, binding = self.rules.scoped, self.binding
        codes = self.header.rules if binding is None else binding.assigned
        if binding is not None and binding.provenance.get("rules") == BY_ROLES:
            return ()
        return tuple(known[code] for code in codes if code in known)

    @cached_property
    def relations(self) -> Relations:
        """Relations and signals of the episode as it is judged; for a sound recording."""
        from safestage_eval.evidence.measure import Signals
        from safestage_eval.relations.relations import Relations
        from safestage_eval.verdicts.judging import baseline_frames

        episode = with_holes(self.episode)
        return Relations(Signals(episode, baseline_frames(self.rules, episode)))


T = TypeVar("T", Track, ContactTable, RobotFrames)


def _measured(episode: Episode) -> Episode:
    """The episode with NaN for what is infinite: neither was measured."""

    def clean(table: T, kind: type[T]) -> T:
        given = {column.name: getattr(table, column.name) for column in fields(kind)}
        found = {name: measured(values) for name, values in given.items()}
        same = all(found[name] is values for name, values in given.items())
        return table if same else kind(**found)

    return replace(
        episode,
        tracks=StoredItems(episode.tracks, lambda name: clean(episode.tracks[name], Track)),
        _contacts=lambda: clean(episode.contacts, ContactTable),
        _frames=lambda: clean(episode.frames, RobotFrames),
    )


def defect_of(errors: list[ContradictionError]) -> Defect:
    """Contradictions of one kind as one defect: the first, and how many more there are."""
    first = errors[0]
    more = f" And {len(errors) - 1} more like this." if len(errors) > 1 else ""
    names = tuple(dict.fromkeys(name for error in errors for name in error.bodies))
    expected = f" Expected: {first.allowed}." if first.allowed and first.fix else ""
    return Defect(
        f"{first.what.rstrip('.')}.{expected}{more}",
        first.fix or f"write {first.allowed}",
        bodies=names,
        field=first.field,
        time=first.time,
    )
