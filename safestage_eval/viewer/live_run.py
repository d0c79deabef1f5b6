"""A run that is looked at while it is judged: its list, and the evidence of an episode when it is asked for."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.metrics import aggregate, outcomes_of
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.settings import Settings
from safestage_eval.verdicts.problem import Problem
from safestage_eval.whatif.judge_again import Again

from .browser_page import browser_page, run_data
from .camera_film import film_of
from .campaign.overview import Report, overview
from .campaign.run_list import judge, of_traces
from .episode.episode_data import episode_data, stored_verdicts
from .film import packed_with
from .packed import packed, script

KEPT = 24
"""Episodes whose evidence is held."""

PAUSE = 0.01
"""s between two episodes that are judged in the background, so that what is asked for comes first."""

Rows = Sequence[Mapping[str, Any]]


class LiveRun:
    """Episodes, their results as far as they are known, and their evidence on request."""

    def __init__(
        self,
        title: str,
        refs: Sequence[EpisodeRef],
        settings: Settings,
        *,
        rows: Mapping[str, Rows] | None = None,
        everything: bool = False,
    ) -> None:
        """Take over results that are there already.

        Args:
            title: of the page.
            refs: the episodes.
            settings: how they are judged.
            rows: episode id → its result rows, where they were scored before.
            everything: rules that pass without being assigned as well.
        """
        self.title, self.refs, self.settings, self.everything = title, refs, settings, everything
        self.rows: dict[int, Rows] = {}
        self.problems: dict[int, str] = {}
        self._tables = of_traces(refs)
        self._evidence: OrderedDict[str, str] = OrderedDict()
        self._meshes: dict[str, bytes] = {}
        self._judging = threading.Lock()  # what is remembered of an episode serves one at a time
        self._listing = threading.Lock()
        for place, ref in enumerate(refs):
            if rows is not None and ref.episode_id in rows:
                self._enter(place, rows[ref.episode_id])

    @property
    def left(self) -> int:
        """Episodes that are neither judged nor given up."""
        return len(self.refs) - len(self.rows) - len(self.problems)

    def judge_all(self) -> None:
        """Judge what is left, one after the other; for a thread of its own."""
        for place, ref in enumerate(self.refs):
            if place in self.rows:
                continue
            with self._judging:
                result = score_episode(ref, self.settings.rule_set, **self.settings.arguments())
            if isinstance(result, Problem):
                with self._listing:
                    self.problems[place] = result.message
            else:
                self._enter(place, result.rows())
            time.sleep(PAUSE)

    def _enter(self, place: int, rows: Rows) -> None:
        with self._listing:
            self.rows[place] = rows
            judge(self._tables, place, rows)

    def page(self) -> bytes:
        """The page; with the results once all is judged."""
        results: list[str] = []
        with self._listing:
            rows = [] if self.left else [row for own in self.rows.values() for row in own]
        if rows:
            counts = aggregate(outcomes_of(rows))
            rules = self.settings.rule_set.rules
            titles = {code: rule.title for code, rule in rules.items()}
            results = overview(Report(self.title, self.title, counts, rows, titles=titles))
        return browser_page(self.title, results, "live").encode()

    def piece(self, name: str) -> bytes:
        """Return a piece as a script. Raises KeyError for an unknown one."""
        if name == "run":
            return script(name, packed(self._list(), 6)).encode()
        if name in self._meshes:
            return script(name, packed(self._meshes[name], 6)).encode()
        place = int(name.removeprefix("e")) if name.startswith("e") else len(self.refs)
        if place >= len(self.refs):
            raise KeyError(name)
        if name not in self._evidence:
            self._evidence[name] = packed(self._evidence_of(place), 6)
            while len(self._evidence) > KEPT:
                self._evidence.popitem(last=False)
        return script(name, self._evidence[name]).encode()

    def film(self, place: int) -> Path | None:
        """The camera film of an episode."""
        ref = self.refs[place]
        return film_of(ref, ref.open().header.video)

    def _list(self) -> str:
        with self._listing:
            said = "; ".join(list(self.problems.values())[:3])
            some = f"{len(self.problems)} episodes cannot be judged: {said}" if said else None
            state = {"left": self.left, "problems": None if self.left else some}
            return run_data(self.title, self._tables, traces=True, state=state)

    def _evidence_of(self, place: int) -> bytes:
        ref = self.refs[place]
        settings = self.settings
        try:
            with self._judging:
                episode = ref.open()
                again = Again(episode, settings.rule_set, settings.overrides, settings.bind)
                said = stored_verdicts(self.rows.get(place, ()))
                data = episode_data(
                    again,
                    said,
                    everything=self.everything,
                    shared=self._meshes,
                    film_at=f"films/{place}" if film_of(ref, episode.header.video) else None,
                )
        except InputError as error:
            return packed_with({"problem": str(error)}, b"")
        return data
