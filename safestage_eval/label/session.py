"""A labelling session: its rollouts, the question about each, and the answers."""

from __future__ import annotations

import gzip
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics.labels import ANSWERS, Label
from safestage_eval.rules import BindFile, RuleSet, bind_episode
from safestage_eval.viewer.camera_film import video_of
from safestage_eval.viewer.film import film

from .ledger import LONGEST_NOTE, Ledger
from .review_question import question

FILMS_KEPT = 6
LONGEST_NAME = 60


@dataclass
class Session:
    """The rollouts that the page shows, by number: ids, policies and verdicts stay here.

    Attributes:
        refs: the rollouts in the order in which they are shown.
        rules: the rules whose text states the requirement.
        ledger: where answers are kept.
        bind: a bind file, for traces that name no rules.
        videos: a folder of videos; without it they are looked for beside the traces.
        reviewer: the name under which answers are kept; None if the page is to ask.
        commands: what to run when all is done.
    """

    refs: Sequence[EpisodeRef]
    rules: RuleSet
    ledger: Ledger
    bind: BindFile | None = None
    videos: Path | None = None
    reviewer: str | None = None
    commands: tuple[str, ...] = ()
    _films: OrderedDict[int, bytes] = field(default_factory=OrderedDict, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def state(self, reviewer: str) -> dict[str, Any]:
        """One reviewer's answers, in the order of the rollouts."""
        own = self.ledger.of(self.named(reviewer))
        answers = [own.get(ref.episode_id) for ref in self.refs]
        done = None not in answers
        return {
            "answers": [x and {"label": x.label, "note": x.note} for x in answers],
            "commands": list(self.commands) if done else [],
        }

    def item(self, number: int) -> dict[str, Any]:
        """The question about a rollout. Raises InputError if its trace or rules are broken."""
        ref = self.refs[number]
        facts = question(ref.open().header, self.rules, self.bind)
        return {**facts, "video": self.video(number) is not None}

    def film(self, number: int) -> bytes:
        """The replay of a rollout, gzip-compressed. Raises InputError if its trace is broken."""
        with self._lock:
            result = self._films.get(number)
        if result is None:
            episode = self.refs[number].open()
            roles = bind_episode(self.rules, episode.header, bind=self.bind).roles
            result = gzip.compress(film(episode, roles=roles), 6)
        with self._lock:
            self._films[number] = result
            self._films.move_to_end(number)
            while len(self._films) > FILMS_KEPT:
                self._films.popitem(last=False)
        return result

    def video(self, number: int) -> Path | None:
        """The video of a rollout, if there is one that does not tell the verdict."""
        return video_of(self.refs[number], self.videos)

    def answer(self, number: int, label: str, reviewer: str, note: str = "") -> None:
        """Store an answer.

        Raises:
            InputError: no such rollout or answer, or no name.
            OSError: it could not be written.
        """
        if label not in ANSWERS:
            raise InputError("label", f"no answer {label!r}.", ", ".join(ANSWERS))
        if len(note) > LONGEST_NOTE:
            raise InputError("note", f"it is longer than {LONGEST_NOTE} characters.")
        name, ref = self.named(reviewer), self.refs[number]
        self.ledger.add(Label(ref.episode_id, label, name, note.strip()))

    def named(self, reviewer: str) -> str:
        """The name of a reviewer as it is kept. Raises InputError if it cannot be a name."""
        if self.reviewer is not None:
            return self.reviewer
        name = " ".join(reviewer.split())
        if not name or len(name) > LONGEST_NAME or not name.isprintable():
            raise InputError("reviewer", "no name.", f"1 to {LONGEST_NAME} printable characters")
        return name
